"""Moves of the hand, each with its path and its timing."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable, Sequence

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.motion.inverse_kinematics import AxisTarget, HandTarget
from drake_srg.planning.motion.limits import MotionConfig, MotionLimits
from drake_srg.planning.motion.paths import plan_cartesian_path, plan_joint_path
from drake_srg.planning.motion.planning_scene import (
    NoPathError,
    PlanningFailure,
    PlanningScene,
)
from drake_srg.planning.motion.time_parameterization import load_toppra
from drake_srg.planning.motion.trajectories import (
    ROUNDING,
    STRAIGHT,
    PathPart,
    cut,
    joined,
    time_optimal_trajectory,
    tip_limited_trajectory,
)
from drake_srg.types import Vector

_UP = np.array([0.0, 0.0, 1.0])
_SAME = 0.01  # distance from its goal at which a straight line may end [rad]


class Moves:
    """Paths and timings in a planning scene; impossible moves raise `NoPathError`.

    Args:
        scene: The arm, the gripper and their surroundings.
        p_GT: The hand's point that moves along straight lines, shape (3,) [m].
        config: Distances and speeds.

    Attributes:
        p_GT: The hand's point.
        free: Limits of motions with an empty hand.
        holding: Limits of motions with something in the hand.
    """

    def __init__(
        self, scene: PlanningScene, p_GT: Vector, config: MotionConfig
    ) -> None:
        self._scene = scene
        self.p_GT = np.asarray(p_GT)
        self._config = config
        load_toppra()  # now, not during the first motion
        limits = MotionLimits.of_plant(scene)
        self.free = limits.scaled(config.speed, config.speed)
        self.holding = limits.scaled(config.holding_speed, config.holding_acceleration)

    def tip(self, q: Vector) -> Vector:
        """Return the position of the hand's point at `q` (N,) [rad], shape (3,) [m]."""
        p_WT: Vector = self._scene.X_WG(q) @ self.p_GT
        return p_WT

    def above(self, q: Vector, height: float | None = None) -> HandTarget:
        """Return the hand at `q` (N,) [rad], lifted by `height` or `lift_height`."""
        height = self._config.lift_height if height is None else height
        return self._like(q).shifted(height * _UP)

    def below(self, q: Vector) -> HandTarget:
        """Return the hand at `q` (N,) [rad], lowered by `lift_height`."""
        return self._like(q).shifted(-self._config.lift_height * _UP)

    def behind(self, q: Vector) -> HandTarget:
        """Return the hand at `q` (N,) [rad], drawn back by `approach_distance`."""
        X_WG = self._scene.X_WG(q)
        back = -self._config.approach_distance * X_WG.rotation().col(0)
        return self._like(q).shifted(back)

    def _like(self, q: Vector) -> HandTarget:
        """Return the hand's pose at `q`, or what the arm can keep of it on a line."""
        X_WG = self._scene.X_WG(q)
        if self._scene.reaches_any_pose:
            return HandTarget.from_pose(X_WG)
        z = np.array([0.0, 0.0, 1.0])
        keep = AxisTarget(z, X_WG.rotation() @ z, angle=0.002)
        return HandTarget(self.tip(q), axes=(keep,), p_GT=self.p_GT)

    def straight(
        self, q: Vector, target: HandTarget, *, turning: bool = False
    ) -> Vector:
        """Return the path of the hand on a straight line from `q`, (K, N) [rad].

        Args:
            q: Posture at its start, (N,) [rad].
            target: Target at its end.
            turning: Whether axes may turn if they cannot be kept along the line.

        Raises:
            NoPathError: If there is no such path.
        """
        path = plan_cartesian_path(self._scene, q, target)
        if isinstance(path, PlanningFailure) and turning and target.axes:
            # Joints of an arm that is nearly stretched turn far on a short line.
            target = dc.replace(target, axes=())
            path = plan_cartesian_path(self._scene, q, target, spacing=0.005)
        if isinstance(path, PlanningFailure):
            raise NoPathError(path)
        return path

    def through(self, q: Vector, targets: Iterable[HandTarget]) -> Vector:
        """Return the path on straight lines from `q` through targets, (K, N) [rad].

        Raises:
            NoPathError: If there is no such path.
        """
        path = q[np.newaxis]
        for target in targets:
            path = np.vstack([path, self.straight(path[-1], target)[1:]])
        return path

    def joint_path(self, q_start: Vector, q_goal: Vector) -> Vector:
        """Return a collision-free path between two postures, (K, N) [rad].

        If the hand's motion is limited, a straight line of the hand is preferred.

        Raises:
            NoPathError: If there is no such path.
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
        """Return the fastest motion along a path, from rest to rest.

        Args:
            path: Waypoints, (K, N) [rad].
            limits: `free` or `holding`.
            straight: Whether the hand must stay on the lines between them.

        Raises:
            NoPathError: If there is no such motion.
        """
        return self.timed_part(
            PathPart(path, STRAIGHT if straight else ROUNDING), limits
        )

    def timed_part(self, part: PathPart, limits: MotionLimits) -> Trajectory:
        """Return the fastest motion along a part of a path, from rest to rest.

        Args:
            part: The part.
            limits: `free` or `holding`.

        Raises:
            NoPathError: If there is no such motion.
        """
        trajectory: Trajectory | PlanningFailure
        if self._config.tip_limits is not None:
            trajectory = tip_limited_trajectory(
                self._scene, part.path, limits, self._config.tip_limits, p_GT=self.p_GT
            )
        else:
            trajectory = time_optimal_trajectory(
                self._scene, part.path, limits, rounding=part.rounding
            )
        if isinstance(trajectory, PlanningFailure):
            raise NoPathError(trajectory)
        return trajectory

    def without_rest(
        self,
        apart: tuple[Trajectory, ...],
        parts: Sequence[PathPart],
        limits: MotionLimits,
        period: float,
    ) -> tuple[Trajectory, ...]:
        """Return one motion along parts of a path, cut where one part ends.

        The arm does not rest between parts, but cuts the corner. Each motion but the
        last ends at speed, and the next one must begin at once.

        Args:
            apart: The motions with a rest between them, which are returned if they are
                faster, if no other motion is free, or if the hand's speed is limited.
            parts: Each begins where the one before ends.
            limits: `free` or `holding`.
            period: A motion that ends at speed lasts a multiple of this time [s], so
                that the next one can begin without a gap.
        """
        if self._config.tip_limits is not None:
            return apart
        try:
            whole = self.timed_part(joined(parts), limits)
        except NoPathError:
            return apart
        if whole.end_time() > sum(motion.end_time() for motion in apart):
            return apart
        return cut(whole, [part.path[-1] for part in parts[:-1]], period)
