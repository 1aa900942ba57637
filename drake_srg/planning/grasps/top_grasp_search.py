"""The search for grasps from above that all their planners share."""

from __future__ import annotations

import abc
import copy
import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator, default_rng

from drake_srg.planning.grasps.candidates import Candidates, GraspJudgeConfig
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.pinch_judge import PinchJudge
from drake_srg.planning.grasps.relief import Relief, Thing
from drake_srg.planning.grasps.top_grasp import (
    ALIKE,
    SAME_THING,
    GraspPlan,
    Refusal,
    TopGrasp,
    palm_pose,
)
from drake_srg.planning.grasps.wrap_judge import WrapJudge
from drake_srg.types import Failure, HeightMap, Vector, positive


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


@dc.dataclass(kw_only=True)
class TopGraspConfig(GraspJudgeConfig):
    """How grasps are searched for. Lengths in m."""

    # Points that are tried: about this many in all, and at least so many of each thing.
    points: int = dc.field(default=150, metadata={"ge": 1})
    points_per_thing: int = dc.field(default=16, metadata={"ge": 1})
    # Directions of closing at each point.
    yaws: int = dc.field(default=18, metadata={"ge": 2})
    # Candidates that are centered, turned a little and judged again on finer samples.
    kept: int = dc.field(default=120, metadata={"ge": 1})
    # Grasps of a plan, at most.
    grasps: int = dc.field(default=40, metadata={"ge": 1})
    # Candidates that score less are not worth an attempt.
    least_score: float = 3.5
    # Grasps within this distance and angle [rad] of each other count as one; within
    # twice the distance of one that failed, they come last. Before them come those that
    # take something as wide and high of the same thing elsewhere.
    apart: float = dc.field(default=0.012, metadata=positive())
    turned: float = dc.field(default=0.35, metadata=positive())
    # A thing is at least this high, and this large as seen from above [m²].
    least_height: float = dc.field(default=0.004, metadata=positive())
    least_area: float = dc.field(default=6e-5, metadata=positive())


class TopGraspSearch(abc.ABC):
    """Judges places and directions on a height map, and explains what it refuses.

    All depths and openings are judged at once (see `PinchJudge`). The best are moved to
    where both pads touch at the same time, turned a little, and judged once more. What
    no pinch takes may be wrapped (`WrapJudge`).

    Args:
        fingers: The hand's.
        table: World z of the table [m].
        reach: Where the hand can be; None for everywhere.
        config: Numbers and thresholds; None for the defaults.
    """

    def __init__(
        self,
        fingers: Fingers,
        table: float,
        *,
        reach: Reach | None = None,
        config: TopGraspConfig | None = None,
    ) -> None:
        self._fingers, self._table, self._reach = fingers, table, reach
        self._config = config or TopGraspConfig()
        self._judge = PinchJudge(fingers, self._config)
        coarse = dc.replace(self._config, step=0.004, across=0.009)
        self._coarse = PinchJudge(fingers, coarse)
        wrap = fingers.wrap
        broad = dc.replace(self._config, across=0.009)
        self._wrap_judge = WrapJudge(fingers, wrap, broad) if wrap else None

    @abc.abstractmethod
    def proposals(self, relief: Relief, rng: Generator) -> tuple[Vector, Vector]:
        """Return where to judge pinches.

        Args:
            relief: What stands on the table, or a part of that.
            rng: For random draws.

        Returns:
            x, y of the palm's axis in world, shape (n, 2) [m], and directions of
            closing, shape (n,) [rad].
        """

    def relief(self, height_map: HeightMap) -> Relief:
        """Return what stands on the table according to a height map."""
        return Relief.of(
            height_map,
            self._table,
            least_height=self._config.least_height,
            least_area=self._config.least_area,
        )

    def plan(
        self, height_map: HeightMap, *, tried: Sequence[TopGrasp] = (), seed: int = 0
    ) -> GraspPlan:
        """See `GraspPlanner`."""
        relief = self.relief(height_map)
        if not relief.things:
            return GraspPlan()
        new, old = self._distinct(relief, self._pinches(relief, seed), tried)
        # Only what no pinch takes: wraps need a flat top and more room.
        wraps = self._wraps(relief, _not_taken(relief, new))
        new_wraps, old_wraps = self._distinct(relief, wraps, tried)
        grasps = (new + new_wraps + old + old_wraps)[: self._config.grasps]
        return GraspPlan(
            tuple(grasps),
            len(relief.things),
            lambda: self._refusals(relief, grasps, seed),
            relief.places,
            relief.beside_same,
        )

    def _refusals(
        self, relief: Relief, grasps: Sequence[TopGrasp], seed: int
    ) -> tuple[Refusal, ...]:
        """Return the things that no grasp takes."""
        return tuple(
            self._refuse(relief, thing, seed) for thing in _not_taken(relief, grasps)
        )

    def _pinches(self, relief: Relief, seed: int) -> list[TopGrasp]:
        """Return the best pinches, the best first."""
        found = self.allowed(relief, self._search(relief, seed))
        deepest = self._fingers.deepest
        return [self._grasp(row, deepest) for row in _rows(found)]

    def _wraps(self, relief: Relief, things: Sequence[Thing]) -> list[TopGrasp]:
        """Return wraps around some of the things, the best first."""
        judge, wrap = self._wrap_judge, self._fingers.wrap
        if judge is None or wrap is None:
            return []
        found = judge.judge(relief, *judge.places(relief, things))
        if self._reach is not None:
            found = found.take(np.flatnonzero(self._reach.contains(found.p_W)))
        found = judge.refine(relief, found.best(self._config.kept))
        rows = _rows(self.allowed(relief, found.best(self._config.kept)))
        grasps = [self._grasp(row, wrap.deepest) for row in rows]
        return [dc.replace(grasp, wrapped=True) for grasp in grasps]

    def allowed(self, relief: Relief, candidates: Candidates) -> Candidates:
        """Return those candidates that may be grasped."""
        return candidates

    def _search(self, relief: Relief, seed: int) -> Candidates:
        """Return the best pinches, the best first."""
        config = self._config
        p_W, yaw = self._within_reach(*self.proposals(relief, default_rng(seed)))
        first = self._coarse.judge(relief, p_W, yaw).best(3 * config.kept)
        first = self._coarse.refine(relief, first).best(config.kept)
        centered = first.p_W + (0.5 * (first.low + first.high))[:, None] * (
            first.direction
        )
        little = 0.5 * np.pi / config.yaws
        again = self._judge.judge(
            relief,
            *self._within_reach(
                np.repeat(centered, 3, axis=0),
                np.repeat(first.yaw, 3)
                + np.tile([-little, 0.0, little], len(centered)),
            ),
        )
        found = self._judge.refine(relief, again).best(3 * config.kept)
        return found.take(np.flatnonzero(found.score > config.least_score))

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
        width = high - low + self._config.step
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
        self, relief: Relief, grasps: Sequence[TopGrasp], tried: Sequence[TopGrasp]
    ) -> tuple[list[TopGrasp], list[TopGrasp]]:
        """Return grasps that differ, the best first: new ones, and like failed ones.

        Of those that are like failed ones, the ones at other places come first.
        """
        config = self._config
        near = [relief.labels_near(failed.p_WC, SAME_THING) for failed in tried]
        new: list[TopGrasp] = []
        alike: list[TopGrasp] = []
        old: list[TopGrasp] = []
        for grasp in grasps:
            found = new + alike + old
            if any(grasp.like(g, config.apart, config.turned) for g in found):
                continue
            label = relief.label_at(grasp.p_WC)
            if any(grasp.like(g, 2 * config.apart, config.turned) for g in tried):
                old.append(grasp)
            elif any(
                label in labels and grasp.takes_as_much(failed, ALIKE)
                for failed, labels in zip(tried, near, strict=True)
            ):
                alike.append(grasp)
            else:
                new.append(grasp)
            if len(new) >= config.grasps:
                break
        return new, alike + old

    def _takes(self, relief: Relief, seed: int) -> bool:
        """Return whether any grasp takes anything."""
        found = self._pinches(relief, seed) or self._wraps(relief, relief.things)
        return bool(found)

    def _anywhere(self) -> TopGraspSearch:
        """Return the same search without limits of reach."""
        search = copy.copy(self)
        search._reach = None
        return search

    def _refuse(self, relief: Relief, thing: Thing, seed: int) -> Refusal:
        """Return why there is no grasp of a thing."""
        points = relief.map.middles()[thing.cells[:, 0], thing.cells[:, 1]]
        if self._reach is not None and not self._reach.contains(points).any():
            failure = Failure.OUT_OF_REACH
        elif len(relief.things) > 1 and self._takes(relief.only(thing), seed):
            failure = Failure.BLOCKED
        elif self._reach is not None and self._anywhere()._takes(
            relief.only(thing), seed
        ):
            failure = Failure.OUT_OF_REACH
        elif thing.size[1] > self._fingers.max_width:
            failure = Failure.TOO_WIDE
        else:
            failure = Failure.NO_GRASP
        p_W = np.array([*thing.middle, self._table + thing.top])
        return Refusal(p_W, thing.size, failure)


def _not_taken(relief: Relief, grasps: Sequence[TopGrasp]) -> list[Thing]:
    """Return the things that no grasp takes."""
    taken: set[int] = set()
    for grasp in grasps:
        along = np.array([np.cos(grasp.yaw), np.sin(grasp.yaw)])
        offsets = np.linspace(-0.5, 0.5, 21)[:, None] * grasp.width * along
        cells = relief.map.cells(grasp.p_WC[:2] + offsets)
        inside = np.all((cells >= 0) & (cells < relief.labels.shape), axis=1)
        taken |= set(relief.labels[tuple(cells[inside].T)].tolist())
    return [thing for thing in relief.things if thing.label not in taken]


def _rows(candidates: Candidates) -> list[Candidates]:
    return [candidates.take(np.array([i])) for i in range(len(candidates.score))]
