"""Why something cannot be planned: as a result, and as an exception."""

from __future__ import annotations

import dataclasses as dc

from drake_srg.planning.motion.clearance import Clearance
from drake_srg.types import Failure


@dc.dataclass(frozen=True)
class PlanningFailure:
    """Why there is no path, no motion or no plan."""

    failure: Failure
    message: str
    clearance: Clearance | None = None  # of the colliding pair, where one is known


class NoPathError(Exception):
    """Raised by a move that does not exist; `failure` says why."""

    def __init__(self, failure: PlanningFailure) -> None:
        super().__init__(failure.message)
        self.failure = failure
