"""All motions of one pick and place, planned at once from where the object is seen."""

from __future__ import annotations

import contextlib
import dataclasses as dc
from collections.abc import Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.common.convex_pieces import Solid
from drake_srg.planning.grasps.grasp_search import (
    SUPPORT_OVERLAP,
    GraspSearch,
    carrying,
)
from drake_srg.planning.grasps.grasps import Grasp, Hand
from drake_srg.planning.motion.clearance import Clearance
from drake_srg.planning.motion.failure import NoPathError, PlanningFailure
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.paths import plan_cartesian_path
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.motion.trajectories import motion_samples
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.planning.task.grasp_motions import GraspMotions
from drake_srg.types import Failure, Mode, Vector

# Grasps whose motions are planned before giving up. There are more only where the hand
# is turned about the object; each search for a way takes up to 5 s.
_MOST_CANDIDATES = 8


# Shapes to keep clear of, and their poses X_WO [m].
Obstacles: TypeAlias = Sequence[tuple[Solid, RigidTransform]]


@dc.dataclass(frozen=True)
class TaskMotions:
    """A grasp and the motion of each mode that moves the arm."""

    grasp: Grasp
    motions: Mapping[Mode, Trajectory]


class TaskPlanner:
    """Plans picking and placing with a planning scene; holds nothing between calls.

    Args:
        scene: The arm, the gripper and what they may hit.
        hand: How that gripper takes objects.
        q_home: Where the arm rests, shape (N,) [rad].
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
        self._grasp_motions = GraspMotions(scene, self._moves, self.q_home, config)
        self._search = GraspSearch(
            scene,
            hand,
            self.q_home,
            place_height=config.place_height,
            regrasp_squeeze=config.regrasp_squeeze,
        )

    def plan(
        self,
        q_start: Vector,
        X_WO: RigidTransform,
        shape: Solid,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles = (),
        tried: Sequence[str] = (),
    ) -> TaskMotions | PlanningFailure:
        """Plan the motions from `q_start` over pick and place to home.

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            X_WO: The object's pose [m]; the turn of a round one does not count.
            shape: The object's shape.
            X_WO_goal: Where the object must go [m].
            obstacles: Other objects and their poses [m].
            tried: Names of grasps that failed.
        """
        with self._standing(obstacles):
            return self._plan(q_start, X_WO, shape, X_WO_goal, tried)

    def plan_carry(
        self,
        q_grasp: Vector,
        grasp: Grasp,
        shape: Solid,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles = (),
    ) -> TaskMotions | PlanningFailure:
        """Plan from a grasp that holds the object, wherever that is, until home.

        Args:
            q_grasp: Where the arm is, at rest, shape (N,) [rad].
            grasp: The grasp.
            shape: The object's shape.
            X_WO_goal: Where the object must go [m].
            obstacles: Other objects and their poses [m].
        """
        try:
            with self._standing(obstacles):
                candidate = self._search.grasped(q_grasp, grasp, shape, X_WO_goal)
                motions = self._grasp_motions.carry(shape, X_WO_goal, candidate)
        except NoPathError as error:
            return error.failure
        return TaskMotions(grasp, motions)

    def plan_place(
        self,
        q_start: Vector,
        grasp: Grasp,
        shape: Solid,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles = (),
    ) -> TaskMotions | PlanningFailure:
        """Plan from above the goal onto it, and home, with the object in the hand.

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            grasp: The grasp, with the object's actual pose in the hand.
            shape: The object's shape.
            X_WO_goal: Where the object must go [m].
            obstacles: Other objects and their poses [m].
        """
        try:
            with self._standing(obstacles):
                motions = self._grasp_motions.place(q_start, grasp, shape, X_WO_goal)
        except NoPathError as error:
            return error.failure
        return TaskMotions(grasp, motions)

    def _plan(
        self,
        q_start: Vector,
        X_WO: RigidTransform,
        shape: Solid,
        X_WO_goal: RigidTransform,
        tried: Sequence[str],
    ) -> TaskMotions | PlanningFailure:
        taken = self._overlap(shape, X_WO_goal)
        if taken is not None:
            return PlanningFailure(Failure.BLOCKED, f"the goal is taken: {taken}")
        reasons: list[PlanningFailure] = []
        for turned in (False, True):
            candidates, failures = self._search.candidates(
                X_WO, shape, X_WO_goal, turned=turned, tried=tried
            )
            no_path = []
            for candidate in candidates[:_MOST_CANDIDATES]:
                try:
                    motions = self._grasp_motions.plan(
                        q_start, shape, X_WO_goal, candidate
                    )
                    return TaskMotions(candidate.grasp, motions)
                except NoPathError as error:
                    no_path.append(error.failure)
            # The grasps that came furthest tell best what is in the way.
            reasons = reasons or no_path or failures
            # From another side there may be a way past obstacles, but no more reach.
            blocked = [f for f in reasons if f.failure is Failure.BLOCKED]
            if not blocked:
                break
        if not reasons:
            return PlanningFailure(Failure.NO_GRASP, f"no known grasp takes a {shape}")
        # What only the surroundings forbid is more useful to know than what no
        # posture of the arm reaches.
        return (blocked or reasons)[0]

    def rests(self, shape: Solid, X_WO: RigidTransform) -> bool:
        """Return whether an object at `X_WO` [m] is on something, and in nothing."""
        lowered = RigidTransform([0.0, 0.0, 2.0 * SUPPORT_OVERLAP]) @ X_WO
        return not self._overlap(shape, X_WO) and bool(self._overlap(shape, lowered))

    def _overlap(self, shape: Solid, X_WO: RigidTransform) -> Clearance | None:
        """Return what an object at `X_WO` [m] is in, None where it fits there.

        Fixed bodies are checked only against moving ones, so the object is attached to
        the distant hand of an arm at home.
        """
        self.scene.SetFingers({})
        X_GO = self.scene.X_WG(self.q_home).inverse() @ X_WO
        with self.scene.holding(shape, X_GO, margin=SUPPORT_OVERLAP):
            clearance = self.scene.clearance(self.q_home)
        taken = clearance.spare < 0.0 and "held_object" in clearance.bodies
        return clearance if taken else None

    def others(
        self, q: Vector, fingers: Mapping[str, float], obstacles: Obstacles
    ) -> Obstacles:
        """Return the obstacles that are not the arm itself, seen by a camera.

        In images the arm is a few pixels, a bent joint and a yielding finger away from
        where it is believed to be. Whatever is nearer to it than motions come to
        anything else is the arm.

        Args:
            q: Where the arm is, shape (N,) [rad].
            fingers: Angles of the gripper's joints by name [rad].
            obstacles: Shapes and their poses [m].
        """
        self.scene.SetFingers(fingers)
        return tuple(
            o
            for o in obstacles
            if not self.scene.touches(q, *o, within=self.config.hand_clearance)
        )

    def obstruction(
        self, task: TaskMotions, shape: Solid, obstacles: Obstacles
    ) -> str | None:
        """Return what is in the way of motions, in words; None if nothing is.

        Half of every margin is left to differences between images of the same object.

        Args:
            task: The motions.
            shape: Shape of the object that is taken.
            obstacles: Other objects and their poses [m].
        """
        slack = 0.5 * min(self.config.clearance, self.config.hand_clearance)
        with self._standing(obstacles):
            for mode, motion in task.motions.items():
                with contextlib.ExitStack() as stack:
                    if mode in (Mode.LIFT, Mode.TRANSFER, Mode.PLACE):
                        supported = mode is not Mode.TRANSFER
                        held = carrying(
                            self.scene, shape, task.grasp, supported=supported
                        )
                        stack.enter_context(held)
                    else:
                        self.scene.SetFingers(task.grasp.fingers_open)
                    samples = motion_samples(self.scene, motion)
                    hit = self.scene.first_hit(samples, slack)
                if hit is not None:
                    return f"{mode.value}: {hit}"
        return None

    def plan_escape(
        self, q: Vector, fingers: Mapping[str, float], obstacles: Obstacles = ()
    ) -> tuple[Trajectory, Trajectory] | PlanningFailure:
        """Plan back out of a failed grasp: away from the object, then home.

        Args:
            q: Where the arm is, shape (N,) [rad].
            fingers: Angles of the open gripper's joints by name [rad].
            obstacles: Other objects and their poses [m].
        """
        self.scene.SetFingers(fingers)
        try:
            with self._standing(obstacles):
                path = plan_cartesian_path(self.scene, q, self._moves.behind(q))
                if isinstance(path, PlanningFailure):
                    path = q[np.newaxis]
                return (
                    self._moves.timed(path, self._moves.free),
                    self._moves.timed(
                        self._moves.joint_path(path[-1], self.q_home), self._moves.free
                    ),
                )
        except NoPathError as error:
            return error.failure

    @contextlib.contextmanager
    def _standing(self, obstacles: Obstacles) -> Iterator[None]:
        with contextlib.ExitStack() as stack:
            for shape, X_WO in obstacles:
                stack.enter_context(self.scene.standing(shape, X_WO))
            yield
