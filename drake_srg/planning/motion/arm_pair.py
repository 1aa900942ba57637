"""Two arms that avoid each other, or move together.

A posture of both, shape (2N,) [rad], has the joints of the first arm, then those of the
second one.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from pydrake.math import RigidTransform
from pydrake.polynomial import Polynomial
from pydrake.trajectories import (
    PathParameterizedTrajectory,
    PiecewisePolynomial,
    StackedTrajectory,
    Trajectory,
)

from drake_srg.planning.motion.inverse_kinematics import (
    HandTarget,
    IkFailure,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.paths import follow
from drake_srg.planning.motion.planning_scene import (
    Clearance,
    NoPathError,
    PlanningFailure,
    PlanningScene,
)
from drake_srg.planning.motion.trajectories import motion_samples
from drake_srg.types import Failure, Vector

_TIMES = 200  # at which the speeds of a motion are compared with their limits


@dc.dataclass(frozen=True)
class PairedArm:
    """One of two arms.

    Attributes:
        name: Name of the arm, for messages.
        arm: Its model instance.
        gripper: Model instance of its gripper.
        scene: Its planning scene, in which the other arm is an obstacle.
    """

    name: str
    arm: str
    gripper: str
    scene: PlanningScene


@dc.dataclass(frozen=True)
class ArmPair:
    """Two arms of N joints each, whose scenes have the same models."""

    first: PairedArm
    second: PairedArm

    @property
    def arms(self) -> tuple[PairedArm, PairedArm]:
        """Both arms, in their order."""
        return self.first, self.second

    @contextlib.contextmanager
    def beside(
        self, index: int, q: Vector, fingers: Mapping[str, float]
    ) -> Iterator[None]:
        """Let one arm avoid the other one within the context.

        Args:
            index: Index of the arm that plans, 0 or 1.
            q: Positions of the other arm, shape (N,) [rad].
            fingers: Angles of the other gripper's joints by name [rad].
        """
        names = self.arms[1 - index].scene.finger_names
        angles = np.array([fingers.get(name, 0.0) for name in names])
        with self._beside(index, q, angles):
            yield

    @contextlib.contextmanager
    def _beside(self, index: int, q: Vector, fingers: Vector) -> Iterator[None]:
        other = self.arms[1 - index]
        places = {other.arm: q, other.gripper: fingers}
        with self.arms[index].scene.beside(places):
            yield

    def first_hit(self, samples: Vector) -> Clearance | None:
        """Return the first broken margin at postures (K, 2N) [rad], or None.

        Both scenes are checked with their held objects and obstacles.
        """
        fingers = [arm.scene.fingers for arm in self.arms]
        for q in samples:
            halves = np.split(q, 2)
            for i, arm in enumerate(self.arms):
                with self._beside(i, halves[1 - i], fingers[1 - i]):
                    hit = arm.scene.first_hit([halves[i]])
                if hit is not None:
                    return hit
        return None

    def checked(self, motion: Trajectory, what: str) -> Trajectory:
        """Return a motion of both arms, once checked for collisions.

        Args:
            motion: Motion of both arms.
            what: Name of the motion, for messages.

        Raises:
            NoPathError: If something collides.
        """
        levers = np.concatenate([arm.scene.levers for arm in self.arms])
        hit = self.first_hit(motion_samples(self.first.scene, motion, levers))
        if hit is not None:
            message = f"{what}, with both arms in motion: {hit}"
            raise NoPathError(PlanningFailure(Failure.BLOCKED, message))
        return motion

    def follow(
        self,
        q: Vector,
        poses: Sequence[tuple[RigidTransform, RigidTransform]],
        what: str,
    ) -> Vector:
        """Return postures in which both hands go through poses, shape (K + 1, 2N).

        Collisions are not checked.

        Args:
            q: Positions of both arms, shape (2N,) [rad].
            poses: K poses X_WG of the hands [m].
            what: Name of the motion, for messages.

        Raises:
            NoPathError: If an arm does not reach a pose.
        """
        path = [q]
        for number, hands in enumerate(poses, 1):
            halves = []
            for arm, before, X_WG in zip(
                self.arms, np.split(path[-1], 2), hands, strict=True
            ):
                target = HandTarget.from_pose(X_WG)
                found = follow(arm.scene, target, before)
                if found is None:
                    why = solve_inverse_kinematics(
                        arm.scene, target, q_nominal=before, check_clearance=False
                    )
                    words = why.message if isinstance(why, IkFailure) else "it jumps"
                    where = f"{100.0 * number / len(poses):.0f} % along the way"
                    message = f"{what}, {arm.name}, {where}: {words}"
                    failure = PlanningFailure(Failure.OUT_OF_REACH, message)
                    raise NoPathError(failure)
                halves.append(found)
            path.append(np.concatenate(halves))
        return np.array(path)


def together(motions: Sequence[Trajectory]) -> Trajectory:
    """Return the motions of both arms as one; the shorter one is slowed down."""
    duration = max(motion.end_time() for motion in motions)
    both = StackedTrajectory(rowwise=True)
    for motion in motions:
        both.Append(stretched(motion, duration))
    return both


def stretched(trajectory: Trajectory, duration: float) -> Trajectory:
    """Return a motion, slowed down to last at least a duration [s]."""
    if trajectory.end_time() >= duration:
        return trajectory
    share = PiecewisePolynomial.FirstOrderHold(
        [0.0, duration], [[0.0, trajectory.end_time()]]
    )
    return PathParameterizedTrajectory(trajectory, share)


def minimum_jerk_motion(path: Vector, limits: Sequence[MotionLimits]) -> Trajectory:
    """Return the motion of both arms along a path of equal steps, from rest to rest.

    The share of the path follows the minimum-jerk profile of Flash and Hogan, J.
    Neurosci. 5(7), 1985. Points that move along a line in equal steps then have minimum
    jerk, too.

    Args:
        path: Postures of both, shape (K, 2N) [rad]; K >= 3.
        limits: Limits of each arm's joints. Torques are not checked.
    """
    shares = np.linspace(0.0, 1.0, len(path))
    spline = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(shares, path.T)
    in_a_second = _timed(spline, 1.0)
    times = np.linspace(0.0, 1.0, _TIMES)
    v = np.array([in_a_second.EvalDerivative(t, 1)[:, 0] for t in times])
    a = np.array([in_a_second.EvalDerivative(t, 2)[:, 0] for t in times])
    halves = zip(limits, np.split(v, 2, axis=1), np.split(a, 2, axis=1), strict=True)
    slow = max(limit.slowdown(*half) for limit, *half in halves)
    return _timed(spline, max(slow, 1e-2))  # even without motion


def _timed(path: PiecewisePolynomial, duration: float) -> Trajectory:
    T = duration
    # 10 (t/T)³ - 15 (t/T)⁴ + 6 (t/T)⁵
    profile = Polynomial([0.0, 0.0, 0.0, 10.0 / T**3, -15.0 / T**4, 6.0 / T**5])
    share = PiecewisePolynomial([np.array([[profile]])], [0.0, T])
    return PathParameterizedTrajectory(path, share)
