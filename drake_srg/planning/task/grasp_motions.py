"""The motions of one grasp, from the approach until the arm is back home."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.common.convex_pieces import Solid
from drake_srg.planning.grasps.grasp_search import (
    SUPPORT_OVERLAP,
    Candidate,
    carrying,
    place_target,
)
from drake_srg.planning.grasps.grasps import Grasp
from drake_srg.planning.motion.carried_drift import carried_drift
from drake_srg.planning.motion.failure import NoPathError, PlanningFailure
from drake_srg.planning.motion.hand_target import HandTarget
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.paths import plan_cartesian_path
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.types import Failure, Mode, Vector

_UP = np.array([0.0, 0.0, 1.0])
# How much more a carried object may lean than where it was taken [rad].
_UPRIGHT = 0.004
# How much higher the object may be carried over what is in its way [m].
_HIGHER = (0.0, 0.04, 0.08)


class GraspMotions:
    """Plans the motions of a grasp in a planning scene; holds nothing between calls.

    Args:
        scene: The arm, the gripper and what they may hit.
        moves: The moves in that scene.
        q_home: Where the arm rests, shape (N,) [rad].
        config: Distances.
    """

    def __init__(
        self,
        scene: PlanningScene,
        moves: Moves,
        q_home: Vector,
        config: PlannerConfig,
    ) -> None:
        self._scene = scene
        self._moves = moves
        self._q_home = q_home
        self._config = config

    def plan(
        self,
        q_start: Vector,
        shape: Solid,
        X_WO_goal: RigidTransform,
        candidate: Candidate,
    ) -> dict[Mode, Trajectory]:
        """Plan all motions from `q_start` to home.

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            shape: The object's shape.
            X_WO_goal: Where the object must go [m].
            candidate: The grasp, and where the object is.

        Raises:
            NoPathError: If a motion does not exist.
        """
        scene, grasp, X_WO = self._scene, candidate.grasp, candidate.X_WO
        motions: dict[Mode, Trajectory] = {}

        scene.SetFingers(grasp.fingers_open)
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

        return motions | self.carry(shape, X_WO_goal, candidate)

    def carry(
        self, shape: Solid, X_WO_goal: RigidTransform, candidate: Candidate
    ) -> dict[Mode, Trajectory]:
        """Plan the motions that follow a grasp, from lifting to home.

        Args:
            shape: The object's shape.
            X_WO_goal: Where the object must go [m].
            candidate: The grasp.

        Raises:
            NoPathError: If a motion does not exist.
        """
        scene, grasp = self._scene, candidate.grasp
        motions: dict[Mode, Trajectory] = {}
        with carrying(scene, shape, grasp):
            with scene.supporting(SUPPORT_OVERLAP):
                q_pick = candidate.q_grasp
                up = self._moves.straight(
                    q_pick, self._moves.above(q_pick), turning=True
                )
                motions[Mode.LIFT] = self._moves.timed(
                    up, self._moves.holding, straight=True
                )
            across, down = self._transfer(up[-1], X_WO_goal, candidate)
            motions[Mode.TRANSFER] = self._moves.timed(across, self._moves.holding)
        drift_G = self._drift(grasp, motions.values())
        drifted = dc.replace(grasp, p_GO=grasp.p_GO + drift_G)
        with carrying(scene, shape, drifted, supported=True):
            if drift_G.any():
                drift_W = scene.X_WG(across[-1]).rotation() @ drift_G
                below = self._moves.below(across[-1]).shifted(-drift_W)
                down = self._moves.straight(across[-1], below)
            motions[Mode.PLACE] = self._moves.timed(
                down, self._moves.holding, straight=True
            )
        return motions | self._leave(down[-1], drifted, shape, X_WO_goal)

    def place(
        self, q_start: Vector, grasp: Grasp, shape: Solid, X_WO_goal: RigidTransform
    ) -> dict[Mode, Trajectory]:
        """Plan the motions onto the goal and home, with the object in the hand.

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            grasp: The grasp, with the object's actual pose in the hand.
            shape: The object's shape.
            X_WO_goal: Where the object must go [m].

        Raises:
            NoPathError: If a motion does not exist.
        """
        goal = place_target(grasp, X_WO_goal, self._config.place_height)
        above = goal.shifted(self._config.lift_height * _UP)
        with carrying(self._scene, shape, grasp, supported=True):
            path = self._moves.through(q_start, [above, goal])
            down = self._moves.timed(path, self._moves.holding, straight=True)
        return {Mode.PLACE: down} | self._leave(path[-1], grasp, shape, X_WO_goal)

    def _leave(
        self, q_place: Vector, grasp: Grasp, shape: Solid, X_WO: RigidTransform
    ) -> dict[Mode, Trajectory]:
        """Return the motions away from an object that has been placed, and home."""
        scene, motions = self._scene, {}
        X_WO = grasp.set_down(scene.X_WG(q_place), X_WO)
        scene.SetFingers(grasp.fingers_open)
        with scene.standing(shape, X_WO, touchable=True):
            away = self._moves.straight(q_place, self._moves.behind(q_place))
            motions[Mode.RETREAT] = self._moves.timed(
                away, self._moves.free, straight=True
            )
        with scene.standing(shape, X_WO):
            motions[Mode.HOME] = self._moves.timed(
                self._moves.joint_path(away[-1], self._q_home), self._moves.free
            )
        return motions

    def _transfer(
        self, q_lifted: Vector, X_WO_goal: RigidTransform, candidate: Candidate
    ) -> tuple[Vector, Vector]:
        """Return the paths across, and down to the goal, both (K, N) [rad]."""
        scene = self._scene
        lift = self._config.lift_height * _UP
        place = place_target(
            candidate.grasp,
            X_WO_goal,
            self._config.place_height,
            angle_tolerance=_UPRIGHT,
        )
        # Straight across keeps the object upright. Otherwise, any way will do.
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
        time, drift = self._config.drift_time, np.zeros(3)
        if time > 0.0:
            for motion in motions:
                drift += carried_drift(self._scene, motion, grasp.p_GO, time)
        return drift

    def _across(self, q_lifted: Vector, above_goal: HandTarget) -> Vector | None:
        """Return a path above the goal that keeps the object upright, or None."""
        scene = self._scene
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
        if not scene.reaches_any_pose and self._config.tip_limits is None:
            # Without a spare joint, a straight line costs detours of the joints.
            ends = np.array([q_lifted, across[-1]])
            line = scene.samples(ends)
            lean = max(above_goal.angle_violation(scene.X_WG(q)) for q in line)
            kept = lean < 1e-6  # the end of the line uses up the tolerance
            if kept and scene.first_hit(line) is None:
                return ends
        return across
