"""Plans, corrections and ways out, from what the planner sees."""

from __future__ import annotations

import dataclasses as dc
import time as wall
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import ConvexPieces
from drake_srg.planning.grasps.grasps import Grasp
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.planning.task.planner_memory import PlannerMemory, Trouble
from drake_srg.planning.task.sightings import (
    Sightings,
    View,
    distance,
    lean,
    middle_of,
    set_down_at,
    standing_at,
)
from drake_srg.planning.task.task_motions import Obstacles, TaskMotions, TaskPlanner
from drake_srg.types import Blob, Failure, Mode, Sphere, Vector

# An object seen this far from where the motions take it has moved [m], [rad]: more than
# the localisation may be off, and what fingers that close on it still make up for.
_MOVED, _TURNED = 0.003, np.deg2rad(5.0)
# An object seen further than this from its place in the hand is not in it [m].
_LOST = 0.03
_ORDER = {mode: i for i, mode in enumerate(Mode)}  # of a cycle
_STANDING = np.deg2rad(5.0)  # lean of an object that counts as standing on its goal


class Replanner:
    """Plans with a task planner from sightings of one object.

    It holds nothing between calls: its methods take the planner's memory and return
    the next.

    Args:
        task_planner: Plans the motions.
        sightings: Reads blobs.
        goal: Where the object must go, X_WO [m].
        tolerance: Distance from the goal that counts as placed [m].
        config: Times and distances.
    """

    def __init__(
        self,
        task_planner: TaskPlanner,
        sightings: Sightings,
        goal: RigidTransform,
        tolerance: float,
        config: PlannerConfig,
    ) -> None:
        self._task_planner = task_planner
        self._sightings = sightings
        self._shape = sightings.shape
        self._goal = goal
        self._tolerance = tolerance
        self._config = config

    def goal(self, memory: PlannerMemory) -> RigidTransform:
        """Return where this cycle takes the object, as it was seen last."""
        return memory.seen.X_WO_goal or self._upright_goal(memory)

    def _upright_goal(self, memory: PlannerMemory) -> RigidTransform:
        """Return where the object stands after this cycle: on the goal, or back."""
        back = memory.seen.X_WO_return if memory.totals.cycles % 2 else None
        return back or self._goal

    def judge(self, view: View, memory: PlannerMemory, time: float) -> PlannerMemory:
        """See whether the object is where this cycle was to take it."""
        blob, goal = self._sightings.best(view, self._rests), self.goal(memory)
        at_goal = False
        if blob is not None:
            X_WO = self._sightings.pose(blob)
            near = distance(X_WO, goal, self._shape) <= self._tolerance
            at_goal = near and self._turn(X_WO, goal) <= _STANDING
        return _looked(memory, view, blob, time, at_goal=at_goal)

    def plan(self, view: View, memory: PlannerMemory, time: float) -> PlannerMemory:
        """Look for the object, and plan the whole cycle from where the arm is."""
        blob = self._sightings.best(view, self._rests)
        memory = _looked(memory, view, blob, time, next_look=np.inf)
        if blob is None:
            return self._not_seen(memory, time)
        start, q = wall.perf_counter(), memory.motion.q_rest
        X_WO = self._sightings.pose(blob)
        goal = set_down_at(self._upright_goal(memory), X_WO, self._shape)
        memory = dc.replace(memory, seen=dc.replace(memory.seen, X_WO_goal=goal))
        p_WO = self._sightings.middle(blob)
        obstacles = self._obstacles(view, memory, q, memory.grip.fingers_open, p_WO)
        result = self._task_planner.plan(
            q, X_WO, self._shape, self.goal(memory), obstacles, memory.cycle.tried
        )
        memory = self._planned(memory, start, time, obstacles)
        if isinstance(result, PlanningFailure):
            memory = _failed(memory, result.failure, result.message)
            # There may be a plan from home even if there is none from here.
            return memory if self._at_home(q) else self.escape(memory, time)
        seen = memory.seen
        if seen.localization is None:
            seen = dc.replace(
                seen,
                localization=blob,
                localized_at=time,
                X_WO_return=standing_at(X_WO, self._shape),
            )
        return dc.replace(
            memory,
            attempt=dc.replace(memory.attempt, motions=result, X_WO=X_WO),
            seen=seen,
            trouble=Trouble(),
        )

    def _not_seen(self, memory: PlannerMemory, time: float) -> PlannerMemory:
        attempt = memory.attempt
        if time < attempt.began + self._config.search_time:
            next_look = time + self._config.search_period
            attempt = dc.replace(attempt, next_look=next_look)
            return dc.replace(memory, attempt=attempt)
        message = f"no {self._sightings.object_name} in any image"
        memory = _failed(memory, Failure.NOT_SEEN, message)
        memory = dc.replace(memory, attempt=dc.replace(attempt, ready_at=time))
        if self._at_home(memory.motion.q_rest):
            return memory
        return self.escape(memory, time)  # the arm may hide it

    def compare(self, view: View, memory: PlannerMemory, time: float) -> PlannerMemory:
        """See whether the object is still where the motions take it, and they free."""
        blob = self._sightings.best(view, self._rests)
        certain = blob if blob is not None and blob.certain else None
        memory = _looked(memory, view, certain, time)
        if memory.cycle.detours >= self._config.max_attempts:
            return memory  # an object that never stands still must be tried as it is
        motions, X_WO = memory.attempt.planned, memory.attempt.X_WO
        assert X_WO is not None, "motions are planned from a sighting"
        if view.obstacles:
            q, fingers = memory.motion.position(time), motions.grasp.fingers_open
            p_WO = X_WO @ middle_of(self._shape)
            if blob is not None:
                p_WO = self._sightings.middle(blob)
            obstacles = self._obstacles(view, memory, q, fingers, p_WO)
            if self._obstruction(motions, Mode.PRE_GRASP, obstacles):
                return _detour(memory)
        if certain is None:  # behind the hand
            return memory
        X_WO_seen = self._sightings.pose(certain)
        far = distance(X_WO_seen, X_WO, self._shape) > _MOVED
        moved = far or self._turn(X_WO_seen, X_WO) > _TURNED
        return _detour(memory) if moved else memory

    def correct(self, view: View, memory: PlannerMemory, time: float) -> PlannerMemory:
        """See where the object is in the hand, and plan the rest from there."""
        motions = memory.attempt.planned
        q, grasp = memory.motion.position(time), motions.grasp
        p_WO = self._task_planner.scene.X_WG(q) @ grasp.p_GO
        # What looks like it elsewhere may be seen better than what the hand half hides.
        blob = self._sightings.nearest(view, p_WO)
        certain = blob if blob is not None and blob.certain else None
        memory = _looked(memory, view, certain, time)
        attempt = memory.attempt
        if certain is not None:
            grasp = self._in_hand(grasp, certain, q)
            if np.linalg.norm(grasp.p_GO - motions.grasp.p_GO) > _LOST:
                return dc.replace(memory, attempt=dc.replace(attempt, lost=True))
        elif not view.obstacles:
            return memory
        obstacles = memory.seen.obstacles
        if view.obstacles:
            obstacles = self._obstacles(view, memory, q, grasp.fingers_closed)
        start = wall.perf_counter()
        result = self._task_planner.plan_place(
            q, grasp, self._shape, self.goal(memory), obstacles
        )
        memory = self._planned(memory, start, time, obstacles)
        if isinstance(result, PlanningFailure):
            hit = None
            if view.obstacles:
                hit = self._obstruction(motions, Mode.TRANSFER, obstacles)
            if hit is None:
                return memory  # with the motions as they were
            trouble = dc.replace(memory.trouble, failure=Failure.BLOCKED, message=hit)
            return dc.replace(memory, trouble=trouble)
        rest = {**motions.motions, **result.motions}
        corrected = dc.replace(result, motions=rest)
        return dc.replace(memory, attempt=dc.replace(memory.attempt, motions=corrected))

    def carry(self, memory: PlannerMemory, time: float) -> PlannerMemory:
        """Plan the rest of the cycle from where the arm rests with the object held."""
        start, obstacles = wall.perf_counter(), memory.seen.obstacles
        q, grasp = memory.motion.q_rest, memory.attempt.planned.grasp
        result = self._task_planner.plan_carry(
            q, grasp, self._shape, self.goal(memory), obstacles
        )
        memory = self._planned(memory, start, time, obstacles)
        if isinstance(result, PlanningFailure):
            return _trapped(memory, result)
        return dc.replace(memory, attempt=dc.replace(memory.attempt, motions=result))

    def escape(self, memory: PlannerMemory, time: float) -> PlannerMemory:
        """Plan back from where the arm is, and home; else the arm is trapped."""
        start = wall.perf_counter()
        escape = self._task_planner.plan_escape(
            memory.motion.q_rest, memory.grip.fingers_open, memory.seen.obstacles
        )
        memory = self._planned(memory, start, time, memory.seen.obstacles)
        if isinstance(escape, PlanningFailure):
            return _trapped(memory, escape)
        return dc.replace(memory, attempt=dc.replace(memory.attempt, escape=escape))

    def _planned(
        self, memory: PlannerMemory, start: float, time: float, obstacles: Obstacles
    ) -> PlannerMemory:
        """Return the memory with the time since `start` [s, wall clock] accounted."""
        totals = memory.totals
        spent = totals.planning_wall + wall.perf_counter() - start
        ready_at = time + self._config.latency
        return dc.replace(
            memory,
            attempt=dc.replace(memory.attempt, ready_at=ready_at),
            totals=dc.replace(totals, planning_wall=spent),
            seen=dc.replace(memory.seen, obstacles=obstacles),
        )

    def _turn(self, X_1: RigidTransform, X_2: RigidTransform) -> float:
        """Return the angle between the object's axis in two poses [rad].

        That of a solid does not count: what looks alike may have another one.
        """
        if isinstance(self._shape, ConvexPieces):
            return 0.0
        return lean(X_1.rotation().col(2), X_2.rotation().col(2))

    def _rests(self, X_WO: RigidTransform) -> bool:
        return self._task_planner.rests(self._shape, X_WO)

    def _at_home(self, q: Vector) -> bool:
        return np.allclose(q, self._task_planner.q_home, atol=1e-6)

    def _obstacles(
        self,
        view: View,
        memory: PlannerMemory,
        q: Vector,
        fingers: Mapping[str, float],
        p_WO: Vector | None = None,
    ) -> Obstacles:
        """Return what is seen now, and earlier where the arm may hide it now."""
        seen = self._sightings.obstacles(view, p_WO)
        if seen:
            seen = self._task_planner.others(q, fingers, seen)
        return seen if self._at_home(q) else (*memory.seen.obstacles, *seen)

    def _obstruction(
        self, task: TaskMotions, mode: Mode, obstacles: Obstacles
    ) -> str | None:
        """Return what is in the way of the motions after that of `mode`, in words."""
        rest = {m: t for m, t in task.motions.items() if _ORDER[m] > _ORDER[mode]}
        task = dc.replace(task, motions=rest)
        return self._task_planner.obstruction(task, self._shape, obstacles)

    def _in_hand(self, grasp: Grasp, blob: Blob, q: Vector) -> Grasp:
        """Return the grasp as it is seen with the arm at `q`."""
        X_GW = self._task_planner.scene.X_WG(q).inverse()
        if isinstance(self._shape, ConvexPieces):
            seen = X_GW @ self._sightings.middle(blob)
            shift = seen - grasp.X_GO @ self._shape.middle
            return dc.replace(grasp, p_GO=grasp.p_GO + shift)
        grasp = dc.replace(grasp, p_GO=X_GW @ blob.position)
        if isinstance(self._shape, Sphere):
            return grasp
        axis_G = X_GW.rotation() @ blob.axis
        axis_G = np.copysign(1.0, axis_G @ grasp.axis_G) * axis_G
        return dc.replace(grasp, axis_G=axis_G)


def _looked(
    memory: PlannerMemory, view: View, used: Blob | None, time: float, **noticed: Any
) -> PlannerMemory:
    """Return the memory after a look: the blob used, if any, and what was noticed."""
    seen = dc.replace(memory.seen, blobs=tuple(view.blobs))
    if used is not None:
        seen = dc.replace(seen, latest=used, latest_at=time)
    totals = dc.replace(memory.totals, looks=memory.totals.looks + 1)
    attempt = dc.replace(memory.attempt, looked=True, **noticed)
    return dc.replace(memory, attempt=attempt, totals=totals, seen=seen)


def _trapped(memory: PlannerMemory, why: PlanningFailure) -> PlannerMemory:
    """Return the memory of an arm that has no way out."""
    failure = memory.trouble.failure or why.failure
    trouble = dc.replace(memory.trouble, failure=failure, message=why.message)
    attempt = dc.replace(memory.attempt, trapped=True)
    return dc.replace(memory, attempt=attempt, trouble=trouble)


def _detour(memory: PlannerMemory) -> PlannerMemory:
    """Return the memory of an approach that is broken off."""
    cycle = dc.replace(memory.cycle, detours=memory.cycle.detours + 1)
    attempt = dc.replace(memory.attempt, moved=True)
    return dc.replace(memory, attempt=attempt, cycle=cycle)


def _failed(memory: PlannerMemory, failure: Failure, message: str) -> PlannerMemory:
    """Return the memory with a failure, unless there is one that says more.

    That is what became of an object that was in the hand.
    """
    trouble = memory.trouble
    if trouble.failure is not None:
        return memory
    trouble = dc.replace(trouble, failure=failure, message=message)
    return dc.replace(memory, trouble=trouble)
