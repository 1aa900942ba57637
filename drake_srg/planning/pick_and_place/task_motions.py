"""The motions of a pick and place, all planned at once from one sighting."""

from __future__ import annotations

import contextlib
import dataclasses as dc
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TypeAlias, TypeVar

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.common.geometry import Solid
from drake_srg.planning.grasps.grasps import (
    SUPPORT_OVERLAP,
    Candidate,
    Grasp,
    GraspSearch,
    Hand,
    carrying,
    place_target,
)
from drake_srg.planning.motion.arm_model import restores_fingers
from drake_srg.planning.motion.inverse_kinematics import HandTarget
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.paths import plan_cartesian_path
from drake_srg.planning.motion.planning_scene import (
    Clearance,
    NoPathError,
    PlanningFailure,
    PlanningScene,
    carried_drift,
    most_specific,
)
from drake_srg.planning.motion.trajectories import motion_samples
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.types import AnyMode, Failure, Mode, Vector, mode_name

_UP = np.array([0.0, 0.0, 1.0])
# Largest lean of a carried object, beyond its lean at the grasp [rad].
_UPRIGHT = 0.004
# Additional heights at which the object may be carried over things in its way [m].
_HIGHER = (0.0, 0.04, 0.08)


# Number of grasps whose motions are planned before giving up: each search for a path
# takes up to 5 s. There are more candidates only if the hand may turn about the object.
_MOST_CANDIDATES = 8


# Shapes to keep clear of, and their poses X_WO [m].
Obstacles: TypeAlias = Sequence[tuple[Solid, RigidTransform]]
_T = TypeVar("_T")


@dc.dataclass(frozen=True)
class TaskMotions:
    """A grasp and the motion of each mode that moves the arm."""

    grasp: Grasp
    motions: Mapping[AnyMode, Trajectory]


class TaskPlanner:
    """Plans picking and placing in a planning scene; keeps no state between calls.

    Private methods raise `NoPathError` instead of returning a failure.

    Args:
        scene: The arm, the gripper and their surroundings.
        hand: The grasps of that gripper.
        q_home: Home posture of the arm, shape (N,) [rad].
        config: Distances and speeds.
    """

    def __init__(
        self,
        scene: PlanningScene,
        hand: Hand,
        q_home: Vector,
        config: PlannerConfig,
    ) -> None:
        self.scene = scene
        self.hand = hand
        self.q_home = np.asarray(q_home, dtype=float)
        self.config = config
        self._moves = Moves(scene, hand.p_GT, config)
        self._search = GraspSearch(scene, hand, self.q_home, config.place_height)

    def X_WG(self, q: Vector) -> RigidTransform:
        """Return the hand's pose [m] with the arm at `q` (N,) [rad]."""
        return self.scene.X_WG(q)

    def plan(
        self,
        q_start: Vector,
        X_WO: RigidTransform,
        shape: Solid,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles = (),
        tried: Sequence[str] = (),
    ) -> TaskMotions | PlanningFailure:
        """Plan all motions: from `q_start` to the pick, to the goal, and home.

        Args:
            q_start: Posture of the arm, at rest, shape (N,) [rad].
            X_WO: The object's pose [m]. A round object's rotation about its axis is
                ignored.
            shape: The object's shape.
            X_WO_goal: Goal of the object [m].
            obstacles: Other objects and their poses [m].
            tried: Names of grasps that failed.
        """
        return self._among(
            obstacles, lambda: self._plan(q_start, X_WO, shape, X_WO_goal, tried)
        )

    def plan_carry(
        self,
        q_grasp: Vector,
        grasp: Grasp,
        shape: Solid,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles = (),
    ) -> TaskMotions | PlanningFailure:
        """Plan the motions of a hand that holds the object: lift, place, and go home.

        Args:
            q_grasp: Posture of the arm, at rest, shape (N,) [rad].
            grasp: The grasp.
            shape: The object's shape.
            X_WO_goal: Goal of the object [m].
            obstacles: Other objects and their poses [m].
        """
        return self._among(
            obstacles,
            lambda: TaskMotions(grasp, self._carry(q_grasp, grasp, shape, X_WO_goal)),
        )

    def plan_place(
        self,
        q_start: Vector,
        grasp: Grasp,
        shape: Solid,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles = (),
    ) -> TaskMotions | PlanningFailure:
        """Plan to set down an object that the hand holds above its goal, and go home.

        Args:
            q_start: Posture of the arm, at rest, shape (N,) [rad].
            grasp: The grasp, with the object's actual pose in the hand.
            shape: The object's shape.
            X_WO_goal: Goal of the object [m].
            obstacles: Other objects and their poses [m].
        """
        return self._among(
            obstacles,
            lambda: TaskMotions(grasp, self._place(q_start, grasp, shape, X_WO_goal)),
        )

    def plan_escape(
        self, q: Vector, fingers: Mapping[str, float], obstacles: Obstacles = ()
    ) -> tuple[Trajectory, Trajectory] | PlanningFailure:
        """Plan the way out of a failed grasp: away from the object, then home.

        Args:
            q: Posture of the arm, shape (N,) [rad].
            fingers: Angles of the open gripper's joints by name [rad].
            obstacles: Other objects and their poses [m].
        """
        return self._among(obstacles, lambda: self._escape(q, fingers))

    def _among(
        self, obstacles: Obstacles, plan: Callable[[], _T]
    ) -> _T | PlanningFailure:
        """Run `plan` among obstacles; return its plan, or the reason why it failed."""
        try:
            with self.ready(obstacles):
                return plan()
        except NoPathError as error:
            return error.failure

    @contextlib.contextmanager
    def ready(self, obstacles: Obstacles) -> Iterator[None]:
        """Add obstacles within the context; restore the fingers after it."""
        fingers = self.scene.fingers
        try:
            with self.standing(obstacles):
                yield
        finally:
            self.scene.fingers = fingers

    def _plan(
        self,
        q_start: Vector,
        X_WO: RigidTransform,
        shape: Solid,
        X_WO_goal: RigidTransform,
        tried: Sequence[str],
    ) -> TaskMotions:
        """Return the motions with the best grasp."""
        taken = self._overlap(shape, X_WO_goal)
        if taken is not None:
            message = f"the goal is taken: {taken}"
            raise NoPathError(PlanningFailure(Failure.BLOCKED, message))
        reasons: list[PlanningFailure] = []
        for turned in (False, True):
            candidates, failures = self._search.candidates(
                X_WO, shape, X_WO_goal, turned=turned, tried=tried
            )
            no_path = []
            for candidate in candidates[:_MOST_CANDIDATES]:
                try:
                    motions = self._with_grasp(q_start, shape, X_WO_goal, candidate)
                    return TaskMotions(candidate.grasp, motions)
                except NoPathError as error:
                    no_path.append(error.failure)
            # The grasps that came farthest give the most specific reason.
            reasons = reasons or no_path or failures
            # From another side, the hand may get past obstacles, but not farther.
            if all(f.failure is not Failure.BLOCKED for f in reasons):
                break
        if not reasons:
            message = f"no known grasp fits a {shape}"
            failure = PlanningFailure(Failure.NO_GRASP, message, picking=True)
            raise NoPathError(failure)
        raise NoPathError(most_specific(reasons))

    def _carry(
        self, q_grasp: Vector, grasp: Grasp, shape: Solid, X_WO_goal: RigidTransform
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions of `plan_carry`."""
        candidate = self._search.grasped(q_grasp, grasp, shape, X_WO_goal)
        return self._after_grasp(shape, X_WO_goal, candidate)

    def _place(
        self, q_start: Vector, grasp: Grasp, shape: Solid, X_WO_goal: RigidTransform
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions of `plan_place`."""
        moves = self._moves
        goal = place_target(grasp, X_WO_goal, self.config.place_height)
        above = goal.shifted(self.config.lift_height * _UP)
        with carrying(self.scene, shape, grasp, supported=True):
            path = moves.through(q_start, [above, goal])
            down = moves.timed(path, moves.holding, straight=True)
        leaving = self.leave(path[-1], grasp, shape, X_WO_goal)
        return {Mode.PLACE: down} | leaving

    def _escape(
        self, q: Vector, fingers: Mapping[str, float]
    ) -> tuple[Trajectory, Trajectory]:
        """Return the motions of `plan_escape`."""
        moves = self._moves
        self.scene.SetFingers(fingers)
        path = plan_cartesian_path(self.scene, q, moves.behind(q))
        if isinstance(path, PlanningFailure):
            path = q[np.newaxis]
        away = moves.timed(path, moves.free)
        home = moves.joint_path(path[-1], self.q_home)
        return away, moves.timed(home, moves.free)

    def _with_grasp(
        self,
        q_start: Vector,
        shape: Solid,
        X_WO_goal: RigidTransform,
        candidate: Candidate,
    ) -> dict[AnyMode, Trajectory]:
        """Return all motions from `q_start` (N,) [rad] to home, with one grasp."""
        scene, grasp, X_WO = self.scene, candidate.grasp, candidate.X_WO
        moves, q_grasp = self._moves, candidate.q_grasp
        scene.SetFingers(grasp.fingers_open)
        with scene.standing(shape, X_WO, touchable=True):
            back = moves.straight(q_grasp, moves.behind(q_grasp), turning=True)
            reach = moves.timed(back[::-1], moves.free, straight=True)
        with scene.standing(shape, X_WO):
            approach = moves.timed(moves.joint_path(q_start, back[-1]), moves.free)
        rest = self._after_grasp(shape, X_WO_goal, candidate)
        return {Mode.GRASP: reach, Mode.PRE_GRASP: approach, **rest}

    def _after_grasp(
        self, shape: Solid, X_WO_goal: RigidTransform, candidate: Candidate
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions that follow a grasp, from lifting to home."""
        scene, grasp, moves = self.scene, candidate.grasp, self._moves
        motions: dict[AnyMode, Trajectory] = {}
        with carrying(scene, shape, grasp):
            with scene.supporting(SUPPORT_OVERLAP):
                q_pick = candidate.q_grasp
                up = moves.straight(q_pick, moves.above(q_pick), turning=True)
                motions[Mode.LIFT] = moves.timed(up, moves.holding, straight=True)
            across, down = self._transfer(up[-1], X_WO_goal, candidate)
            motions[Mode.TRANSFER] = moves.timed(across, moves.holding)
        drift_G = self._drift(grasp, motions.values())
        drifted = dc.replace(grasp, p_GO=grasp.p_GO + drift_G)
        with carrying(scene, shape, drifted, supported=True):
            if drift_G.any():
                drift_W = scene.X_WG(across[-1]).rotation() @ drift_G
                below = moves.below(across[-1]).shifted(-drift_W)
                down = moves.straight(across[-1], below)
            motions[Mode.PLACE] = moves.timed(down, moves.holding, straight=True)
        return motions | self.leave(down[-1], drifted, shape, X_WO_goal)

    @restores_fingers
    def leave(
        self, q_place: Vector, grasp: Grasp, shape: Solid, X_WO: RigidTransform
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions of the empty hand away from an object, and home.

        Args:
            q_place: Posture of the arm, at rest, shape (N,) [rad].
            grasp: The grasp.
            shape: The object's shape.
            X_WO: Pose of the object [m]. The hand determines its rotation about its
                axis.

        Raises:
            NoPathError: If there is no such motion.
        """
        scene, moves = self.scene, self._moves
        X_WO = grasp.set_down(scene.X_WG(q_place), X_WO)
        scene.SetFingers(grasp.fingers_open)
        with scene.standing(shape, X_WO, touchable=True):
            path = moves.straight(q_place, moves.behind(q_place))
            away = moves.timed(path, moves.free, straight=True)
        with scene.standing(shape, X_WO):
            home = moves.timed(moves.joint_path(path[-1], self.q_home), moves.free)
        return {Mode.RETREAT: away, Mode.HOME: home}

    def _transfer(
        self, q_lifted: Vector, X_WO_goal: RigidTransform, candidate: Candidate
    ) -> tuple[Vector, Vector]:
        """Return the paths to above the goal, and down to it, both (K, N) [rad]."""
        scene = self.scene
        lift = self.config.lift_height * _UP
        height = self.config.place_height
        place = place_target(
            candidate.grasp, X_WO_goal, height, angle_tolerance=_UPRIGHT
        )
        # A straight path keeps the object upright. If there is no such path, any other
        # path will do.
        across = self._across(q_lifted, place.shifted(lift))
        with scene.supporting(SUPPORT_OVERLAP):
            if across is not None:
                below = self._moves.below(across[-1])
                down = plan_cartesian_path(scene, across[-1], below)
                if not isinstance(down, PlanningFailure):
                    return across, down
            q_place = candidate.q_place
            up = self._moves.straight(q_place, self._moves.above(q_place))
        return self._moves.joint_path(q_lifted, up[-1]), up[::-1]

    def _drift(self, grasp: Grasp, motions: Iterable[Trajectory]) -> Vector:
        """Return how far the object drifts in the hand during motions, (3,) [m]."""
        time, drift = self.config.drift_time, np.zeros(3)
        if time > 0.0:
            for motion in motions:
                drift += carried_drift(self.scene, motion, grasp.p_GO, time)
        return drift

    def _across(self, q_lifted: Vector, above_goal: HandTarget) -> Vector | None:
        """Return a path to above the goal that keeps the object upright, or None."""
        scene = self.scene
        for higher in _HIGHER:
            lines = [above_goal]
            if higher:
                over = self._moves.above(q_lifted, higher)
                lines = [over, above_goal.shifted(higher * _UP), above_goal]
            try:
                across = self._moves.through(q_lifted, lines)
                break
            except NoPathError as error:
                if error.failure.failure is not Failure.BLOCKED:
                    return None
        else:
            return None
        if not scene.reaches_any_pose and self.config.tip_limits is None:
            # To follow a straight line, an arm without a redundant joint takes detours
            # in joint space. Go straight in joint space if that keeps the object
            # upright.
            ends = np.array([q_lifted, across[-1]])
            line = scene.samples(ends)
            lean = max(above_goal.angle_violation(scene.X_WG(q)) for q in line)
            kept = lean < 1e-6  # the end of the line already uses up the tolerance
            if kept and scene.first_hit(line) is None:
                return ends
        return across

    @restores_fingers
    def rests(self, shape: Solid, X_WO: RigidTransform) -> bool:
        """Return whether an object at `X_WO` [m] has support and penetrates nothing."""
        lowered = RigidTransform([0.0, 0.0, 2.0 * SUPPORT_OVERLAP]) @ X_WO
        return not self._overlap(shape, X_WO) and bool(self._overlap(shape, lowered))

    def _overlap(self, shape: Solid, X_WO: RigidTransform) -> Clearance | None:
        """Return the overlap of an object at `X_WO` [m]; None if it fits there.

        The checker compares fixed bodies only with moving ones. So the object is
        attached to the distant hand of an arm at home.
        """
        self.scene.SetFingers({})
        X_GO = self.scene.X_WG(self.q_home).inverse() @ X_WO
        with self.scene.holding(shape, X_GO, margin=SUPPORT_OVERLAP):
            clearance = self.scene.clearance(self.q_home)
        taken = clearance.spare < 0.0 and "held_object" in clearance.bodies
        return clearance if taken else None

    @restores_fingers
    def others(
        self, q: Vector, fingers: Mapping[str, float], obstacles: Obstacles
    ) -> Obstacles:
        """Return the obstacles, except views of the arm itself.

        In images, the arm may differ from its model by a few pixels, a bent joint and a
        yielding finger. Everything closer to the arm than the motions' clearance is the
        arm.

        Args:
            q: Posture of the arm, shape (N,) [rad].
            fingers: Angles of the gripper's joints by name [rad].
            obstacles: Shapes and their poses [m].
        """
        self.scene.SetFingers(fingers)
        return tuple(
            o
            for o in obstacles
            if not self.scene.touches(q, *o, within=self.config.hand_clearance)
        )

    @restores_fingers
    def obstruction(
        self, task: TaskMotions, shape: Solid, obstacles: Obstacles
    ) -> str | None:
        """Describe what blocks motions; None if they are free.

        Obstacles may break a margin by up to half of the smaller one, because images of
        the same object differ.

        Args:
            task: The motions.
            shape: Shape of the object in the hand.
            obstacles: Other objects and their poses [m].
        """
        slack = 0.5 * min(self.config.clearance, self.config.hand_clearance)
        with self.standing(obstacles):
            for mode, motion in task.motions.items():
                with contextlib.ExitStack() as stack:
                    if mode in (Mode.LIFT, Mode.TRANSFER, Mode.PLACE):
                        low = mode is not Mode.TRANSFER
                        held = carrying(self.scene, shape, task.grasp, supported=low)
                        stack.enter_context(held)
                    else:
                        self.scene.SetFingers(task.grasp.fingers_open)
                    samples = motion_samples(self.scene, motion)
                    hit = self.scene.first_hit(samples, slack)
                if hit is not None:
                    return f"{mode_name(mode)}: {hit}"
        return None

    @contextlib.contextmanager
    def standing(self, obstacles: Obstacles) -> Iterator[None]:
        """Add obstacles to the scene within the context."""
        with contextlib.ExitStack() as stack:
            for shape, X_WO in obstacles:
                stack.enter_context(self.scene.standing(shape, X_WO))
            yield
