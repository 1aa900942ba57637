"""A grasp from above, and the planners that find such grasps."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.grasps.fingers import Fingers, FingerState
from drake_srg.planning.motion.hand_target import HandTarget
from drake_srg.types import Failure, HeightMap, Vector

# Places that are nearer to each other belong to one thing [m].
SAME_THING = 0.06
# Grasps of one thing fail alike, such as on the rim of a plate, if what is between the
# fingers is as wide and as high within [m].
ALIKE = 0.01


@dc.dataclass(frozen=True, eq=False, kw_only=True)
class TopGrasp:
    """A pinch or a wrap by a hand that points down."""

    X_WG: RigidTransform  # of the palm when the fingers close [m]
    fingers: Fingers
    half_gap: float  # of the open fingers' ends [m]
    width: float  # expected between the pads [m]
    p_WC: Vector  # middle between the pads at contact, shape (3,) [m]
    height: float  # top of what is taken, above the table [m]
    score: float  # higher is better
    wrapped: bool = False  # a wrap, not a pinch

    @property
    def yaw(self) -> float:
        """Direction in which the fingers close, from the world's x [rad]."""
        y_W = self.X_WG.rotation().matrix()[:, 1]
        return float(np.arctan2(y_W[1], y_W[0]))

    @property
    def closure_open(self) -> float:
        """Closure at which the thing passes between the fingers."""
        return self.fingers.opened(self.half_gap).closure

    @property
    def closure_closed(self) -> float:
        """Closure at which the fingers press on the thing."""
        return self._closed.closure

    @property
    def fingers_open(self) -> Mapping[str, float]:
        """Joint angles of the open gripper by name [rad]."""
        return self.fingers.opened(self.half_gap).joints

    @property
    def fingers_closed(self) -> Mapping[str, float]:
        """Joint angles of the gripper as expected when holding, by name [rad]."""
        return self._closed.joints

    @property
    def _closed(self) -> FingerState:
        close = self.fingers.wrapped if self.wrapped else self.fingers.closed
        return close(self.width)

    @property
    def tellable(self) -> bool:
        """Whether joint angles tell a hand that holds the thing from an empty one."""
        return self.fingers.tellable(self.width)

    def target(self) -> HandTarget:
        """Return where the hand must be when the fingers close."""
        return HandTarget.from_pose(self.X_WG)

    def holds(self, q: Vector, proximity: Vector) -> bool:
        """Return whether closed fingers whose sensors fire hold something."""
        return self.fingers.holds(self.width, q, proximity)

    def half_turn(self) -> TopGrasp:
        """Return the same grasp with the fingers in each other's place."""
        turn = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 0.0])
        return dc.replace(self, X_WG=self.X_WG @ turn)

    def like(self, other: TopGrasp, distance: float, angle: float) -> bool:
        """Return whether another grasp is within a distance [m] and an angle [rad]."""
        apart = np.linalg.norm(self.p_WC - other.p_WC)
        turn = abs((self.yaw - other.yaw + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
        return bool(apart < distance and turn < angle)

    def takes_as_much(self, other: TopGrasp, within: float) -> bool:
        """Return whether another grasp takes what is as wide and high, `within` [m]."""
        wider, higher = self.width - other.width, self.height - other.height
        return max(abs(wider), abs(higher)) < within


@dc.dataclass(frozen=True, eq=False)
class Refusal:
    """A thing on the table that cannot be grasped, and why."""

    p_W: Vector  # middle of its top, shape (3,) [m]
    size: tuple[float, float]  # long and short side as seen from above [m]
    failure: Failure  # TOO_WIDE, OUT_OF_REACH, BLOCKED or NO_GRASP


@dc.dataclass(frozen=True, eq=False)
class GraspPlan:
    """What a planner finds on a table.

    Attributes:
        grasps: The best first.
        things: Number of things above the table; those that touch count as one.
        explain: Returns the things that no grasp takes; see `refused`.
        places: Returns places on things, shape (3,) each [m]: every part of a thing is
            within a distance [m] of one of them.
    """

    grasps: tuple[TopGrasp, ...] = ()
    things: int = 0
    explain: Callable[[], tuple[Refusal, ...]] = tuple
    places: Callable[[float], Sequence[Vector]] = lambda apart: ()
    beside_same: Callable[[Vector, Vector, float], bool] = lambda p_1, p_2, apart: False

    @functools.cached_property
    def refused(self) -> tuple[Refusal, ...]:
        """Things that no grasp takes. Finding out why takes as long as planning."""
        return self.explain()


class GraspPlanner(Protocol):
    """Finds grasps from above of whatever is on a table."""

    def plan(
        self, height_map: HeightMap, *, tried: Sequence[TopGrasp] = (), seed: int = 0
    ) -> GraspPlan:
        """Return grasps of what a height map shows.

        Args:
            height_map: The table and what is on it.
            tried: Grasps that failed; similar ones come later.
            seed: Seed of random draws; the same call returns the same plan.
        """


def palm_pose(p_W: Vector, yaw: float) -> RigidTransform:
    """Return the pose of a hand that points down and closes along a direction.

    Args:
        p_W: Origin of the palm in world, shape (3,) [m].
        yaw: Direction of the palm's y from the world's x [rad].
    """
    x, y = np.array([0.0, 0.0, -1.0]), np.array([np.cos(yaw), np.sin(yaw), 0.0])
    return RigidTransform(RotationMatrix(np.column_stack([x, y, np.cross(x, y)])), p_W)
