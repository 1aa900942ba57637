"""Joint velocities for a goal of the hand, and the interaction matrix of points.

Notation and equation numbers are those of F. Chaumette and S. Hutchinson, Visual servo
control, Part I: Basic approaches, IEEE Robotics & Automation Magazine 13(4), 2006. The
camera's frame has z into the scene, x to the right and y down the image. A twist of the
hand is [v; w], the velocity of its origin and its angular velocity [m/s], [rad/s].
"""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.planning.motion.arm_model import ArmModel
from drake_srg.types import Vector

_LEAST = 0.02  # singular value below which `track` damps a direction
_TRACKING, _TURNING = 0.25, 1.0  # largest speeds of `track` [m/s], [rad/s]
_SPEED = 0.9  # share of the joints' velocity limits that may be used


@dc.dataclass(frozen=True)
class JointStep:
    """A step of the joints towards a twist of the hand."""

    q: Vector  # shape (N,) [rad]
    achieved: float  # share of the twist that the step makes, 1 .. 0 or less


class ServoArm(ArmModel):
    """Kinematics of the model `arm` in a plant; the hand is `palm` of `gripper`.

    Args:
        plant: A finalized plant with both.

    Attributes:
        speed: Largest joint speeds, shape (N,) [rad/s].
        acceleration: The joints' largest accelerations, shape (N,) [rad/s²].
    """

    def __init__(self, plant: MultibodyPlant) -> None:
        gripper = plant.GetModelInstanceByName("gripper")
        palm = plant.GetFrameByName("palm", gripper)
        super().__init__(plant, plant.GetModelInstanceByName("arm"), gripper, palm)
        self.speed: Vector = _SPEED * plant.GetVelocityUpperLimits()[self.arm_indices]
        limits = plant.GetAccelerationUpperLimits()
        self.acceleration: Vector = limits[self.arm_indices]

    def step(self, q: Vector, twist: Vector, period: float, least: float) -> JointStep:
        """Return the joints after a step that moves the hand along a twist.

        Near singularities of the arm the step is damped. If a joint would be too fast,
        all joints slow down by the same factor, so the hand keeps its direction.

        Args:
            q: Positions of the joints, shape (N,) [rad].
            twist: Desired twist of the hand, shape (6,) [m/s], [rad/s].
            period: Duration of the step [s].
            least: Singular value of the Jacobian below which a direction is damped.
        """
        jacobian = self.jacobian(q)
        velocity = damped_solution(jacobian, twist, least).x
        slower: float = max(1.0, float(np.max(np.abs(velocity) / self.speed)))
        after = np.clip(q + period / slower * velocity, self.lower, self.upper)
        made = jacobian @ (after - q) / period
        return JointStep(after, float(made @ twist) / max(float(twist @ twist), 1e-12))

    def track(
        self, q: Vector, v: Vector, X_WG: RigidTransform, period: float
    ) -> tuple[Vector, Vector, PiecewisePolynomial]:
        """Return the joints after a step towards a pose of the hand, and the way there.

        They reach it within two periods, unless it takes more than their speeds and
        accelerations. The acceleration is constant. After the period, the trajectory
        goes on until the arm rests, in case that no further step follows.

        Args:
            q: Positions of the joints, shape (N,) [rad].
            v: Their velocities, shape (N,) [rad/s].
            X_WG: The hand's goal.
            period: Duration of the step [s].

        Returns:
            Positions and velocities after the step, and the trajectory.
        """
        # To reach the goal from here, the joints move on while they brake.
        ahead = q + 0.5 * period * v
        twist = hand_twist(
            self.X_WG(ahead), X_WG, gain=1.0 / period, speed=_TRACKING, turning=_TURNING
        )
        wanted = self.step(ahead, twist, period, _LEAST).q
        change = (wanted - ahead) / period - v
        most = float(np.max(np.abs(change) / (self.acceleration * period)))
        v_after = v + change / max(most, 1.0)
        q_after = q + 0.5 * period * (v + v_after)
        braking = max(float(np.max(np.abs(v_after) / self.acceleration)), period)
        way = PiecewisePolynomial.CubicHermite(
            [0.0, period, period + braking],
            np.column_stack([q, q_after, q_after + 0.5 * braking * v_after]),
            np.column_stack([v, v_after, np.zeros_like(v)]),
        )
        return q_after, v_after, way


def interaction_matrix(points: Vector, depths: Vector) -> Vector:
    """Return the matrix L with ds/dt = L v of points at rest (equation 11).

    v is the velocity of a camera that keeps its orientation [m/s].

    Args:
        points: Image coordinates x, y at focal length 1, shape (n, 2).
        depths: z of the points in the camera's frame [m], shape (n,).

    Returns:
        Shape (2 n, 3); the rows are x and y of each point.
    """
    x, y = np.asarray(points, dtype=float).T
    nearness = 1.0 / np.asarray(depths, dtype=float)
    zero = np.zeros_like(x)
    rows_x = [-nearness, zero, x * nearness]
    rows_y = [zero, -nearness, y * nearness]
    matrix = np.stack([np.stack(rows_x, axis=-1), np.stack(rows_y, axis=-1)], axis=1)
    return matrix.reshape(-1, 3)


@dc.dataclass(frozen=True)
class Solution:
    """A damped least-squares solution."""

    x: Vector  # shape (m,)
    # Least singular value of the matrix; 0 if it has fewer rows than columns.
    least: float


def damped_solution(matrix: Vector, b: Vector, least: float) -> Solution:
    """Return x with matrix x = b, damped where the matrix is nearly singular.

    The inverse of each singular value s becomes s / (s² + d²), where d² grows from 0 to
    `least`² as s falls below `least` (Nakamura and Hanafusa, J. Dyn. Sys. Meas. Control
    108, 1986). So x is never longer than b over `least` for any matrix, and exact if
    all singular values exceed `least`.

    Args:
        matrix: Shape (n, m).
        b: Shape (n,).
        least: Singular value below which a direction is damped.
    """
    u, s, vt = np.linalg.svd(matrix, full_matrices=False)
    damping = np.where(s < least, 1.0 - (s / least) ** 2, 0.0) * least**2
    inverse = s / np.maximum(s * s + damping, 1e-300)
    determined = len(s) == matrix.shape[1]
    return Solution(vt.T @ (inverse * (u.T @ b)), float(s[-1]) if determined else 0.0)


def image_displacement(
    points: Vector,
    depths: Vector,
    goal_points: Vector,
    goal_depths: Vector,
    least: float,
) -> Solution:
    """Return the displacement of the camera that takes points to their goals.

    It is -L^+ (s - s*) with L the mean of the interaction matrices here and at the
    goal. This choice couples large motions in depth and sideways the least (section
    "Choosing L").

    Args:
        points: Image coordinates at focal length 1, shape (n, 2).
        depths: Depths of the points [m], shape (n,).
        goal_points: Their goals, shape (n, 2).
        goal_depths: Their depths there [m], shape (n,).
        least: See `damped_solution`.

    Returns:
        A translation, shape (3,) [m], and the least singular value of the interaction
        matrix here.
    """
    here = interaction_matrix(points, depths)
    there = interaction_matrix(goal_points, goal_depths)
    error = (np.asarray(points) - goal_points).reshape(-1)
    found = damped_solution(0.5 * (here + there), -error, least)
    # The mean may hide directions that the points here do not determine.
    singular_values = np.linalg.svd(here, compute_uv=False)
    determined = len(singular_values) == here.shape[1]
    return Solution(found.x, float(singular_values[-1]) if determined else 0.0)


def rotation_vector(R: RotationMatrix) -> Vector:
    """Return angle times axis of a rotation, shape (3,) [rad]."""
    turn = R.ToAngleAxis()
    vector: Vector = turn.angle() * turn.axis()
    return vector


def turned(R: RotationMatrix, turn: Vector) -> RotationMatrix:
    """Return a rotation turned by a rotation vector in world [rad]."""
    angle = float(np.linalg.norm(turn))
    if angle < 1e-12:
        return R
    return RotationMatrix(AngleAxis(angle, turn / angle)) @ R


def upright(R: RotationMatrix) -> RotationMatrix:
    """Return the nearest rotation whose z is vertical."""
    z = R.col(2)
    turn = np.cross(z, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(turn))
    return R if sine < 1e-9 else turned(R, np.arctan2(sine, z[2]) / sine * turn)


def limited(vector: Vector, most: float) -> Vector:
    """Return a vector, shortened to the length `most` if necessary."""
    length = float(np.linalg.norm(vector))
    return vector if length <= most else vector * (most / length)


def behind(
    offset: Vector, axis: Vector, *, standoff: float, alignment: float, funnel: float
) -> float:
    """Return the distance behind its goal that an unaligned hand must keep [m].

    Args:
        offset: From the hand to its goal, shape (3,) [m].
        axis: Direction of approach, a unit vector, shape (3,).
        standoff: Greatest distance behind the goal [m].
        alignment: Distance from the line of approach at which the way is free [m].
        funnel: Distance behind the goal over the additional distance from that line.
    """
    aside = float(np.linalg.norm(offset - (offset @ axis) * axis))
    return min(standoff, funnel * max(0.0, aside - alignment))


def hand_twist(
    X_WG: RigidTransform,
    X_WG_goal: RigidTransform,
    *,
    gain: float,
    speed: float,
    turning: float,
) -> Vector:
    """Return the twist of the hand that makes its error decay.

    The error (translation, rotation vector) falls as exp(-gain t), on a straight line,
    as long as the limits allow: the second control law of position-based visual
    servoing in Chaumette and Hutchinson (2006), in world.

    Args:
        X_WG: The hand's pose [m].
        X_WG_goal: Its goal [m].
        gain: Share of the error per second.
        speed: Largest speed [m/s].
        turning: Largest turning rate [rad/s].

    Returns:
        [v; w] in world, shape (6,) [m/s], [rad/s].
    """
    away = X_WG_goal.translation() - X_WG.translation()
    turn = rotation_vector(X_WG_goal.rotation() @ X_WG.rotation().inverse())
    return np.concatenate([limited(gain * away, speed), limited(gain * turn, turning)])
