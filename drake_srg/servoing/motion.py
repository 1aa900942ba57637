"""From a goal pose to a twist of the hand, and from a twist to joint velocities."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.servoing.interaction import damped_solution
from drake_srg.types import Vector


def rotation_vector(R: RotationMatrix) -> Vector:
    """Return angle times axis of a rotation, shape (3,) [rad]."""
    turn = R.ToAngleAxis()
    vector: Vector = turn.angle() * turn.axis()
    return vector


def limited(vector: Vector, most: float) -> Vector:
    """Return a vector, shortened to the length `most` if it is longer."""
    length = float(np.linalg.norm(vector))
    return vector if length <= most else vector * (most / length)


def behind(
    offset: Vector, axis: Vector, *, standoff: float, alignment: float, funnel: float
) -> float:
    """Return how far behind its goal a hand must stay that is not aligned [m].

    Args:
        offset: From the hand to its goal, shape (3,) [m].
        axis: Direction of approach, a unit vector, shape (3,).
        standoff: Greatest distance behind the goal [m].
        alignment: Distance from the line of approach that leaves the way free [m].
        funnel: Distance behind the goal per further distance from that line.
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
    """Return the twist of the hand that lets its error decay.

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


@dc.dataclass(frozen=True)
class JointStep:
    """A step of the joints towards a twist of the hand."""

    q: Vector  # shape (N,) [rad]
    achieved: float  # share of the twist that the step makes, 1 .. 0 or less


def joint_step(
    q: Vector,
    jacobian: Vector,
    twist: Vector,
    period: float,
    *,
    least: float,
    speed: Vector,
    lower: Vector,
    upper: Vector,
) -> JointStep:
    """Return the joints after a step that moves the hand along a twist.

    Near singularities of the arm the step is damped. If a joint would be too fast, all
    are slowed alike, so that the hand keeps its direction.

    Args:
        q: Positions of the joints, shape (N,) [rad].
        jacobian: Of the hand's twist [v; w], shape (6, N).
        twist: What the hand must do, shape (6,) [m/s], [rad/s].
        period: Duration of the step [s].
        least: Singular value of the Jacobian below which a direction is damped.
        speed: Largest joint speeds, shape (N,) [rad/s].
        lower: Lower limits of the joints, shape (N,) [rad].
        upper: Upper limits of the joints, shape (N,) [rad].
    """
    velocity = damped_solution(jacobian, twist, least).x
    slower: float = max(1.0, float(np.max(np.abs(velocity) / speed)))
    following = np.clip(q + period / slower * velocity, lower, upper)
    made = jacobian @ (following - q) / period
    return JointStep(following, float(made @ twist) / max(float(twist @ twist), 1e-12))
