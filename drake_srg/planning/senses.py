"""The measurements that planners of picks share."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from drake_srg.types import Vector

_STILL = 0.05  # joint speed below which the fingers rest [rad/s]
_CLEAR = 0.001  # distance at which resting fingers have let go of an object [m]

SeenT = TypeVar("SeenT")


@dc.dataclass(frozen=True)
class HandSenses(Generic[SeenT]):
    """Measurements of an arm with a gripper at one time."""

    q: Vector  # the arm's joints, shape (N,) [rad]
    fingers: Vector  # the gripper's joints, shape (n,) [rad]
    finger_speeds: Vector  # shape (n,) [rad/s]
    grasped: bool  # both fingers sense something
    proximity: Vector  # shape (m,) [m]
    see: Callable[[], SeenT]  # looks through the cameras, which takes long

    @property
    def still(self) -> bool:
        """Whether the fingers have come to rest."""
        return bool(np.max(np.abs(self.finger_speeds)) < _STILL)

    @property
    def clear(self) -> bool:
        """Whether nothing is near the fingers."""
        return bool(np.min(self.proximity) > _CLEAR)
