"""Detects whether something is between the fingers."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np

from drake_srg.common.stages import StageOutput, StageSystem
from drake_srg.types import Vector, positive


@dc.dataclass(kw_only=True)
class GraspDetectorConfig:
    """When a grasp counts."""

    # All fingers must fire for this long [s]: the arm thesis's post-contact delay.
    post_contact_delay: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # Time between evaluations [s].
    period: float = dc.field(default=0.01, metadata=positive())


class GraspDetector(StageSystem):
    """Reports a grasp once every finger has sensed something for a while.

    .. pydrake_system::

        name: GraspDetector
        input_ports:
        - triggered
        output_ports:
        - grasped

    `triggered` (m) is nonzero where a sensor fires. `grasped` (1) is 1 while at least
    one sensor of each finger has fired without a break for `config.post_contact_delay`,
    else 0. The fingers of a closed empty hand sense each other: to tell that from a
    grasp, look at the joint angles, too.

    Args:
        fingers: The indices of each finger's sensors.
        config: When a grasp counts.
    """

    def __init__(
        self,
        fingers: Sequence[Sequence[int]],
        config: GraspDetectorConfig | None = None,
    ) -> None:
        super().__init__()
        self.config = config or GraspDetectorConfig()
        self._fingers = [list(finger) for finger in fingers]
        self.declare_stage(
            inputs={"triggered": sum(len(finger) for finger in fingers)},
            outputs={"grasped": StageOutput(1, self._grasped, timed=True)},
            # Time since when all fingers have sensed something; inf while they do not.
            state=[np.inf],
            period=self.config.period,
        )

    def update(self, time: float, state: Vector, triggered: Vector) -> list[float]:
        """See `Stage`."""
        fired = triggered.tolist()
        if all(any(fired[i] for i in finger) for finger in self._fingers):
            return [min(state[0], time)]
        return [np.inf]

    def _grasped(self, time: float, state: Vector) -> list[float]:
        return [float(time - state[0] >= self.config.post_contact_delay)]
