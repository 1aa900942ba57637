"""Where the hands of environments start, and where they may go."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import numpy.typing as npt

from drake_srg.scenario import Scenario
from drake_srg.types import Vector

# The region of the objects and this around it, up to this height [m].
_MARGIN, _HIGHEST = 0.08, 0.3
# Height at the start of an episode, of the grasp centre above the table [m]: 5 cm over
# the tallest object.
START_HEIGHT = 0.17
# The open fingers' ends are 20 mm beyond the grasp centre [m].
LOWEST = 0.025
_MOST_YAW = 3.0  # rad


@dc.dataclass(frozen=True, eq=False)
class Workspace:
    """Where a hand may go, and where it starts.

    Attributes:
        low: Least x, y, z of the grasp centre in world, shape (3,) [m].
        high: Greatest, shape (3,) [m].
        start: Its pose over the middle of the region, shape (4,) [m, rad].
    """

    low: Vector
    high: Vector
    start: Vector

    @classmethod
    def of(cls, scenario: Scenario, *, goal: bool = False) -> Workspace:
        """Return the workspace of a scenario's hand.

        Args:
            scenario: With `task.region`.
            goal: Whether `task.place.position` belongs to it.
        """
        table = scenario.table.height
        region = np.array([scenario.task.region.min, scenario.task.region.max])
        reached = region
        if goal:
            reached = np.array([*region, scenario.task.place.position])
        return cls(
            np.array([*(reached.min(axis=0) - _MARGIN), table + LOWEST]),
            np.array([*(reached.max(axis=0) + _MARGIN), table + _HIGHEST]),
            np.array([*region.mean(axis=0), table + START_HEIGHT, 0.0]),
        )

    def within(self, pose: Vector) -> Vector:
        """Return the pose (4) nearest to one that the hand may go to."""
        yaw = np.clip(pose[3], -_MOST_YAW, _MOST_YAW)
        return np.append(np.clip(pose[:3], self.low, self.high), yaw)

    def near(self, margin: float) -> npt.NDArray[np.float64]:
        """Return the least and greatest x, y, z up to `margin` [m] outside, (3, 2)."""
        return np.stack([self.low - margin, self.high + margin], axis=1)
