"""Chooses what to pick next from a height map, and remembers what failed."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable

import cv2
import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.arriving import match_missed_load
from drake_srg.planning.clearing.clearing_memory import (
    ClearingMemory,
    Pick,
    PlannedPush,
)
from drake_srg.planning.clearing.clearing_motions import ClearingMotions
from drake_srg.planning.clearing.comparing import has_gone, lowest
from drake_srg.planning.clearing.destination import Destination
from drake_srg.planning.clearing.push_motions import PushMotions
from drake_srg.planning.grasps.top_grasp import (
    ALIKE,
    SAME_THING,
    GraspPlan,
    GraspPlanner,
    TopGrasp,
)
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.planner_machine import PlannerConfig, planning_clock
from drake_srg.types import Failure, HeightMap, Left, Vector

# Grasps whose motions are planned, at most.
_MOST_GRASPS = 30
# Edges of what sticks out of a bin flicker by so many cells.
_EDGES = np.ones((9, 9), np.uint8)


class PickPlanner:
    """Plans the next pick; holds nothing between calls.

    Args:
        grasps: Finds grasps in a height map.
        motions: Plans the motions of a grasp.
        config: Attempts and latency.
        pushes: Plans pushes where no grasp is left; None: nothing is pushed.
        q_aside: High beside where loads go, which the arm hides from no camera there,
            shape (N,) [rad]; None: home.
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
        """Where loads go."""
        return (self.motions.destination,)

    def motions_with(
        self, grasp: TopGrasp, height_map: HeightMap
    ) -> ClearingMotions | None:
        """Return the motions to where what a grasp takes must go; None if it stays."""
        return self.motions

    def judge(self, memory: ClearingMemory, height_map: HeightMap) -> ClearingMemory:
        """Judge the pick under way by the map after it, and forget its plan.

        What only the map or only the fingers tell of is looked for all the same: where
        things touch, others move. The pick has failed unless it is seen.
        """
        pick = memory.planned
        gone = has_gone(pick.height_map, height_map, pick.grasp.p_WC)
        again = pick.fell_out(memory, height_map)
        if again and (gone or pick.held):
            volume = pick.volume(height_map)
            memory, again = match_missed_load(memory, pick.destination, volume)
        memory = dc.replace(memory, pick=None, height_map=height_map)
        if not (pick.held and gone):
            looked_for = (gone or pick.held) and memory.destinations is not None
            drop = pick.drop(height_map, False, again) if looked_for else None
            return dc.replace(memory, tried=(*memory.tried, pick.grasp), drop=drop)
        memory = dc.replace(memory, taken=memory.taken + 1, pushed=())
        if memory.destinations is None:  # then to have taken it must do
            return dc.replace(memory, arrived=memory.arrived + (not again))
        return dc.replace(memory, drop=pick.drop(height_map, True, again))

    def way_out(self, memory: ClearingMemory, pick: Pick) -> Trajectory | None:
        """Return the way up from where a load was laid in a bin; None without one.

        A hand that has set a thing down in a row goes up all the way: the others that
        stand there are on no map.

        Args:
            memory: The planner's, with the arm at rest there.
            pick: What was laid down.
        """
        into = pick.destination
        if into.rim is None:
            return None
        top = max(into.rim + pick.grasp.height, memory.filled(into))
        palm = top + pick.grasp.fingers.deepest
        up = self.motions.plan_up(memory.motion.destination, memory.fingers, palm)
        return None if isinstance(up, PlanningFailure) else up

    def give_up(self, memory: ClearingMemory) -> ClearingMemory:
        """Count the pick under way as failed, because something has stopped the arm."""
        grasp = memory.planned.grasp
        return dc.replace(
            memory,
            pick=None,
            tried=(*memory.tried, grasp),
            stopped=(*memory.stopped, grasp),
            astray=True,
        )

    @planning_clock.running()
    def plan(
        self, memory: ClearingMemory, height_map: HeightMap, time: float
    ) -> ClearingMemory:
        """Plan the next pick; finish if no grasp takes anything that is left.

        A heap from which no grasp takes anything is pushed first, `config.max_attempts`
        times at most.

        Args:
            memory: The planner's.
            height_map: Of the table now.
            time: Now [s].
        """
        height_map = self._without_overhang(memory, height_map)
        found = self.grasps.plan(height_map, tried=memory.tried)
        q_start = memory.departure
        missed: list[Left] = []
        pick = None
        planned = 0
        for grasp in found.grasps:
            if self._given_up(memory.tried, grasp, found):
                stuck = self._given_up(memory.stopped, grasp, found)
                why = Failure.STOPPED if stuck else Failure.NO_GRASP
                missed.append(Left(grasp.p_WC, why))
                continue
            if planned == _MOST_GRASPS:
                break
            there = self.motions_with(grasp, height_map)
            if there is None:
                continue
            planned += 1
            motions = there.plan(
                q_start,
                grasp,
                height_map,
                memory.picks,
                filled=memory.filled(there.destination),
                spots=memory.spots(there.destination),
            )
            if isinstance(motions, PlanningFailure):
                missed.append(Left(grasp.p_WC, motions.failure))
                continue
            ready_at = time + self.config.latency
            pick = Pick(grasp, motions, height_map, there.destination, ready_at)
            break
        left: list[Left] = []
        push = None
        if pick is None:
            push = self._push(memory, height_map, time)
            refused = [Left(r.p_W, r.failure) for r in found.refused]
            left = _named(found.places(SAME_THING), _distinct([*refused, *missed]))
        # Nothing falls out of a bin before the first pick.
        known = memory.lowest_map
        return dc.replace(
            memory,
            pick=pick,
            height_map=height_map,
            push=push,
            finished=pick is None and push is None,
            lowest_map=lowest(height_map, known) if pick or known else None,
            first_seen_at=min(memory.first_seen_at, time if pick else np.inf),
            left=tuple(left),
        )

    def _without_overhang(
        self, memory: ClearingMemory, height_map: HeightMap
    ) -> HeightMap:
        """Return a map of the table without what sticks out of the bins.

        It is in the bin. A hand that took it there would only drop it again.
        """
        seen = memory.destinations
        if seen is None:
            return height_map
        over = np.zeros(seen.height.shape, np.uint8)
        for destination in self.destinations:
            over |= destination.overhang(seen)
        over = np.asarray(cv2.dilate(over, _EDGES))
        cells = seen.cells(height_map.middles())
        known = np.all((cells >= 0) & (cells < over.shape), axis=-1)
        hidden = np.zeros(height_map.height.shape, bool)
        hidden[known] = over[tuple(cells[known].T)] > 0
        return dc.replace(
            height_map, height=np.where(hidden, np.nan, height_map.height)
        )

    def _push(
        self, memory: ClearingMemory, height_map: HeightMap, time: float
    ) -> PlannedPush | None:
        """Return the next push; None if there is none, or enough were tried."""
        tried = memory.pushed
        if self.pushes is None or len(tried) >= self.config.max_attempts:
            return None
        found = self.pushes.plan(memory.departure, height_map, tried)
        if found is None:
            return None
        push, motions = found
        return PlannedPush(push, motions, time + self.config.latency)

    def _given_up(
        self, tried: Iterable[TopGrasp], grasp: TopGrasp, found: GraspPlan
    ) -> bool:
        """Return whether as many grasps as allowed have failed there, or alike."""
        count = sum(
            _near(failed.p_WC, grasp.p_WC)
            or (
                failed.takes_as_much(grasp, ALIKE)
                # It may have moved a little since.
                and found.beside_same(grasp.p_WC, failed.p_WC, SAME_THING)
            )
            for failed in tried
        )
        return count >= self.config.max_attempts


def _near(p_1: Vector, p_2: Vector) -> bool:
    return bool(np.linalg.norm(p_1[:2] - p_2[:2]) < SAME_THING)


def _distinct(left: Iterable[Left]) -> list[Left]:
    """Return the first of the reasons for each place."""
    kept: list[Left] = []
    for other in left:
        if not any(_near(other.p_W, known.p_W) for known in kept):
            kept.append(other)
    return kept


def _named(places: Iterable[Vector], left: list[Left]) -> list[Left]:
    """Return what is left with the nearest reason for all of the given places too.

    Things that touch each other count as one, and that has one reason.
    """
    named = list(left)
    for p_W in places:
        if left and not any(_near(p_W, known.p_W) for known in named):
            nearest = min(left, key=lambda o: float(np.linalg.norm(o.p_W - p_W)))
            named.append(Left(p_W, nearest.failure))
    return named
