"""Moves of the hand, each with its path and its timing."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.motion.config import MotionConfig
from drake_srg.planning.motion.failure import NoPathError, PlanningFailure
from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget
from drake_srg.planning.motion.paths import plan_cartesian_path, plan_joint_path
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.motion.tip_trajectory import tip_limited_trajectory
from drake_srg.planning.motion.trajectories import MotionLimits, time_optimal_trajectory
from drake_srg.types import Vector

_UP = np.array([0.0, 0.0, 1.0])
_SAME = 0.01  # difference of postures that a straight line may end with [rad]


class Moves:
    """Paths and timings in a planning scene; those that do not exist raise.

    Attributes:
        free: Limits of motions with an empty hand.
        holding: Limits of motions with something in it.
    """

    def __init__(
        self, scene: PlanningScene, p_GT: Vector, config: MotionConfig
    ) -> None:
        self._scene = scene
        self._p_GT = np.asarray(p_GT)
        self._config = config
        limits = MotionLimits.of_plant(scene)
        self.free = limits.scaled(config.speed, config.speed)
        self.holding = limits.scaled(config.holding_speed, config.holding_acceleration)

    def above(self, q: Vector, height: float | None = None) -> HandTarget:
        """The hand as at `q` (N,) [rad], lifted by `height`, or `lift_height` [m]."""
        height = self._config.lift_height if height is None else height
        return self._like(q).shifted(height * _UP)

    def below(self, q: Vector) -> HandTarget:
        """The hand as at `q` (N,) [rad], lowered by as much as `above` lifts it."""
        return self._like(q).shifted(-self._config.lift_height * _UP)

    def behind(self, q: Vector) -> HandTarget:
        """The hand as at `q` (N,) [rad], drawn back from what is in front of it."""
        X_WG = self._scene.X_WG(q)
        back = -self._config.approach_distance * X_WG.rotation().col(0)
        return self._like(q).shifted(back)

    def _like(self, q: Vector) -> HandTarget:
        """The hand's pose, or as much of it as the arm can keep along a line."""
        X_WG = self._scene.X_WG(q)
        if self._scene.reaches_any_pose:
            return HandTarget.from_pose(X_WG)
        z = np.array([0.0, 0.0, 1.0])
        keep = AxisTarget(z, X_WG.rotation() @ z, angle=0.002)
        return HandTarget(X_WG @ self._p_GT, axes=(keep,), p_GT=self._p_GT)

    def straight(
        self, q: Vector, target: HandTarget, *, turning: bool = False
    ) -> Vector:
        """Path of the hand on a straight line from `q`, (K, N) [rad].

        Args:
            q: Where it starts, (N,) [rad].
            target: Where it ends.
            turning: Whether axes may turn where they cannot be kept along the line.

        Raises:
            NoPathError: If there is none.
        """
        path = plan_cartesian_path(self._scene, q, target)
        if isinstance(path, PlanningFailure) and turning and target.axes:
            # Joints of an arm that is nearly stretched move far on a short way.
            target = dc.replace(target, axes=())
            path = plan_cartesian_path(self._scene, q, target, spacing=0.005)
        if isinstance(path, PlanningFailure):
            raise NoPathError(path)
        return path

    def through(self, q: Vector, targets: Iterable[HandTarget]) -> Vector:
        """Path of the hand on straight lines from `q` through targets, (K, N) [rad].

        Raises:
            NoPathError: If there is none.
        """
        path = q[np.newaxis]
        for target in targets:
            path = np.vstack([path, self.straight(path[-1], target)[1:]])
        return path

    def joint_path(self, q_start: Vector, q_goal: Vector) -> Vector:
        """Any free path between two postures, (K, N) [rad].

        Where the hand's motion is limited, its straight line if there is one.

        Raises:
            NoPathError: If there is none.
        """
        if self._config.tip_limits is not None:
            line = plan_cartesian_path(self._scene, q_start, self._like(q_goal))
            if not isinstance(line, PlanningFailure) and np.allclose(
                line[-1], q_goal, atol=_SAME
            ):
                return np.vstack([line, q_goal])
        path = plan_joint_path(self._scene, q_start, q_goal)
        if isinstance(path, PlanningFailure):
            raise NoPathError(path)
        return path

    def timed(
        self, path: Vector, limits: MotionLimits, *, straight: bool = False
    ) -> Trajectory:
        """The fastest motion along a path (K, N) [rad], from rest to rest.

        Args:
            path: Waypoints.
            limits: `free` or `holding`.
            straight: Whether the hand's line between them is to be kept.

        Raises:
            NoPathError: If there is none.
        """
        trajectory: Trajectory | PlanningFailure
        if self._config.tip_limits is not None:
            trajectory = tip_limited_trajectory(
                self._scene, path, limits, self._config.tip_limits, p_GT=self._p_GT
            )
        else:
            rounding = 1e-3 if straight else 0.2  # of the path's corners [rad]
            trajectory = time_optimal_trajectory(
                self._scene, path, limits, rounding=rounding
            )
        if isinstance(trajectory, PlanningFailure):
            raise NoPathError(trajectory)
        return trajectory
