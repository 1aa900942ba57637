"""x"""

import dataclasses as dc


@dc.dataclass
class PlannerConfig:
    latency: float = 0.1
