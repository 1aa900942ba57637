"""All motions of one pick and place, planned at once from where the object is seen."""

from __future__ import annotations

import contextlib
import dataclasses as dc
from collections.abc import Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.planning.config import PlannerConfig
from drake_srg.planning.grasp_search import (
    SUPPORT_OVERLAP,
    Candidate,
    GraspSearch,
    carrying,
    place_target,
)
from drake_srg.planning.grasps import Grasp, Hand
from drake_srg.planning.moves import FREEDOMS, Moves, NoPathError, TaskFailure
from drake_srg.planning.paths import PathFailure, PlanCartesianPath
from drake_srg.planning.planning_scene import Clearance, PlanningScene
from drake_srg.planning.trajectories import motion_samples
from drake_srg.types import Failure, Mode, Shape, Vector

_UP = np.array([0.0, 0.0, 1.0])
# Grasps whose motions are planned before the planner gives up. More are there only
# where the hand is turned about the object; a search for a way takes up to 5 s each.
_MOST_CANDIDATES = 8
# What a carried object may lean more than where it was taken [rad].
_UPRIGHT = 0.004


# Shapes that stand about, and their poses X_WO [m].
Obstacles: TypeAlias = Sequence[tuple[Shape, RigidTransform]]


@dc.dataclass(frozen=True)
class TaskMotions:
    """A grasp and the motion of each mode that moves the arm."""

    grasp: Grasp
    motions: Mapping[Mode, Trajectory]


class TaskPlanner:
    """Plans picking and placing with a planning scene; holds nothing between calls."""

    def __init__(
        self,
        scene: PlanningScene,
        hand: Hand,
        q_home: Vector,
        config: PlannerConfig,
    ) -> None:
        """Take what planning needs.

        Args:
            scene: The arm, the gripper and what they may hit.
            hand: How that gripper takes things.
            q_home: Where the arm rests, shape (N,) [rad].
            config: Distances and speeds.
        """
        self.scene = scene
        self.hand = hand
        self.q_home = np.asarray(q_home, dtype=float)
        self.config = config
        self._moves = Moves(scene, hand, config)
        self._search = GraspSearch(scene, hand, self.q_home, config)

    def plan(
        self,
        q_start: Vector,
        X_WO: RigidTransform,
        shape: Shape,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles = (),
        tried: Sequence[str] = (),
    ) -> TaskMotions | TaskFailure:
        """Plan the motions from `q_start` over pick and place to home.

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            X_WO: The object's pose [m]; how it is turned about its z does not count.
            shape: Its shape.
            X_WO_goal: Where it shall be [m].
            obstacles: Other objects and their poses [m].
            tried: Names of grasps that failed.
        """
        with self._standing(obstacles):
            return self._plan(q_start, X_WO, shape, X_WO_goal, tried)

    def plan_place(
        self,
        q_start: Vector,
        grasp: Grasp,
        shape: Shape,
        X_WO_goal: RigidTransform,
        obstacles: Obstacles = (),
    ) -> TaskMotions | TaskFailure:
        """Plan from above the goal onto it, and home, with the object in the hand.

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            grasp: With the object's pose in the hand as it is.
            shape: The object's.
            X_WO_goal: Where it shall be [m].
            obstacles: Other objects and their poses [m].
        """
        place = place_target(grasp, X_WO_goal, self.config.place_height)
        try:
            with self._standing(obstacles):
                with carrying(self.scene, shape, grasp, supported=True):
                    above = place.Shifted(self.config.lift_height * _UP)
                    path = self._moves.straight(q_start, above)
                    path = np.vstack([path, self._moves.straight(path[-1], place)[1:]])
                    down = self._moves.timed(path, self._moves.holding, straight=True)
                motions = {Mode.PLACE: down}
                motions |= self._leave(path[-1], grasp, shape, X_WO_goal)
        except NoPathError as error:
            return error.failure
        return TaskMotions(grasp, motions)

    def _plan(
        self,
        q_start: Vector,
        X_WO: RigidTransform,
        shape: Shape,
        X_WO_goal: RigidTransform,
        tried: Sequence[str],
    ) -> TaskMotions | TaskFailure:
        taken = self._overlap(shape, X_WO_goal)
        if taken is not None:
            return TaskFailure(Failure.BLOCKED, f"the goal is taken: {taken}")
        reasons: list[TaskFailure] = []
        for turned in (False, True):
            candidates, failures = self._search.candidates(
                X_WO, shape, X_WO_goal, turned=turned, tried=tried
            )
            no_path = []
            for candidate in candidates[:_MOST_CANDIDATES]:
                try:
                    motions = self._motions(q_start, shape, X_WO_goal, candidate)
                    return TaskMotions(candidate.grasp, motions)
                except NoPathError as error:
                    no_path.append(error.failure)
            # The grasps that came furthest tell what is in the way.
            reasons = reasons or no_path or failures
            # From another side there may be a way past what blocks; nothing else.
            blocked = [f for f in reasons if f.failure is Failure.BLOCKED]
            if not blocked:
                break
        if not reasons:
            return TaskFailure(Failure.NO_GRASP, f"no known grasp takes a {shape}")
        # What only the surroundings forbid is worth knowing before what no arm
        # posture reaches.
        return (blocked or reasons)[0]

    def rests(self, shape: Shape, X_WO: RigidTransform) -> bool:
        """Whether a thing at `X_WO` [m] is on something, and in nothing."""
        lowered = RigidTransform([0.0, 0.0, 2.0 * SUPPORT_OVERLAP]) @ X_WO
        return not self._overlap(shape, X_WO) and bool(self._overlap(shape, lowered))

    def _overlap(self, shape: Shape, X_WO: RigidTransform) -> Clearance | None:
        """Return what a thing at `X_WO` [m] is in, None where it fits there.

        Fixed things are only checked against what moves, so it hangs from the distant
        hand of an arm at home.
        """
        self.scene.set_fingers({})
        X_GO = self.scene.X_WG(self.q_home).inverse() @ X_WO
        with self.scene.holding(shape, X_GO, margin=SUPPORT_OVERLAP):
            clearance = self.scene.clearance(self.q_home)
        taken = clearance.spare < 0.0 and "held_object" in clearance.bodies
        return clearance if taken else None

    def others(
        self, q: Vector, fingers: Mapping[str, float], obstacles: Obstacles
    ) -> Obstacles:
        """Those of `obstacles` that are not the arm itself, seen by a camera.

        Images show it some pixels, a bent joint and a finger that gives beside where it
        is believed to be. What is nearer than motions keep from all else is the arm.

        Args:
            q: Where the arm is, shape (N,) [rad].
            fingers: Angles of the gripper's joints by name [rad].
            obstacles: Shapes and their poses [m].
        """
        self.scene.set_fingers(fingers)
        return tuple(
            o
            for o in obstacles
            if not self.scene.touches(q, *o, within=self.config.hand_clearance)
        )

    def obstruction(
        self, task: TaskMotions, shape: Shape, obstacles: Obstacles
    ) -> str | None:
        """Say what of `obstacles` is in the way of motions, in words; None: nothing.

        Half of every margin may be used up by what images of the same thing differ by.

        Args:
            task: The motions.
            shape: The object's that is taken.
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
                        self.scene.set_fingers(task.grasp.fingers_open)
                    samples = motion_samples(self.scene, motion)
                    hit = self.scene.first_hit(samples, slack)
                if hit is not None:
                    return f"{mode.value}: {hit}"
        return None

    def plan_escape(
        self, q: Vector, fingers: Mapping[str, float], obstacles: Obstacles = ()
    ) -> tuple[Trajectory, Trajectory] | TaskFailure:
        """Plan back out of a failed grasp: away from the object, then home.

        Args:
            q: Where the arm is, shape (N,) [rad].
            fingers: Angles of the gripper's joints, open, by name [rad].
            obstacles: Other objects and their poses [m].
        """
        self.scene.set_fingers(fingers)
        try:
            with self._standing(obstacles):
                path = PlanCartesianPath(self.scene, q, self._moves.behind(q))
                if isinstance(path, PathFailure):
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

    def _motions(
        self,
        q_start: Vector,
        shape: Shape,
        X_WO_goal: RigidTransform,
        candidate: Candidate,
    ) -> dict[Mode, Trajectory]:
        scene, grasp, X_WO = self.scene, candidate.grasp, candidate.X_WO
        motions: dict[Mode, Trajectory] = {}

        scene.set_fingers(grasp.fingers_open)
        with scene.standing(shape, X_WO, touchable=True):
            back = self._moves.straight(
                candidate.q_grasp, self._moves.behind(candidate.q_grasp), turning=True
            )
            motions[Mode.GRASP] = self._moves.timed(
                back[::-1], self._moves.free, straight=True
            )
        with scene.standing(shape, X_WO):
            motions[Mode.PRE_GRASP] = self._moves.timed(
                self._moves.joint_path(q_start, back[-1]), self._moves.free
            )

        with carrying(scene, shape, grasp, supported=True):
            q_pick = candidate.q_grasp
            up = self._moves.straight(q_pick, self._moves.above(q_pick), turning=True)
            motions[Mode.LIFT] = self._moves.timed(
                up, self._moves.holding, straight=True
            )
        across, down = self._transfer(up[-1], shape, X_WO_goal, candidate)
        with carrying(scene, shape, grasp):
            motions[Mode.TRANSFER] = self._moves.timed(across, self._moves.holding)
        with carrying(scene, shape, grasp, supported=True):
            motions[Mode.PLACE] = self._moves.timed(
                down, self._moves.holding, straight=True
            )
        return motions | self._leave(down[-1], grasp, shape, X_WO_goal)

    def _leave(
        self, q_place: Vector, grasp: Grasp, shape: Shape, X_WO: RigidTransform
    ) -> dict[Mode, Trajectory]:
        """Motions away from an object that has been placed, and home."""
        scene, motions = self.scene, {}
        scene.set_fingers(grasp.fingers_open)
        with scene.standing(shape, X_WO, touchable=True):
            away = self._moves.straight(q_place, self._moves.behind(q_place))
            motions[Mode.RETREAT] = self._moves.timed(
                away, self._moves.free, straight=True
            )
        with scene.standing(shape, X_WO):
            motions[Mode.HOME] = self._moves.timed(
                self._moves.joint_path(away[-1], self.q_home), self._moves.free
            )
        return motions

    def _transfer(
        self,
        q_lifted: Vector,
        shape: Shape,
        X_WO_goal: RigidTransform,
        candidate: Candidate,
    ) -> tuple[Vector, Vector]:
        """The way across, and down to the goal."""
        scene, grasp = self.scene, candidate.grasp
        lift = self.config.lift_height * _UP
        place = place_target(
            grasp, X_WO_goal, self.config.place_height, angle_tolerance=_UPRIGHT
        )
        # Straight across keeps the object upright. Where that does not go, any way.
        with carrying(scene, shape, grasp):
            across = PlanCartesianPath(scene, q_lifted, place.Shifted(lift))
            if (
                not isinstance(across, PathFailure)
                and scene.num_joints < FREEDOMS
                and self.config.tip_limits is None
            ):
                # Without a joint to spare, the hand's line costs detours of the joints.
                line = scene.edge(q_lifted, across[-1])
                lean = max(place.angle_violation(scene.X_WG(q)) for q in line)
                kept = lean < 1e-6  # the line's end is as far off as is tolerated
                if kept and scene.first_hit(line) is None:
                    across = np.array([q_lifted, across[-1]])
        with carrying(scene, shape, grasp, supported=True):
            if not isinstance(across, PathFailure):
                below = self._moves.below(across[-1])
                down = PlanCartesianPath(scene, across[-1], below)
                if not isinstance(down, PathFailure):
                    return across, down
            q_place = candidate.q_place
            up = self._moves.straight(q_place, self._moves.above(q_place))
        with carrying(scene, shape, grasp):
            return self._moves.joint_path(q_lifted, up[-1]), up[::-1]
