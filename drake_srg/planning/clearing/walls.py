"""The plane between two arms, walls parallel to it, and maps and motions with walls."""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.destination import Spots
from drake_srg.planning.clearing.maps import is_still, thing_at
from drake_srg.planning.clearing.placing import BinMotions
from drake_srg.planning.grasps.top_grasps import TopGrasp
from drake_srg.planning.motion.arm_model import restores_fingers
from drake_srg.planning.motion.planning_scene import PlanningFailure, PlanningScene
from drake_srg.types import AnyMode, Box, Failure, HeightMap, Mode, Vector

# Least distance between the arms [m]. It exceeds the sum of their errors: 0.02 m each,
# at a joint error of 0.02 rad.
GAP = 0.05
# Depths [m]: across the plane, up to the plane, and clear of the other arm, wherever
# that is. An open hand needs 0.12 m on either side of a grasp, so with `BEYOND` both
# arms can take things from the middle.
BEYOND = -0.16
HALF = 0.5 * GAP
SIDE = GAP - BEYOND
# A hand takes nothing nearer than this to a wall [m]: half the palm's width.
_ROOM = 0.04
_SIZE = 6.0  # of a wall [m]
_EDGE = 0.01  # a thing this near to the end of a map may extend beyond it [m]
_SAMPLES = 40  # of a motion with a load
LOADED = (Mode.LIFT, Mode.TRANSFER, Mode.PLACE)


@dc.dataclass(frozen=True, eq=False)
class Frontier:
    """The vertical plane between two arms, from the side of one of them.

    Attributes:
        middle: A point of it, x and y in world, shape (2,) [m].
        inward: Direction from there to the arm, a unit vector, shape (2,).
    """

    middle: Vector
    inward: Vector

    @classmethod
    def between(cls, p_WA: Vector, p_WB: Vector) -> Frontier:
        """Return the plane halfway between two arms, from the side of the first.

        Args:
            p_WA: Base of the first arm, shape (2 or 3,) [m].
            p_WB: Base of the second arm.
        """
        apart = p_WA[:2] - p_WB[:2]
        return cls(0.5 * (p_WA[:2] + p_WB[:2]), apart / np.linalg.norm(apart))

    def depth(self, p_W: Vector) -> Vector:
        """Return how far points (..., 2 or more) are on the arm's side, (...) [m]."""
        depth: Vector = (p_W[..., :2] - self.middle) @ self.inward
        return depth


@dc.dataclass(frozen=True, eq=False)
class Wall:
    """A wall that keeps an arm at a depth, parallel to a frontier."""

    frontier: Frontier
    depth: float  # of its face [m]; negative beyond the frontier

    def AddTo(self, scene: PlanningScene) -> None:
        """Add the wall to an arm's scene, for good."""
        inward = self.frontier.inward
        x, y = self.frontier.middle + (self.depth - 0.5 * _SIZE) * inward
        R_WO = RotationMatrix.MakeZRotation(float(np.arctan2(inward[1], inward[0])))
        scene.AddFixture(Box([_SIZE, _SIZE, _SIZE]), RigidTransform(R_WO, [x, y, 0.0]))


@dc.dataclass(frozen=True, eq=False)
class SharedHeightMap(HeightMap):
    """A height map without the area in which the other arm is or may be.

    Attributes:
        least: The least depth that is free for the arm now [m].
        wanted: Whether the other arm waits.
        for_good: Whether the other arm has failed and stays where it is.
    """

    least: float = BEYOND
    wanted: bool = False
    for_good: bool = False

    @property
    def edge(self) -> float:
        """The depth at which the map ends [m]: a little beyond the wall."""
        return max(BEYOND, self.least - HALF)

    @property
    def open(self) -> bool:
        """Whether the map shows everything that the arm could ever take."""
        return self.for_good or self.least <= BEYOND

    def is_like(self, other: SharedHeightMap) -> bool:
        """Return whether it would lead to the same plan as another map of the table."""
        mine, others = (
            (seen.least, seen.wanted, seen.for_good) for seen in (self, other)
        )
        return mine == others and is_still(other, self)


class WalledMotions(BinMotions):
    """Plans picks on one side of a wall, which the load does not cross either.

    Args:
        wall: The wall, which is in the scene.
        *args: See `ClearingMotions`.
        **others: See `ClearingMotions`.
    """

    def __init__(self, wall: Wall, *args: Any, **others: Any) -> None:
        super().__init__(*args, **others)
        self.wall = wall

    def reaches(self, grasp: TopGrasp, room: float = _ROOM) -> bool:
        """Return whether there is `room` [m] between a grasp and the wall."""
        depth = self.wall.frontier.depth(grasp.p_WC)
        return bool(depth > self.wall.depth + room)

    @restores_fingers
    def contains(self, q: Vector) -> bool:
        """Return whether all of an arm with an open, empty hand is behind the wall."""
        self.scene.SetFingers({})
        return self.scene.is_free(q)

    def plan(
        self,
        q_start: Vector,
        grasp: TopGrasp,
        height_map: HeightMap,
        number: int = 0,
        *,
        filled: float = -np.inf,
        spots: Spots = Spots(),  # noqa: B008  # it is immutable
    ) -> dict[AnyMode, Trajectory] | PlanningFailure:
        """Plan like `BinMotions`; the load clears the wall, however it hangs.

        A thing that the map shows only in part stays, because its size is unknown.
        """
        assert isinstance(height_map, SharedHeightMap)
        depth = self.wall.frontier.depth
        cells = thing_at(height_map, self._table, grasp.p_WC)
        if depth(cells).min() < height_map.edge + _EDGE:
            message = "the thing reaches over to where the other arm may be"
            return PlanningFailure(Failure.BLOCKED, message)
        length = float(np.max(np.linalg.norm(cells - grasp.p_WC[:2], axis=1)))
        least = self.wall.depth + length  # of the hand with the load
        message = "the load would reach over to the other arm"
        over = PlanningFailure(Failure.BLOCKED, message)
        if depth(grasp.p_WC) < least:  # do not plan in vain
            return over
        motions = super().plan(
            q_start, grasp, height_map, number, filled=filled, spots=spots
        )
        if isinstance(motions, PlanningFailure):
            return motions
        for mode in LOADED:
            if mode not in motions:
                continue
            times = np.linspace(0.0, motions[mode].end_time(), _SAMPLES)
            for q in motions[mode].vector_values(times).T:
                if depth(self.scene.X_WG(q).translation()) < least:
                    return over
        return motions
