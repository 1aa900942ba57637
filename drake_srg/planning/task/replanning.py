"""What the planner makes of what it sees: plans, corrections, ways out."""

from __future__ import annotations

import dataclasses as dc
import time as wall
from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.planning.grasps.grasps import Grasp
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.planning.task.planner_memory import PlannerMemory
from drake_srg.planning.task.sightings import (
    Sightings,
    View,
    lean,
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

    Nothing is kept here: every method takes the planner's memory and returns the next.

    Args:
        task_planner: Plans the motions.
        sightings: Reads blobs.
        goal: Where the object shall be, X_WO [m].
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
        """Where this cycle shall take the object: there, or back."""
        back = memory.X_WO_return if memory.cycles % 2 else None
        return back or self._goal

    def is_at_goal(self, view: View, memory: PlannerMemory) -> bool:
        """Whether the object is seen where this cycle shall take it."""
        blob, goal = self._sightings.best(view, self._rests), self.goal(memory)
        if blob is None:
            return False
        X_WO = self._sightings.pose(blob)
        turn = lean(X_WO.rotation().col(2), goal.rotation().col(2))
        return distance(X_WO, goal) <= self._tolerance and turn <= _STANDING

    def plan(self, view: View, memory: PlannerMemory, time: float) -> PlannerMemory:
        """Look for the object, and plan the whole cycle from where the arm is."""
        blob = self._sightings.best(view, self._rests)
        memory = dc.replace(memory, looks=memory.looks + 1)
        if blob is None:
            return self._not_seen(memory, time)
        start = wall.perf_counter()
        X_WO = self._sightings.pose(blob)
        obstacles = self._obstacles(
            view, memory, memory.q_rest, memory.fingers, blob.position
        )
        result = self._task_planner.plan(
            memory.q_rest,
            X_WO,
            self._shape,
            self.goal(memory),
            obstacles,
            memory.tried,
        )
        memory = dc.replace(
            memory,
            planning_wall=memory.planning_wall + wall.perf_counter() - start,
            next_look=np.inf,
            ready_at=time + self._config.latency,
            obstacles=obstacles,
        )
        if isinstance(result, PlanningFailure):
            # What became of an object that was in the hand says more.
            if memory.failure is None:
                memory = dc.replace(
                    memory, failure=result.failure, message=result.message
                )
            # There may be a way from home where there is none from here.
            return memory if self._at_home(memory.q_rest) else self.escape(memory, time)
        if memory.localization is None:
            memory = dc.replace(
                memory,
                localization=blob,
                localized_at=time,
                X_WO_return=standing_at(X_WO, self._shape),
            )
        return dc.replace(memory, motions=result, X_WO=X_WO, failure=None, message="")

    def _not_seen(self, memory: PlannerMemory, time: float) -> PlannerMemory:
        if time < memory.since + self._config.search_time:
            return dc.replace(memory, next_look=time + self._config.search_period)
        memory = dc.replace(
            memory,
            # What became of an object that was in the hand says more.
            failure=memory.failure or Failure.NOT_SEEN,
            message=memory.message or f"no {self._sightings.object_name} in any image",
            next_look=np.inf,
            ready_at=time,
        )
        # The arm may hide it.
        return memory if self._at_home(memory.q_rest) else self.escape(memory, time)

    def _rests(self, X_WO: RigidTransform) -> bool:
        return self._task_planner.rests(self._shape, X_WO)

    def _obstacles(
        self,
        view: View,
        memory: PlannerMemory,
        q: Vector,
        fingers: Mapping[str, float],
        p_WO: Vector | None = None,
    ) -> Obstacles:
        """What stands about: seen now, or earlier where the arm may hide it now."""
        seen = self._sightings.obstacles(view, p_WO)
        if seen:
            seen = self._task_planner.others(q, fingers, seen)
        return seen if self._at_home(q) else (*memory.obstacles, *seen)

    def _at_home(self, q: Vector) -> bool:
        return np.allclose(q, self._task_planner.q_home, atol=1e-6)

    def compare(self, view: View, memory: PlannerMemory, time: float) -> PlannerMemory:
        """See whether the object is still where the motions take it, and they free."""
        blob, X_WO = self._sightings.best(view, self._rests), memory.X_WO
        memory = dc.replace(memory, looks=memory.looks + 1, looked=True)
        if memory.detours >= self._config.max_attempts:
            return memory  # what never stands still has to be tried
        motions = memory.motions
        if view.obstacles and motions is not None and X_WO is not None:
            q, fingers = memory.position(time), motions.grasp.fingers_open
            p_WO = X_WO.translation() if blob is None else blob.position
            obstacles = self._obstacles(view, memory, q, fingers, p_WO)
            if self._obstruction(motions, memory.mode, obstacles):
                return dc.replace(memory, moved=True, detours=memory.detours + 1)
        if blob is None or X_WO is None or not blob.certain:  # behind the hand
            return memory
        X_WO_seen = self._sightings.pose(blob)
        turn = lean(X_WO_seen.rotation().col(2), X_WO.rotation().col(2))
        moved = distance(X_WO_seen, X_WO) > _MOVED or turn > _TURNED
        return dc.replace(memory, moved=moved, detours=memory.detours + moved)

    def _obstruction(
        self, task: TaskMotions, mode: Mode, obstacles: Obstacles
    ) -> str | None:
        """What is in the way of the motions that follow those of `mode`."""
        rest = {m: t for m, t in task.motions.items() if _ORDER[m] > _ORDER[mode]}
        task = dc.replace(task, motions=rest)
        return self._task_planner.obstruction(task, self._shape, obstacles)

    def correct(self, view: View, memory: PlannerMemory, time: float) -> PlannerMemory:
        """See where the object is in the hand, and plan the rest from there."""
        memory = dc.replace(memory, looks=memory.looks + 1, looked=True)
        motions = memory.motions
        if motions is None:
            return memory
        q, grasp = memory.position(time), motions.grasp
        p_WO = self._task_planner.scene.X_WG(q) @ grasp.p_GO
        # What looks like it elsewhere may be seen better than what the hand half hides.
        blob = self._sightings.nearest(view, p_WO)
        if blob is not None and blob.certain:
            grasp = self._in_hand(grasp, blob, q)
            if np.linalg.norm(grasp.p_GO - motions.grasp.p_GO) > _LOST:
                return dc.replace(memory, lost=True)
        elif not view.obstacles:
            return memory
        obstacles = memory.obstacles
        if view.obstacles:
            obstacles = self._obstacles(view, memory, q, grasp.fingers_closed)
        start = wall.perf_counter()
        result = self._task_planner.plan_place(
            q, grasp, self._shape, self.goal(memory), obstacles
        )
        memory = dc.replace(
            memory,
            planning_wall=memory.planning_wall + wall.perf_counter() - start,
            ready_at=time + self._config.latency,
            obstacles=obstacles,
        )
        if isinstance(result, PlanningFailure):
            hit = None
            if view.obstacles:
                hit = self._obstruction(motions, memory.mode, obstacles)
            if hit is None:
                return memory  # with the motions as they were
            return dc.replace(memory, failure=Failure.BLOCKED, message=hit)
        rest = {**motions.motions, **result.motions}
        return dc.replace(memory, motions=dc.replace(result, motions=rest))

    def _in_hand(self, grasp: Grasp, blob: Blob, q: Vector) -> Grasp:
        """The grasp as it is seen with the arm at `q`."""
        X_GW = self._task_planner.scene.X_WG(q).inverse()
        grasp = dc.replace(grasp, p_GO=X_GW @ blob.position)
        if isinstance(self._shape, Sphere):
            return grasp
        axis_G = X_GW.rotation() @ blob.axis
        axis_G = np.copysign(1.0, axis_G @ grasp.axis_G) * axis_G
        return dc.replace(grasp, axis_G=axis_G)

    def escape(self, memory: PlannerMemory, time: float) -> PlannerMemory:
        """Plan back from where the arm is, and home."""
        start = wall.perf_counter()
        escape = self._task_planner.plan_escape(
            memory.q_rest, memory.fingers, memory.obstacles
        )
        memory = dc.replace(
            memory,
            planning_wall=memory.planning_wall + wall.perf_counter() - start,
            ready_at=time + self._config.latency,
            next_look=np.inf,
        )
        if isinstance(escape, PlanningFailure):
            return dc.replace(memory, mode=Mode.FAILED, message=escape.message)
        return dc.replace(memory, escape=escape)


def distance(X_1: RigidTransform, X_2: RigidTransform) -> float:
    """Distance between the origins of two poses [m]."""
    return float(np.linalg.norm(X_1.translation() - X_2.translation()))
