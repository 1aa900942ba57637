"""Limits of the arm's motions, and the torques of a motion."""

import dataclasses as dc

import numpy as np
from pydrake.multibody.tree import MultibodyForces

from drake_srg.config import Config, positive
from drake_srg.planning.motion.arm_model import ArmModel
from drake_srg.types import Vector


@dc.dataclass(kw_only=True)
class TipLimits(Config):
    """Limits of the tip along its path, by default those of the five-axis arm's thesis.

    Distance on a path is as in CoppeliaSim's `moveToPose` with the metric [1, 1, 1,
    angle_weight]: the norm of the tip's step and of the hand's turn times that weight.
    """

    velocity: float = dc.field(default=0.1, metadata=positive())  # m/s
    acceleration: float = dc.field(default=0.1, metadata=positive())  # m/s²
    jerk: float = dc.field(default=0.1, metadata=positive())  # m/s³
    # Weight of the hand's turns in the distance on a path [m/rad].
    angle_weight: float = dc.field(default=0.1, metadata={"ge": 0.0})

    def slowed(self, factor: float) -> "TipLimits":
        """Return the limits at which the same motions take `factor` times as long."""
        return dc.replace(
            self,
            velocity=self.velocity / factor,
            acceleration=self.acceleration / factor**2,
            jerk=self.jerk / factor**3,
        )


@dc.dataclass(kw_only=True)
class MotionConfig(Config):
    """Distances and speeds of moves."""

    # Length of the straight lines towards a grasp and back from it [m].
    approach_distance: float = dc.field(default=0.08, metadata=positive())
    # Height of straight lines up from the object and down to its goal [m].
    lift_height: float = dc.field(default=0.08, metadata=positive())
    # Share of the arm's velocity and acceleration limits with an empty hand.
    speed: float = dc.field(default=0.9, metadata={"ge": 0.01, "le": 1.0})
    # Shares of these limits with something in the hand.
    holding_speed: float = dc.field(default=0.7, metadata={"ge": 0.01, "le": 1.0})
    holding_acceleration: float = dc.field(
        default=0.3, metadata={"ge": 0.01, "le": 1.0}
    )
    # Limits of the tip's motion; null: as fast as the joints allow.
    tip_limits: TipLimits | None = None


@dc.dataclass(frozen=True)
class MotionLimits:
    """Limits of a trajectory, the same in both directions."""

    velocity: Vector  # shape (N,) [rad/s]
    acceleration: Vector  # shape (N,) [rad/s²]
    torque: Vector  # shape (N,) [N m]

    @staticmethod
    def of_plant(arm: ArmModel) -> "MotionLimits":
        """Return the limits that the arm's model states."""
        plant, indices = arm.plant, arm.arm_indices
        torque = np.full(plant.num_positions(), np.inf)
        for index in plant.GetJointActuatorIndices():
            actuator = plant.get_joint_actuator(index)
            torque[actuator.joint().position_start()] = actuator.effort_limit()
        return MotionLimits(
            plant.GetVelocityUpperLimits()[indices],
            plant.GetAccelerationUpperLimits()[indices],
            torque[indices],
        )

    def slowdown(self, v: Vector, a: Vector) -> float:
        """Return the factor on its duration at which a motion just keeps all limits.

        Args:
            v: Its velocities, shape (K, N) [rad/s].
            a: Its accelerations, shape (M, N) [rad/s²].
        """
        return float(
            max(
                np.max(np.abs(v) / self.velocity),
                np.sqrt(np.max(np.abs(a) / self.acceleration)),
            )
        )

    def scaled(
        self, velocity: float = 1.0, acceleration: float = 1.0, torque: float = 1.0
    ) -> "MotionLimits":
        """Return these limits times factors."""
        return dc.replace(
            self,
            velocity=velocity * self.velocity,
            acceleration=acceleration * self.acceleration,
            torque=torque * self.torque,
        )


class InverseDynamics:
    """Joint torques of an arm in motion, with its payload.

    Args:
        arm: The arm; its context is moved.
    """

    def __init__(self, arm: ArmModel) -> None:
        self._arm = arm
        self._no_forces = MultibodyForces(arm.plant)

    def SetPosition(self, q: Vector) -> None:
        """Move the arm to `q` (N,) [rad], for the torques there."""
        self._arm.plant.SetPositions(self._arm.context, self._arm.positions(q))

    def holding(self) -> Vector:
        """Return the torques that hold the arm against gravity, (N,) [N m]."""
        gravity: Vector = self._arm.plant.CalcGravityGeneralizedForces(
            self._arm.context
        )
        return -gravity[self._arm.arm_indices]

    def moving(self, v: Vector, a: Vector) -> Vector:
        """Return the torques of a motion beyond the holding torques, (N,) [N m].

        Args:
            v: Velocities, shape (N,) [rad/s].
            a: Accelerations, shape (N,) [rad/s²].
        """
        plant, indices = self._arm.plant, self._arm.arm_indices
        full = np.zeros(plant.num_velocities())
        full[indices] = v
        plant.SetVelocities(self._arm.context, full)
        full[indices] = a
        torques: Vector = plant.CalcInverseDynamics(
            self._arm.context, full, self._no_forces
        )
        return torques[indices]
