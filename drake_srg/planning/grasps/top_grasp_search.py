"""The search for grasps from above that all their planners share."""

from __future__ import annotations

import abc
import copy
import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator, default_rng

from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.scoring import (
    Candidates,
    PinchJudge,
    WrapJudge,
)
from drake_srg.planning.grasps.segmentation import Segmentation, Thing
from drake_srg.planning.grasps.top_grasp import (
    ALIKE,
    SAME_THING,
    GraspPlan,
    Refusal,
    TopGrasp,
    palm_pose,
)
from drake_srg.types import Failure, HeightMap, Vector

# Height above the table that the ends of closing fingers keep [m].
TABLE_GAP = 0.002
# Directions of closing that are tried at each point.
YAWS = 18
# Candidates that are centered, turned a little and judged again on finer samples.
_KEPT = 120
# Grasps of a plan, at most.
_MOST = 40
# Candidates that score less are not worth an attempt.
_LEAST_SCORE = 3.5
# Grasps within this distance [m] and angle [rad] of each other count as one; within
# twice the distance of one that failed, they come last. Before them come those that
# take something as wide and high of the same thing elsewhere.
_APART, _TURNED = 0.012, 0.35
# A thing is at least this high [m], and this large as seen from above [m²].
_LEAST_HEIGHT, _LEAST_AREA = 0.004, 6e-5
# Distance between the finest samples along the closing direction [m].
_STEP = 0.002


@dc.dataclass(frozen=True)
class Reach:
    """Where the hand can be when it points down: a ring about the arm's base [m]."""

    center: tuple[float, float]
    least: float
    most: float

    def contains(self, p_W: Vector) -> np.ndarray:
        """Return which points (n, 2 or more) the hand reaches, shape (n,)."""
        radius = np.linalg.norm(p_W[:, :2] - self.center, axis=1)
        return np.asarray((radius >= self.least) & (radius <= self.most))


class TopGraspSearch(abc.ABC):
    """Judges places and directions on a height map, and explains what it refuses.

    All depths and openings are judged at once (see `PinchJudge`). The best are moved to
    where both pads touch at the same time, turned a little, and judged once more. What
    no pinch takes may be wrapped (`WrapJudge`).

    Args:
        fingers: The hand's.
        table: World z of the table [m].
        reach: Where the hand can be; None for everywhere.
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

    @abc.abstractmethod
    def proposals(
        self, segments: Segmentation, rng: Generator
    ) -> tuple[Vector, Vector]:
        """Return where to judge pinches.

        Args:
            segments: What stands on the table, or a part of that.
            rng: For random draws.

        Returns:
            x, y of the palm's axis in world, shape (n, 2) [m], and directions of
            closing, shape (n,) [rad].
        """

    def segment(self, height_map: HeightMap) -> Segmentation:
        """Return what stands on the table according to a height map."""
        return Segmentation.of(
            height_map,
            self._table,
            least_height=_LEAST_HEIGHT,
            least_area=_LEAST_AREA,
        )

    def plan(
        self, height_map: HeightMap, *, tried: Sequence[TopGrasp] = (), seed: int = 0
    ) -> GraspPlan:
        """See `GraspPlanner`."""
        segments = self.segment(height_map)
        if not segments.things:
            return GraspPlan()
        new, old = self._distinct(segments, self._pinches(segments, seed), tried)
        # Only what no pinch takes: wraps need a flat top and more room.
        wraps = self._wraps(segments, _not_taken(segments, new))
        new_wraps, old_wraps = self._distinct(segments, wraps, tried)
        grasps = (new + new_wraps + old + old_wraps)[:_MOST]
        return GraspPlan(
            tuple(grasps),
            len(segments.things),
            lambda: self._refusals(segments, grasps, seed),
            segments.places,
            segments.beside_same,
        )

    def _refusals(
        self, segments: Segmentation, grasps: Sequence[TopGrasp], seed: int
    ) -> tuple[Refusal, ...]:
        """Return the things that no grasp takes."""
        return tuple(
            self._refuse(segments, thing, seed)
            for thing in _not_taken(segments, grasps)
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
        """Return those candidates that may be grasped."""
        return candidates

    def _search(self, segments: Segmentation, seed: int) -> Candidates:
        """Return the best pinches, the best first."""
        p_W, yaw = self._within_reach(*self.proposals(segments, default_rng(seed)))
        first = self._coarse.judge(segments, p_W, yaw).best(3 * _KEPT)
        first = self._coarse.refine(segments, first).best(_KEPT)
        centered = first.p_W + (0.5 * (first.low + first.high))[:, None] * (
            first.direction
        )
        little = 0.5 * np.pi / YAWS
        again = self._judge.judge(
            segments,
            *self._within_reach(
                np.repeat(centered, 3, axis=0),
                np.repeat(first.yaw, 3)
                + np.tile([-little, 0.0, little], len(centered)),
            ),
        )
        found = self._judge.refine(segments, again).best(3 * _KEPT)
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
        """Return grasps that differ, the best first: new ones, and like failed ones.

        Of those that are like failed ones, the ones at other places come first.
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
        """Return whether any grasp takes anything."""
        found = self._pinches(segments, seed) or self._wraps(segments, segments.things)
        return bool(found)

    def _anywhere(self) -> TopGraspSearch:
        """Return the same search without limits of reach."""
        search = copy.copy(self)
        search._reach = None
        return search

    def _refuse(self, segments: Segmentation, thing: Thing, seed: int) -> Refusal:
        """Return why there is no grasp of a thing."""
        points = segments.map.middles()[thing.cells[:, 0], thing.cells[:, 1]]
        if self._reach is not None and not self._reach.contains(points).any():
            failure = Failure.OUT_OF_REACH
        elif len(segments.things) > 1 and self._takes(segments.only(thing), seed):
            failure = Failure.BLOCKED
        elif self._reach is not None and self._anywhere()._takes(
            segments.only(thing), seed
        ):
            failure = Failure.OUT_OF_REACH
        elif thing.size[1] > self._fingers.max_width:
            failure = Failure.TOO_WIDE
        else:
            failure = Failure.NO_GRASP
        p_W = np.array([*thing.middle, self._table + thing.top])
        return Refusal(p_W, thing.size, failure)


def _not_taken(segments: Segmentation, grasps: Sequence[TopGrasp]) -> list[Thing]:
    """Return the things that no grasp takes."""
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
