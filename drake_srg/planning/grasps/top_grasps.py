"""Grasps from above of unknown things, found in a height map."""

from __future__ import annotations

import copy
import dataclasses as dc
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.random import Generator, default_rng
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.grasps.fingers import Fingers, FingerState
from drake_srg.planning.grasps.scoring import Candidates, PinchJudge, WrapJudge
from drake_srg.planning.grasps.segmentation import Segmentation, Thing
from drake_srg.planning.motion.inverse_kinematics import HandTarget
from drake_srg.types import Failure, HeightMap, Vector

# Places closer to each other than this belong to one thing [m].
SAME_THING = 0.06
# Grasps of one thing, such as on the rim of a plate, fail alike if width and height
# between the fingers agree within this [m].
ALIKE = 0.01


@dc.dataclass(frozen=True, eq=False, kw_only=True)
class TopGrasp:
    """A pinch or a wrap by a hand that points down."""

    X_WG: RigidTransform  # of the palm when the fingers close [m]
    fingers: Fingers
    half_gap: float  # of the open fingers' ends [m]
    width: float  # expected between the pads [m]
    p_WC: Vector  # middle between the pads at contact, shape (3,) [m]
    height: float  # top of the target, above the table [m]
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
    def detectable(self) -> bool:
        """Whether the joint angles of a hand reveal that it holds the thing."""
        return self.fingers.detectable(self.width)

    def target(self) -> HandTarget:
        """Return the hand's target when the fingers close."""
        return HandTarget.from_pose(self.X_WG)

    def holds(self, q: Vector, proximity: Vector) -> bool:
        """Return whether what the closed fingers sense may be the target."""
        return self.fingers.holds(self.width, q, proximity)

    def half_turn(self) -> TopGrasp:
        """Return the same grasp with exchanged fingers."""
        turn = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 0.0])
        return dc.replace(self, X_WG=self.X_WG @ turn)

    def like(self, other: TopGrasp, distance: float, angle: float) -> bool:
        """Return whether another grasp is within a distance [m] and an angle [rad]."""
        apart = np.linalg.norm(self.p_WC - other.p_WC)
        turn = abs((self.yaw - other.yaw + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
        return bool(apart < distance and turn < angle)

    def takes_as_much(self, other: TopGrasp, within: float) -> bool:
        """Return whether another grasp's thing is as wide and high, `within` [m]."""
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
    """Result of planning grasps on a table.

    Attributes:
        grasps: The best first.
        things: Number of things above the table; those that touch count as one.
        explain: Returns the things without a grasp; see `refused`.
        places: See `Segmentation.places`.
        beside_same: See `Segmentation.beside_same`.
    """

    grasps: tuple[TopGrasp, ...] = ()
    things: int = 0
    explain: Callable[[], tuple[Refusal, ...]] = tuple
    places: Callable[[float], Sequence[Vector]] = lambda apart: ()
    beside_same: Callable[[Vector, Vector, float], bool] = lambda p_1, p_2, apart: False

    @functools.cached_property
    def refused(self) -> tuple[Refusal, ...]:
        """Things without a grasp. Finding the reasons takes as long as planning."""
        return self.explain()


class GraspPlanner(Protocol):
    """Finds grasps from above of anything on a table."""

    def plan(
        self, height_map: HeightMap, *, tried: Sequence[TopGrasp] = (), seed: int = 0
    ) -> GraspPlan:
        """Return grasps of the things on a height map.

        Args:
            height_map: Map of the table.
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


# Height above the table that the ends of closing fingers keep [m].
TABLE_GAP = 0.002
# Directions of closing that are tried at each point.
YAWS = 18
# Candidates that are centered, turned a little and judged again on finer samples.
_KEPT = 120
# Grasps of a plan, at most.
_MOST = 40
# Candidates with lower scores are not worth an attempt.
_LEAST_SCORE = 3.5
# Grasps within this distance [m] and angle [rad] of each other count as one. Those
# within twice the distance of a failed one come last. Just before them come grasps
# elsewhere on the same thing, if its width and height there are the same.
_APART, _TURNED = 0.012, 0.35
# A thing is at least this high [m], and this large as seen from above [m²].
_LEAST_HEIGHT, _LEAST_AREA = 0.004, 6e-5
# Distance between the finest samples along the closing direction [m].
_STEP = 0.002
# Number of points that are tried: about this many in all, and at least this many per
# thing.
_POINTS, _PER_THING = 150, 16


@dc.dataclass(frozen=True)
class Reach:
    """Reach of a hand that points down: a ring around the arm's base [m]."""

    center: tuple[float, float]
    least: float
    most: float

    def contains(self, p_W: Vector) -> np.ndarray:
        """Return which points (n, 2 or more) the hand reaches, shape (n,)."""
        radius = np.linalg.norm(p_W[:, :2] - self.center, axis=1)
        return np.asarray((radius >= self.least) & (radius <= self.most))


class HeightMapGrasps:
    """Finds grasps without knowing or separating the things on a table.

    It combines points on things with directions, and judges all depths and openings
    together (see `PinchJudge`). The best are moved until both pads touch at the same
    time, turned a little, and judged once more. Things without a pinch may be wrapped
    (`WrapJudge`).

    Args:
        fingers: The hand's.
        table: World z of the table [m].
        reach: Reach of the hand; None for everywhere.
        table_gap: Height above the table that the ends of closing fingers keep [m].
    """

    def __init__(
        self,
        fingers: Fingers,
        table: float,
        *,
        reach: Reach | None = None,
        table_gap: float = TABLE_GAP,
    ) -> None:
        self._fingers, self._table, self._reach = fingers, table, reach
        self._judge = PinchJudge(fingers, table_gap=table_gap, step=_STEP)
        self._coarse = PinchJudge(
            fingers, table_gap=table_gap, step=0.004, across=0.009
        )
        wrap = fingers.wrap
        self._wrap_judge = (
            WrapJudge(fingers, wrap, table_gap=table_gap) if wrap else None
        )

    def proposals(
        self, segments: Segmentation, rng: Generator
    ) -> tuple[Vector, Vector]:
        """Return points on things and their middles, each with all directions.

        The points are within the hand's reach, perhaps only at the end of a thing.

        Args:
            segments: The table's things, or some of them.
            rng: For random draws.

        Returns:
            x, y of the palm's axis in world, shape (n, 2) [m], and directions of
            closing, shape (n,) [rad].
        """
        centers = segments.map.centers()
        points = [thing.middle for thing in segments.things]
        parts = [centers[tuple(thing.cells.T)] for thing in segments.things]
        if self._reach is not None:
            parts = [part[self._reach.contains(part)] for part in parts]
        total = sum(map(len, parts))
        for part in parts:
            share = round(_POINTS * len(part) / max(total, 1))
            count = min(max(share, _PER_THING), len(part))
            points += list(part[rng.choice(len(part), count, replace=False)])
        p_W = np.array(points)
        yaws = np.pi * (np.arange(YAWS) / YAWS - 0.5)
        return np.repeat(p_W, len(yaws), axis=0), np.tile(yaws, len(p_W))

    def segment(self, height_map: HeightMap) -> Segmentation:
        """Return the things on the table according to a height map."""
        return Segmentation.of(
            height_map,
            self._table,
            least_height=_LEAST_HEIGHT,
            least_area=_LEAST_AREA,
        )

    def plan(
        self, height_map: HeightMap, *, tried: Sequence[TopGrasp] = (), seed: int = 0
    ) -> GraspPlan:
        """Return grasps of the things on a height map."""
        segments = self.segment(height_map)
        if not segments.things:
            return GraspPlan()
        new, old = self._distinct(segments, self._pinches(segments, seed), tried)
        # Wrap only things without a pinch: wraps need a flat top and more room.
        wraps = self._wraps(segments, _not_taken(segments, new))
        new_wraps, old_wraps = self._distinct(segments, wraps, tried)
        grasps = (new + new_wraps + old + old_wraps)[:_MOST]
        return GraspPlan(
            tuple(grasps),
            len(segments.things),
            lambda: tuple(
                self._refuse(segments, thing, seed)
                for thing in _not_taken(segments, grasps)
            ),
            segments.places,
            segments.beside_same,
        )

    def _pinches(self, segments: Segmentation, seed: int) -> list[TopGrasp]:
        """Return the best pinches, the best first."""
        found = self.allowed(segments, self._search(segments, seed))
        deepest = self._fingers.deepest
        return [self._grasp(row, deepest) for row in _rows(found)]

    def _wraps(self, segments: Segmentation, things: Sequence[Thing]) -> list[TopGrasp]:
        """Return wraps around some of the things, the best first."""
        judge, wrap = self._wrap_judge, self._fingers.wrap
        if judge is None or wrap is None:
            return []
        found = judge.judge(segments, *judge.places(segments, things))
        if self._reach is not None:
            found = found.take(np.flatnonzero(self._reach.contains(found.p_W)))
        found = judge.refine(segments, found.best(_KEPT))
        rows = _rows(self.allowed(segments, found.best(_KEPT)))
        grasps = [self._grasp(row, wrap.deepest) for row in rows]
        return [dc.replace(grasp, wrapped=True) for grasp in grasps]

    def allowed(self, segments: Segmentation, candidates: Candidates) -> Candidates:
        """Return the candidates that may be used; override it to exclude some."""
        return candidates

    def _search(self, segments: Segmentation, seed: int) -> Candidates:
        """Return the best pinches, the best first."""
        p_W, yaw = self._within_reach(*self.proposals(segments, default_rng(seed)))
        first = self._coarse.judge(segments, p_W, yaw).best(3 * _KEPT)
        first = self._coarse.refine(segments, first).best(_KEPT)
        centered = first.p_W + (0.5 * (first.low + first.high))[:, None] * (
            first.direction
        )
        half_step = 0.5 * np.pi / YAWS
        finer = self._judge.judge(
            segments,
            *self._within_reach(
                np.repeat(centered, 3, axis=0),
                np.repeat(first.yaw, 3)
                + np.tile([-half_step, 0.0, half_step], len(centered)),
            ),
        )
        found = self._judge.refine(segments, finer).best(3 * _KEPT)
        return found.take(np.flatnonzero(found.score > _LEAST_SCORE))

    def _within_reach(self, p_W: Vector, yaw: Vector) -> tuple[Vector, Vector]:
        """Return the proposals that the hand reaches."""
        if self._reach is None:
            return p_W, yaw
        reached = self._reach.contains(p_W)
        return p_W[reached], yaw[reached]

    def _grasp(self, row: Candidates, deepest: float) -> TopGrasp:
        """Return the grasp of a single candidate.

        Args:
            row: The candidate.
            deepest: Palm x of its lowest point [m].
        """
        tip, low, high = float(row.tip[0]), float(row.low[0]), float(row.high[0])
        width = high - low + _STEP
        xy, top = row.p_W[0], float(row.top[0])
        z = self._table + tip + deepest
        middle = xy + 0.5 * (low + high) * row.direction[0]
        return TopGrasp(
            X_WG=palm_pose(np.array([*xy, z]), float(row.yaw[0])),
            fingers=self._fingers,
            half_gap=float(row.half_gap[0]),
            width=width,
            p_WC=np.array([*middle, self._table + 0.5 * (tip + top)]),
            height=top,
            score=float(row.score[0]),
        )

    def _distinct(
        self,
        segments: Segmentation,
        grasps: Sequence[TopGrasp],
        tried: Sequence[TopGrasp],
    ) -> tuple[list[TopGrasp], list[TopGrasp]]:
        """Return distinct grasps, the best first: new ones, and others.

        The others resemble failed ones. Among them, grasps at other places come first.
        """
        near = [segments.labels_near(failed.p_WC, SAME_THING) for failed in tried]
        new: list[TopGrasp] = []
        alike: list[TopGrasp] = []
        old: list[TopGrasp] = []
        for grasp in grasps:
            found = new + alike + old
            if any(grasp.like(g, _APART, _TURNED) for g in found):
                continue
            label = segments.label_at(grasp.p_WC)
            if any(grasp.like(g, 2 * _APART, _TURNED) for g in tried):
                old.append(grasp)
            elif any(
                label in labels and grasp.takes_as_much(failed, ALIKE)
                for failed, labels in zip(tried, near, strict=True)
            ):
                alike.append(grasp)
            else:
                new.append(grasp)
            if len(new) >= _MOST:
                break
        return new, alike + old

    def _takes(self, segments: Segmentation, seed: int) -> bool:
        """Return whether there is any grasp."""
        found = self._pinches(segments, seed) or self._wraps(segments, segments.things)
        return bool(found)

    def _refuse(self, segments: Segmentation, thing: Thing, seed: int) -> Refusal:
        """Return the reason why there is no grasp of a thing."""
        points = segments.map.centers()[thing.cells[:, 0], thing.cells[:, 1]]
        anywhere = copy.copy(self)
        anywhere._reach = None
        if self._reach is not None and not self._reach.contains(points).any():
            failure = Failure.OUT_OF_REACH
        elif len(segments.things) > 1 and self._takes(segments.only(thing), seed):
            failure = Failure.BLOCKED
        elif self._reach is not None and anywhere._takes(segments.only(thing), seed):
            failure = Failure.OUT_OF_REACH
        elif thing.size[1] > self._fingers.max_width:
            failure = Failure.TOO_WIDE
        else:
            failure = Failure.NO_GRASP
        p_W = np.array([*thing.middle, self._table + thing.top])
        return Refusal(p_W, thing.size, failure)


def _not_taken(segments: Segmentation, grasps: Sequence[TopGrasp]) -> list[Thing]:
    """Return the things without a grasp."""
    taken: set[int] = set()
    for grasp in grasps:
        along = np.array([np.cos(grasp.yaw), np.sin(grasp.yaw)])
        offsets = np.linspace(-0.5, 0.5, 21)[:, None] * grasp.width * along
        cells = segments.map.cells(grasp.p_WC[:2] + offsets)
        inside = np.all((cells >= 0) & (cells < segments.labels.shape), axis=1)
        taken |= set(segments.labels[tuple(cells[inside].T)].tolist())
    return [thing for thing in segments.things if thing.label not in taken]


def _rows(candidates: Candidates) -> list[Candidates]:
    return [candidates.take(np.array([i])) for i in range(len(candidates.score))]
