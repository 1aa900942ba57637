"""Pushes apart a heap that offers no grasp."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Sequence

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.maps import highest_near, parts
from drake_srg.planning.clearing.motions import turned_to
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.segmentation import Segmentation, Thing
from drake_srg.planning.grasps.top_grasps import Reach, palm_pose
from drake_srg.planning.motion.arm_model import restores_fingers
from drake_srg.planning.motion.inverse_kinematics import (
    HandTarget,
    find_posture,
)
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import NoPathError, PlanningScene
from drake_srg.planning.motion.trajectories import STRAIGHT, PathPart
from drake_srg.types import HeightMap, Vector

_DIRECTIONS = 16
# The uppermost thing of a heap reaches down by at least `_TOP` [m]. A heap has parts
# that are lower than its top by `_FLAT` and at least `_EDGE` wide [m]. A plate or a
# lying box on its own has only a rounded edge; pushing would not help it.
_TOP, _FLAT, _EDGE = 0.025, 0.035, 0.01
# Distance between the closed hand's middle and the thing that it pushes, at first,
# and length of the push [m].
_BEFORE, _FAR = 0.05, 0.2
# Room for the closed hand around its middle, and under its ends [m].
_AROUND, _UNDER = 0.04, 0.008
# A pushed thing needs this much room at its new place, along and across [m], and this
# share of the room must be free.
_ROOM, _ACROSS, _LEAST_FREE = 0.2, 0.12, 0.6
# Pushes are alike if they begin within `_SAME_PLACE` of each other [m] and their
# directions differ by less than `_SAME_WAY` [rad].
_SAME_PLACE, _SAME_WAY = 0.05, np.deg2rad(30.0)


@dc.dataclass(frozen=True)
class Push:
    """A straight motion of the closed fingertips, which point down."""

    start_W: Vector  # shape (3,) [m]
    end_W: Vector  # shape (3,) [m]
    # Motions that remain: through the heap and over the bin.
    motions: tuple[Trajectory, ...] = ()
    ready_at: float = 0.0  # when planning has taken its time [s]

    @property
    def yaw(self) -> float:
        """Direction of the motion from the world's x [rad]."""
        x, y = (self.end_W - self.start_W)[:2]
        return float(np.arctan2(y, x))

    def is_like(self, other: Push) -> bool:
        """Return whether another push moves the same thing in the same direction."""
        apart = np.linalg.norm(self.start_W - other.start_W)
        turn = (self.yaw - other.yaw + np.pi) % (2.0 * np.pi) - np.pi
        return bool(apart < _SAME_PLACE and abs(turn) < _SAME_WAY)


def best_push(
    segments: Segmentation,
    table: float,
    reach: Reach | None,
    tried: Sequence[Push] = (),
) -> Push | None:
    """Return the push that moves the top of the highest heap into free space.

    Space out of reach does not count, so a heap at the edge is pushed inwards.

    Args:
        segments: The segmented map of the table.
        table: Height of the table [m].
        reach: Reach of the hand; None for everywhere.
        tried: Pushes that did not help; similar ones are left out.
    """
    for thing in sorted(segments.things, key=lambda t: -t.top):
        pushes = _pushes(segments, thing, table, reach)
        if reach is not None:
            pushes = [
                (free, push)
                for free, push in pushes
                if reach.contains(np.array([push.start_W, push.end_W])).all()
            ]
        pushes = [(f, p) for f, p in pushes if not any(map(p.is_like, tried))]
        if pushes:
            return max(pushes, key=lambda found: found[0])[1]
    return None


def _pushes(
    segments: Segmentation, thing: Thing, table: float, reach: Reach | None
) -> list[tuple[float, Push]]:
    """Return pushes of the uppermost thing, each with its free space within reach."""
    above = segments.above[thing.cells[:, 0], thing.cells[:, 1]]
    top = float(np.quantile(above, 0.98))  # single cells are noise
    if not _reaches_below(segments, thing, top - _FLAT):
        return []
    cells = thing.cells[above > top - _TOP]
    points = segments.map.centers()[cells[:, 0], cells[:, 1]]
    middle, height = points.mean(axis=0), top - _TOP
    found = []
    for yaw in 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        along = np.array([np.cos(yaw), np.sin(yaw)])
        across = np.array([-along[1], along[0]])
        s = (points - middle) @ along
        start = middle + (s.min() - _BEFORE) * along
        hand = _patch(start, along, across, (-_AROUND, _AROUND), 2.0 * _AROUND)
        if segments.lookup(hand).max() > height - _UNDER:
            continue
        room = _patch(middle, along, across, (s.max(), s.max() + _ROOM), _ACROSS)
        there = room.reshape(-1, 2)
        free = _is_free(segments, there)
        if np.mean(free) < _LEAST_FREE:
            continue
        if reach is not None:
            free &= reach.contains(there)
        ends = (start, start + (_BEFORE + _FAR) * along)
        z = table + height
        start_W, end_W = (np.array([*end, z]) for end in ends)
        found.append((float(np.mean(free)), Push(start_W, end_W)))
    return found


def _reaches_below(segments: Segmentation, thing: Thing, height: float) -> bool:
    """Return whether a heap has a part below a height that is wider than an edge.

    Args:
        segments: The segmented map of the table.
        thing: The heap.
        height: Above the table [m].
    """
    lower = (segments.labels == thing.label) & (segments.above < height)
    size = max(3, round(_EDGE / segments.map.resolution))
    kernel = np.ones((size, size), np.uint8)
    wide = cv2.morphologyEx(lower.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    return bool(parts(wide > 0, segments.map.resolution))


def _patch(
    p_W: Vector, along: Vector, across: Vector, ends: tuple[float, float], width: float
) -> Vector:
    """Return points that fill a rectangle, shape (10, 10, 2) [m]."""
    s, t = np.linspace(*ends, 10), np.linspace(-0.5 * width, 0.5 * width, 10)
    points: Vector = p_W + s[:, None, None] * along + t[:, None] * across
    return points


def _is_free(segments: Segmentation, p_W: Vector) -> npt.NDArray[np.bool_]:
    """Return at which of the points (n, 2) the table itself is visible, shape (n,)."""
    cells = segments.map.cells(p_W)
    shape = np.array(segments.above.shape)
    inside = np.all((cells >= 0) & (cells < shape), axis=1)
    iy, ix = np.clip(cells, 0, shape - 1).T
    low = segments.above[iy, ix] < segments.least
    return np.asarray(inside & ~segments.unknown[iy, ix] & low)


_OVER = 0.06  # height of the fingertips above everything on the way there [m]
_STARTS = 4  # of inverse kinematics


class PushMotions:
    """Plans pushes in a planning scene; keeps no state between calls.

    Args:
        scene: The arm, the gripper, the furniture and the bin.
        moves: The moves in that scene.
        q_over: Posture high over the bin, shape (N,) [rad].
        fingers: The gripper's fingers.
        table: Height of the table [m].
        reach: Reach of the hand; None for everywhere.
        segment: Returns what stands on the table according to a height map.
        period: Period of the planner [s]; None: the arm rests between all motions.
    """

    def __init__(
        self,
        scene: PlanningScene,
        moves: Moves,
        q_over: Vector,
        *,
        fingers: Fingers,
        table: float,
        reach: Reach | None,
        segment: Callable[[HeightMap], Segmentation],
        period: float | None,
    ) -> None:
        self.scene, self._moves, self._q_over = scene, moves, q_over
        self._fingers, self._table = fingers, table
        self._reach, self._segment = reach, segment
        self._period = period

    @restores_fingers
    def plan(
        self, q_start: Vector, height_map: HeightMap, tried: Sequence[Push] = ()
    ) -> Push | None:
        """Plan motions to a heap, through its top, and over the bin, or return None.

        Args:
            q_start: Posture of the arm, at rest, shape (N,) [rad].
            height_map: Height map of the table.
            tried: See `best_push`.
        """
        push = best_push(self._segment(height_map), self._table, self._reach, tried)
        if push is None:
            return None
        moves = self._moves
        up = np.array([0.0, 0.0, self._fingers.deepest])
        # Try the broad side of the hand first.
        for yaw in (push.yaw + 0.5 * np.pi, push.yaw - 0.5 * np.pi, push.yaw):
            self.scene.SetFingers(self._fingers.closed(0.0).joints)
            start, end = (
                HandTarget.from_pose(palm_pose(p + up, yaw))
                for p in (push.start_W, push.end_W)
            )
            ik = find_posture(
                self.scene,
                start,
                q_nominal=self._q_over,
                q_guess=turned_to(self.scene, self._q_over, push.start_W),
                max_starts=_STARTS,
            )
            if ik is None:
                continue
            highest = highest_near(height_map, push.start_W, np.inf)
            rise = highest + _OVER - push.start_W[2]
            try:
                down = moves.straight(ik.q, moves.above(ik.q, rise))[::-1]
                across = moves.straight(ik.q, end)
                away = moves.straight(across[-1], moves.above(across[-1], rise))
                to = PathPart(moves.joint_path(q_start, down[0]))
                back = PathPart(moves.joint_path(away[-1], self._q_over))
                motions = (
                    *self._free(to, PathPart(down, STRAIGHT)),
                    moves.timed(across, moves.holding, straight=True),
                    *self._free(PathPart(away, STRAIGHT), back),
                )
                return dc.replace(push, motions=motions)
            except NoPathError:
                continue
        return None

    def _free(self, *parts: PathPart) -> tuple[Trajectory, ...]:
        """Return the motions of an empty hand along parts of a path.

        Raises:
            NoPathError: If there is no such motion.
        """
        moves = self._moves
        apart = tuple(moves.timed_part(part, moves.free) for part in parts)
        if self._period is None:
            return apart
        return moves.without_rest(apart, parts, moves.free, self._period)
