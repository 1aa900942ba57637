"""Plans, corrections and escapes, from sightings."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.geometry import ConvexPieces
from drake_srg.planning.grasps.grasps import Grasp
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.pick_and_place.knowledge import PlannerMemory, Trouble
from drake_srg.planning.pick_and_place.sightings import (
    Sightings,
    View,
    distance,
    lean,
    middle_of,
    set_down_at,
    standing_at,
)
from drake_srg.planning.pick_and_place.task_motions import (
    Obstacles,
    TaskMotions,
    TaskPlanner,
)
from drake_srg.planning.planner_machine import (
    SEARCH_PERIOD,
    PlannerConfig,
    planning_clock,
)
from drake_srg.types import AnyMode, Blob, Failure, Mode, Sphere, Vector

# An object seen farther than this from where the motions expect it has moved [m],
# [rad]. This exceeds the error of the localisation. Closing fingers can still
# compensate it.
_MOVED, _TURNED = 0.003, np.deg2rad(5.0)
# An object seen farther than this from its place in the hand is not in the hand [m].
_LOST = 0.03
_ORDER: dict[AnyMode, int] = {mode: i for i, mode in enumerate(Mode)}  # in a cycle
_STANDING = np.deg2rad(5.0)  # greatest lean of an object that stands on its goal


class Replanner:
    """Plans with a task planner from sightings of one object.

    It has no state of its own: its methods change the planner's memory.

    Args:
        task_planner: Plans the motions.
        sightings: Finds the task's objects in views.
        config: Times and distances.
    """

    def __init__(
        self,
        task_planner: TaskPlanner,
        sightings: Sightings,
        config: PlannerConfig,
    ) -> None:
        self._task_planner = task_planner
        self._sightings, self._task = sightings, sightings.task
        self._shape = self._task.shape
        self._config = config

    def goal(self, memory: PlannerMemory) -> RigidTransform:
        """Return the goal of this cycle, for the object as it was last seen."""
        return memory.seen.X_WO_goal or self._upright_goal(memory)

    def _upright_goal(self, memory: PlannerMemory) -> RigidTransform:
        """Return the upright pose after this cycle: the goal, or the first place."""
        back = memory.seen.X_WO_return if memory.totals.cycles % 2 else None
        return back or self._task.goal

    def find(self, view: View) -> Blob | None:
        """Return the most trustworthy sighting of the object, or None."""
        return self._sightings.best(view, self._rests)

    def judge(self, view: View, memory: PlannerMemory, time: float) -> None:
        """Check that the object is on the goal of this cycle."""
        blob, goal = self.find(view), self.goal(memory)
        _look(memory, view, blob, time)
        memory.attempt.at_goal = False
        if blob is not None:
            X_WO = self._sightings.pose(blob)
            near = distance(X_WO, goal, self._shape) <= self._task.tolerance
            memory.attempt.at_goal = near and self._turn(X_WO, goal) <= _STANDING

    def plan(
        self,
        view: View,
        memory: PlannerMemory,
        time: float,
        travel: Vector | None = None,
    ) -> None:
        """Look for the object, and plan the whole cycle from the arm's position.

        Args:
            view: Present view.
            memory: The planner's memory.
            time: Present time [s].
            travel: Displacement of the object until the hand arrives, shape (3,) [m];
                None: it rests.
        """
        blob, attempt = self.find(view), memory.attempt
        _look(memory, view, blob, time)
        attempt.next_look = np.inf
        if blob is None:
            message = f"no {self._task.object_name} in any image"
            self._miss_object(memory, time, message)
            return
        q, X_WO = memory.motion.q_rest, self._sightings.pose(blob)
        if travel is not None:
            X_WO = RigidTransform(X_WO.rotation(), X_WO.translation() + travel)
        with planning_clock.running():
            memory.seen.X_WO_goal = set_down_at(
                self._upright_goal(memory), X_WO, self._shape
            )
            p_WO = self._sightings.middle(blob)
            obstacles = self._obstacles(view, memory, q, memory.grip.fingers_open, p_WO)
            result = self._task_planner.plan(
                q, X_WO, self._shape, self.goal(memory), obstacles, memory.cycle.tried
            )
        self._take_time(memory, time)
        memory.seen.obstacles = obstacles
        if isinstance(result, PlanningFailure):
            _fail(memory, result.failure, result.message)
            # There may be a plan from home even if there is none from here.
            if not self._at_home(q):
                self.escape(memory, time)
            return
        if memory.seen.localization is None:
            memory.seen.localization, memory.seen.localized_at = blob, time
            memory.seen.X_WO_return = standing_at(X_WO, self._shape)
        attempt.motions, attempt.X_WO = result, X_WO
        memory.trouble = Trouble()

    def wait(self, view: View, memory: PlannerMemory, time: float, place: str) -> None:
        """Schedule another look for an object that is not visible, or give up."""
        _look(memory, view, None, time)
        memory.attempt.next_look = np.inf
        self._miss_object(memory, time, f"no {self._task.object_name} in {place}")

    def _miss_object(self, memory: PlannerMemory, time: float, message: str) -> None:
        attempt = memory.attempt
        if time < attempt.began + self._config.search_time:
            attempt.next_look = time + SEARCH_PERIOD
            return
        _fail(memory, Failure.NOT_SEEN, message)
        attempt.ready_at = time
        if not self._at_home(memory.motion.q_rest):
            self.escape(memory, time)  # the arm may hide it

    def compare(self, view: View, memory: PlannerMemory, time: float) -> None:
        """Check that the object has not moved, and that the motions are still free."""
        blob = self.find(view)
        certain = blob if blob is not None and blob.certain else None
        _look(memory, view, certain, time)
        if memory.cycle.detours >= self._config.max_attempts:
            return  # if the object never stands still, try anyway
        motions, X_WO = memory.attempt.planned, memory.attempt.X_WO
        assert X_WO is not None, "motions are planned from a sighting"
        moved = False
        if view.obstacles:
            q, fingers = memory.motion.position(time), motions.grasp.fingers_open
            p_WO = X_WO @ middle_of(self._shape)
            if blob is not None:
                p_WO = self._sightings.middle(blob)
            obstacles = self._obstacles(view, memory, q, fingers, p_WO)
            moved = bool(self._obstruction(motions, Mode.PRE_GRASP, obstacles))
        if certain is not None and not moved:  # the hand may half hide an uncertain one
            X_WO_seen = self._sightings.pose(certain)
            far = distance(X_WO_seen, X_WO, self._shape) > _MOVED
            moved = far or self._turn(X_WO_seen, X_WO) > _TURNED
        if moved:  # abandon the approach
            memory.attempt.moved = True
            memory.cycle.detours += 1

    def correct(self, view: View, memory: PlannerMemory, time: float) -> None:
        """Find the object's pose in the hand, and plan the rest from there."""
        motions = memory.attempt.planned
        q, grasp = memory.motion.position(time), motions.grasp
        p_WO = self._task_planner.X_WG(q) @ grasp.p_GO
        # A similar object elsewhere may be seen better than this one, which the hand
        # half hides.
        blob = self._sightings.nearest(view, p_WO)
        certain = blob if blob is not None and blob.certain else None
        _look(memory, view, certain, time)
        if certain is not None:
            grasp = self._in_hand(grasp, certain, q)
            if np.linalg.norm(grasp.p_GO - motions.grasp.p_GO) > _LOST:
                memory.attempt.lost = True
                return
        elif not view.obstacles:
            return
        obstacles = memory.seen.obstacles
        if view.obstacles:
            obstacles = self._obstacles(view, memory, q, grasp.fingers_closed)
        with planning_clock.running():
            result = self._task_planner.plan_place(
                q, grasp, self._shape, self.goal(memory), obstacles
            )
        self._take_time(memory, time)
        memory.seen.obstacles = obstacles
        if not isinstance(result, PlanningFailure):
            rest = {**motions.motions, **result.motions}
            memory.attempt.motions = dc.replace(result, motions=rest)
        elif view.obstacles:  # without new ones, the old motions stay valid
            hit = self._obstruction(motions, Mode.TRANSFER, obstacles)
            if hit is not None:
                memory.trouble.failure = Failure.BLOCKED
                memory.trouble.message = hit

    def carry(self, memory: PlannerMemory, time: float) -> None:
        """Plan the rest of the cycle, with the arm at rest and the object held."""
        q, grasp = memory.motion.q_rest, memory.attempt.planned.grasp
        with planning_clock.running():
            result = self._task_planner.plan_carry(
                q, grasp, self._shape, self.goal(memory), memory.seen.obstacles
            )
        self._take_time(memory, time)
        if isinstance(result, PlanningFailure):
            _trap(memory, result)
        else:
            memory.attempt.motions = result

    def escape(self, memory: PlannerMemory, time: float) -> None:
        """Plan a retreat from here, and home; if there is none, the arm is trapped."""
        with planning_clock.running():
            escape = self._task_planner.plan_escape(
                memory.motion.q_rest, memory.grip.fingers_open, memory.seen.obstacles
            )
        self._take_time(memory, time)
        if isinstance(escape, PlanningFailure):
            _trap(memory, escape)
        else:
            memory.attempt.escape = escape

    def _take_time(self, memory: PlannerMemory, time: float) -> None:
        """Begin the simulated planning latency now."""
        memory.attempt.ready_at = time + self._config.latency

    def _turn(self, X_1: RigidTransform, X_2: RigidTransform) -> float:
        """Return the angle between the object's axis in two poses [rad].

        It is 0 for a solid of several pieces, whose look-alike poses may have different
        axes.
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
        """Return the obstacles seen now, and earlier ones that the arm may now hide."""
        seen = self._sightings.obstacles(view, p_WO)
        if seen:
            seen = self._task_planner.others(q, fingers, seen)
        return seen if self._at_home(q) else (*memory.seen.obstacles, *seen)

    def _obstruction(
        self, task: TaskMotions, mode: AnyMode, obstacles: Obstacles
    ) -> str | None:
        """Describe the obstacle to the motions that follow `mode`."""
        rest = {m: t for m, t in task.motions.items() if _ORDER[m] > _ORDER[mode]}
        task = dc.replace(task, motions=rest)
        return self._task_planner.obstruction(task, self._shape, obstacles)

    def _in_hand(self, grasp: Grasp, blob: Blob, q: Vector) -> Grasp:
        """Return the grasp as it is seen with the arm at `q`."""
        X_GW = self._task_planner.X_WG(q).inverse()
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


def _look(memory: PlannerMemory, view: View, used: Blob | None, time: float) -> None:
    """Record a look, and the blob that the planner uses, if any."""
    memory.attempt.looked = True
    memory.totals.looks += 1
    memory.seen.blobs = tuple(view.blobs)
    if used is not None:
        memory.seen.latest, memory.seen.latest_at = used, time


def _trap(memory: PlannerMemory, why: PlanningFailure) -> None:
    """Record that the arm has no escape."""
    memory.attempt.trapped = True
    memory.trouble.failure = memory.trouble.failure or why.failure
    memory.trouble.message = why.message


def _fail(memory: PlannerMemory, failure: Failure, message: str) -> None:
    """Record a failure, unless there is one already.

    The earlier one is more specific, such as a dropped object.
    """
    if memory.trouble.failure is None:
        memory.trouble.failure, memory.trouble.message = failure, message
