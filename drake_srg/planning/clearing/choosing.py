"""Chooses the next pick and its destination from a height map."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.destination import Destination
from drake_srg.planning.clearing.knowledge import ClearingMemory, Pick
from drake_srg.planning.clearing.maps import has_gone, lowest
from drake_srg.planning.clearing.motions import ClearingMotions
from drake_srg.planning.clearing.pushing import Push, PushMotions
from drake_srg.planning.grasps.scoring import Candidates
from drake_srg.planning.grasps.segmentation import Segmentation, Thing, sides
from drake_srg.planning.grasps.top_grasps import (
    ALIKE,
    SAME_THING,
    GraspPlan,
    GraspPlanner,
    HeightMapGrasps,
    TopGrasp,
)
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.planner_machine import PlannerConfig, planning_clock
from drake_srg.types import Failure, HeightMap, LabeledHeightMap, Remaining, Vector

# Largest number of grasps whose motions are planned.
_MOST_GRASPS = 30
# Edges of things that stick out of a bin flicker by this many cells.
_EDGES = np.ones((9, 9), np.uint8)


# Returns the label of a grasp's thing, -1 for none, and the motions to its destination;
# None to skip the grasp.
Route: TypeAlias = Callable[[TopGrasp, HeightMap], "tuple[int, ClearingMotions] | None"]


class PickPlanner:
    """Plans the next pick; keeps no state between calls.

    Args:
        grasps: Finds grasps in a height map.
        motions: Plans the motions of a grasp.
        config: Attempts and latency.
        pushes: Plans pushes if no grasp is left; None: nothing is pushed.
        q_aside: A posture high beside the destinations, in which the arm hides them
            from no camera, shape (N,) [rad]; None: home.
    """

    def __init__(
        self,
        grasps: GraspPlanner,
        motions: ClearingMotions,
        config: PlannerConfig,
        pushes: PushMotions | None = None,
        q_aside: Vector | None = None,
    ) -> None:
        self.grasps = grasps
        self.motions = motions
        self.pushes = pushes
        self.q_aside = motions.q_home if q_aside is None else q_aside
        self.config = config

    @property
    def destinations(self) -> tuple[Destination, ...]:
        """Destinations of loads."""
        return (self.motions.destination,)

    def route(
        self, grasp: TopGrasp, height_map: HeightMap
    ) -> tuple[int, ClearingMotions] | None:
        """Return the label of a grasp's thing, and the motions to its destination.

        Returns:
            The label, -1 for none, and the motions; None if the thing must stay.
        """
        return -1, self.motions

    def judge(self, memory: ClearingMemory, height_map: HeightMap) -> None:
        """Judge the pick under way by the map after it, and forget its plan.

        The planner looks in the bin even for a load that only the map or only the
        fingers noticed: among touching things, others may have moved. The pick has
        failed unless the load is seen.
        """
        pick, attempts = memory.planned, memory.attempts
        gone = has_gone(pick.height_map, height_map, pick.grasp.p_WC)
        felt = pick.held and gone
        if gone or pick.held:
            load = pick.load(height_map, felt=felt)
            again = memory.fell_out(pick, load.volume, height_map)
            if again:
                again = memory.loads.match_missed(load.destination, load.volume)
            memory.loads.add(dc.replace(load, again=again))
        if felt:
            attempts.pushed = ()
        else:
            attempts.tried = (*attempts.tried, pick.grasp)
        memory.pick, memory.view.latest = None, height_map

    def way_out(self, memory: ClearingMemory, pick: Pick) -> Trajectory | None:
        """Return the way up from where a load was laid in a bin; None without one.

        A hand that has set a thing down in a row goes up all the way, because no map
        shows the other things in the row.

        Args:
            memory: The planner's memory, with the arm at rest there.
            pick: The pick whose load was laid down.
        """
        into = pick.destination
        if into.rim is None:
            return None
        top = max(into.rim + pick.grasp.height, memory.loads.filled(into))
        palm = top + pick.grasp.fingers.deepest
        q, fingers = memory.motion.destination, memory.released.fingers
        up = self.motions.plan_up(q, fingers, palm)
        return None if isinstance(up, PlanningFailure) else up

    def plan_retreat(
        self, memory: ClearingMemory, q: Vector, fingers: Mapping[str, float]
    ) -> Trajectory | PlanningFailure:
        """Plan up and over the destination from where something has stopped the arm.

        Args:
            memory: The planner's memory.
            q: Posture of the arm, at rest, shape (N,) [rad].
            fingers: Angles of the open gripper's joints by name [rad].
        """
        return self.motions.plan_retreat(q, fingers)

    def give_up(self, memory: ClearingMemory) -> None:
        """Count the pick under way as failed, because something has stopped the arm."""
        grasp, attempts = memory.planned.grasp, memory.attempts
        attempts.tried = (*attempts.tried, grasp)
        attempts.stopped = (*attempts.stopped, grasp)
        memory.pick, memory.released.astray = None, True

    @planning_clock.running()
    def plan(self, memory: ClearingMemory, height_map: HeightMap, time: float) -> None:
        """Plan the next pick; finish if no grasp fits anything that is left.

        If no grasp is left, a heap is pushed first, at most `config.max_attempts`
        times.

        Args:
            memory: The planner's memory.
            height_map: Height map of the table now.
            time: Now [s].
        """
        view = memory.view
        view.latest = height_map = self._without_overhang(memory, height_map)
        found = self.grasps.plan(height_map, tried=memory.attempts.tried)
        pick, missed = self._next_pick(memory, found, height_map, time)
        memory.pick, memory.push, memory.left = pick, None, ()
        if pick is None:
            memory.push = self._next_push(memory, height_map, time)
            refused = [Remaining(r.p_W, r.failure) for r in found.refused]
            left = _distinct([*refused, *missed])
            memory.left = tuple(_named(found.places(SAME_THING), left))
        else:
            memory.first_seen_at = min(memory.first_seen_at, time)
        memory.finished = pick is None and memory.push is None
        # Nothing falls out of a bin before the first pick.
        if pick is not None or view.lowest is not None:
            view.lowest = lowest(height_map, view.lowest)

    def _next_pick(
        self,
        memory: ClearingMemory,
        found: GraspPlan,
        height_map: HeightMap,
        time: float,
    ) -> tuple[Pick | None, list[Remaining]]:
        """Return the next pick, and why better grasps were skipped; see `plan`."""
        return self._first_pick(self.route, memory, found, height_map, time)

    def _first_pick(
        self,
        route: Route,
        memory: ClearingMemory,
        found: GraspPlan,
        height_map: HeightMap,
        time: float,
    ) -> tuple[Pick | None, list[Remaining]]:
        """Return the first pick along a route, and why better grasps were skipped."""
        missed: list[Remaining] = []
        planned = 0
        # Grasps share bins, and reading the map of a bin takes tens of milliseconds.
        filled = functools.cache(memory.loads.filled)
        spots = functools.cache(memory.loads.spots)
        for grasp in found.grasps:
            if self._given_up(memory.attempts.tried, grasp, found):
                stuck = self._given_up(memory.attempts.stopped, grasp, found)
                why = Failure.STOPPED if stuck else Failure.NO_GRASP
                missed.append(Remaining(grasp.p_WC, why))
                continue
            if planned == _MOST_GRASPS:
                break
            way = route(grasp, height_map)
            if way is None:
                continue
            planned += 1
            label, there = way
            motions = there.plan(
                memory.departure,
                grasp,
                height_map,
                memory.attempts.picks,
                filled=filled(there.destination),
                spots=spots(there.destination),
            )
            if isinstance(motions, PlanningFailure):
                missed.append(Remaining(grasp.p_WC, motions.failure))
                continue
            ready_at = time + self.config.latency
            into = there.destination
            return Pick(grasp, motions, height_map, into, ready_at, label), missed
        return None, missed

    def _next_push(
        self, memory: ClearingMemory, height_map: HeightMap, time: float
    ) -> Push | None:
        """Return the next push; None if there is none, or enough were tried."""
        tried = memory.attempts.pushed
        if self.pushes is None or len(tried) >= self.config.max_attempts:
            return None
        push = self.pushes.plan(memory.departure, height_map, tried)
        return push and dc.replace(push, ready_at=time + self.config.latency)

    def _without_overhang(
        self, memory: ClearingMemory, height_map: HeightMap
    ) -> HeightMap:
        """Return a map of the table without what sticks out of the bins.

        Such things are in the bin: the hand would only take them out and drop them
        again.
        """
        seen = memory.loads.seen
        if seen is None:
            return height_map
        over = np.zeros(seen.height.shape, np.uint8)
        for destination in self.destinations:
            over |= destination.overhang(seen)
        over = np.asarray(cv2.dilate(over, _EDGES))
        cells = seen.cells(height_map.centers())
        known = np.all((cells >= 0) & (cells < over.shape), axis=-1)
        hidden = np.zeros(height_map.height.shape, bool)
        hidden[known] = over[tuple(cells[known].T)] > 0
        return dc.replace(
            height_map, height=np.where(hidden, np.nan, height_map.height)
        )

    def _given_up(
        self, tried: Iterable[TopGrasp], grasp: TopGrasp, found: GraspPlan
    ) -> bool:
        """Return whether as many similar grasps as allowed have failed there."""
        count = sum(
            _near(failed.p_WC, grasp.p_WC)
            or (
                failed.takes_as_much(grasp, ALIKE)
                # The thing may have moved a little since.
                and found.beside_same(grasp.p_WC, failed.p_WC, SAME_THING)
            )
            for failed in tried
        )
        return count >= self.config.max_attempts


def _near(p_1: Vector, p_2: Vector) -> bool:
    return bool(np.linalg.norm(p_1[:2] - p_2[:2]) < SAME_THING)


def _distinct(left: Iterable[Remaining]) -> list[Remaining]:
    """Return the first of the reasons for each place."""
    kept: list[Remaining] = []
    for other in left:
        if not any(_near(other.p_W, known.p_W) for known in kept):
            kept.append(other)
    return kept


def _named(places: Iterable[Vector], left: list[Remaining]) -> list[Remaining]:
    """Return the remaining things, plus unexplained places with the nearest reason.

    Things that touch each other count as one thing with one reason.
    """
    named = list(left)
    for p_W in places:
        if left and not any(_near(p_W, known.p_W) for known in named):
            nearest = min(left, key=lambda o: float(np.linalg.norm(o.p_W - p_W)))
            named.append(Remaining(p_W, nearest.failure))
    return named


# Labels are wrong at edges: this share of the cells between the fingers must agree.
_LEAST_SHARE = 0.8
_LEAST_HEIGHT = 0.004  # of a thing above the table [m]
# Points between the fingers: along the closing direction, and across it [m].
_ALONG, _ACROSS = np.linspace(0.0, 1.0, 13), np.array([-0.006, 0.0, 0.006])
_PER_GRASP = _ALONG.size * _ACROSS.size
# Least number of a thing's labelled cells: fewer belong to the edge of another thing.
_LEAST_CELLS = 15


def labels_between(
    height_map: HeightMap, table: float, low: Vector, high: Vector
) -> npt.NDArray[np.int8]:
    """Return the label of the thing between pads, -1 for none or for several.

    Args:
        height_map: A LabeledHeightMap.
        table: Height of the table [m].
        low: x, y of one pad, shape (n, 2) [m].
        high: x, y of the other pad, shape (n, 2) [m].
    """
    assert isinstance(height_map, LabeledHeightMap), "labels need a ThingLabeler"
    apart = (high - low)[:, None, None]
    along = low[:, None, None] + _ALONG[:, None, None] * apart
    normal = apart[..., ::-1] * [-1.0, 1.0] / np.linalg.norm(apart, axis=-1)[..., None]
    points = (along + _ACROSS[:, None] * normal).reshape(len(low), _PER_GRASP, 2)
    cells = height_map.cells(points)
    iy, ix = np.moveaxis(cells, -1, 0)
    ny, nx = height_map.height.shape
    inside = (iy >= 0) & (ix >= 0) & (iy < ny) & (ix < nx)
    iy, ix = np.where(inside, iy, 0), np.where(inside, ix, 0)
    on = inside & (np.nan_to_num(height_map.height[iy, ix]) > table + _LEAST_HEIGHT)
    found = np.where(on, height_map.label[iy, ix], -1)
    shares = [
        np.count_nonzero(found == i, axis=1) / np.maximum(on.sum(axis=1), 1)
        for i in range(len(height_map.names))
    ]
    best = np.argmax(shares, axis=0)
    clear = np.max(shares, axis=0) >= _LEAST_SHARE
    return np.asarray(np.where(clear, best, -1), np.int8)


def label_of(grasp: TopGrasp, height_map: HeightMap, table: float) -> int:
    """Return the label of a grasp's thing, -1 for none or for several."""
    y_W = grasp.X_WG.rotation().matrix()[:2, 1]
    reach = 0.5 * grasp.width * y_W
    low, high = (grasp.p_WC[:2] + side * reach for side in (-1.0, 1.0))
    return int(labels_between(height_map, table, low[None], high[None])[0])


class ChosenGrasps(HeightMapGrasps):
    """Finds grasps of labelled things only; everything else is an obstacle.

    Its maps are LabeledHeightMaps. For its arguments see `HeightMapGrasps`.
    """

    def segment(self, height_map: HeightMap) -> Segmentation:
        """Return what stands on the table, its labelled parts as things."""
        segments = super().segment(height_map)
        assert isinstance(height_map, LabeledHeightMap), "labels need a ThingLabeler"
        parts = []
        for thing in segments.things:
            labelled = height_map.label[thing.cells[:, 0], thing.cells[:, 1]] >= 0
            if np.count_nonzero(labelled) >= _LEAST_CELLS:
                parts.append(_part(segments, thing, thing.cells[labelled]))
        return dc.replace(segments, things=tuple(parts))

    def allowed(self, segments: Segmentation, candidates: Candidates) -> Candidates:
        """Return the candidates that close on a single labelled thing."""
        low, high = (
            candidates.p_W + side[:, None] * candidates.direction
            for side in (candidates.low, candidates.high)
        )
        label = labels_between(segments.map, self._table, low, high)
        return candidates.take(np.flatnonzero(label >= 0))


def _part(segments: Segmentation, thing: Thing, cells: npt.NDArray[np.intp]) -> Thing:
    """Return the part of a thing that consists of some of its cells."""
    heights = segments.above[cells[:, 0], cells[:, 1]].astype(float)
    points = segments.map.centers()[cells[:, 0], cells[:, 1]]
    middle = np.average(points, axis=0, weights=heights)
    size = sides(cells, segments.map.resolution)
    top = float(heights.max())
    return dc.replace(thing, cells=cells, middle=middle, size=size, top=top)


class ChoosingPlanner(PickPlanner):
    """Plans the next pick among labelled things, and carries each to its own place.

    Args:
        grasps: Finds grasps of labelled things.
        motions: For each label, motions to its place.
        names: The labels.
        required: Which labels are names of objects. The task fails if one of them has
            been neither seen nor taken when the planner is done.
        table: Height of the table [m].
        config: Attempts and latency.
        q_aside: See `PickPlanner`.
    """

    def __init__(
        self,
        grasps: GraspPlanner,
        motions: Sequence[ClearingMotions],
        names: Sequence[str],
        required: Sequence[bool],
        table: float,
        config: PlannerConfig,
        q_aside: Vector | None = None,
    ) -> None:
        super().__init__(grasps, motions[0], config, q_aside=q_aside)
        self._by_label, self._table = tuple(motions), table
        self._names, self._required = tuple(names), tuple(required)

    @property
    def destinations(self) -> tuple[Destination, ...]:
        """Destinations of loads, by label."""
        return tuple(motions.destination for motions in self._by_label)

    def route(
        self, grasp: TopGrasp, height_map: HeightMap
    ) -> tuple[int, ClearingMotions] | None:
        """Return the label of a grasp's thing, and the motions to its place."""
        label = label_of(grasp, height_map, self._table)
        return None if label < 0 else (label, self._by_label[label])

    def plan(self, memory: ClearingMemory, height_map: HeightMap, time: float) -> None:
        """Plan the next pick; fail if a required object has never been seen."""
        super().plan(memory, height_map, time)
        if not memory.finished:
            return
        assert isinstance(height_map, LabeledHeightMap)
        seen = {load.label for load in memory.loads.known if load.felt}
        seen |= set(np.unique(height_map.label).tolist())
        named = zip(self._names, self._required, strict=True)
        missing = [
            name
            for i, (name, required) in enumerate(named)
            if required and i not in seen
        ]
        if missing or not seen - {-1}:
            what = ", ".join(missing or self._names)
            memory.failure = Failure.NOT_SEEN
            memory.message = f"the cameras see no {what} on the table"
