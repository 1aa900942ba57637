"""The SRG as its thesis drives it: four position-controlled joints."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.systems import input_ports
from drake_srg.gripper.driver import FingerSensing, GripperControl
from drake_srg.gripper.joint_servos import AddJointServos, JointServoDriver
from drake_srg.gripper.sensors import SRG_FINGERS, FingerLayout
from drake_srg.gripper.servo import (
    GripperServoConfig,
    MinimumJerkConfig,
    MinimumJerkReference,
)
from drake_srg.gripper.tendon import empty_hand
from drake_srg.gripper.underactuation import (
    JOINT_NAMES,
    UnderactuationConfig,
    UnderactuationLogic,
)
from drake_srg.types import Vector


def _default_servo() -> GripperServoConfig:
    # The joint torque limits tau are 2.0 N m (base) and 1.4 N m (tip). A joint's
    # inertia J is almost only its motor's, 0.0037 and 0.0019 kg m² (srg.sdf). Stiffness
    # K = J w²: the base gets w = 40 rad/s, a thirtieth of the sample rate. The pad's
    # middle is 34 mm beyond the tip hinge and 85 mm beyond the base hinge. A fingertip
    # pinch presses there if the base and tip torques have the ratio 85 : 34. With
    # Algorithm 1, both joints have the same position error, so K_tip = K_base / 2.5.
    # K_P = K / tau; K_D = 2 sqrt(K J) / tau (critical); K_FF1 is the joint's damping
    # over tau; K_FF2 = J / tau.
    base, tip = 0, 1
    tau = np.array([2.0, 1.4])
    inertia = np.array([0.0037, 0.0019])
    stiffness = inertia[base] * 40.0**2 * np.array([1.0, 1.0 / 2.5])
    damping = 0.01

    def per_joint(gain: Vector) -> list[float]:
        return [float(gain[i]) for i in (base, base, tip, tip)]

    return GripperServoConfig(
        kp=per_joint(stiffness / tau),
        ki=[0.0] * 4,
        kd=per_joint(2.0 * np.sqrt(stiffness * inertia) / tau),
        kff1=per_joint(damping / tau),
        kff2=per_joint(inertia / tau),
    )


@dc.dataclass(kw_only=True)
class SrgPositionDriver(JointServoDriver):
    """Four position-controlled joints, as in the SRG thesis's V-REP model.

    closure -> UnderactuationLogic -> MinimumJerkReference -> GripperServo. The torque
    is the PWM times the joint's torque limit.

    .. pydrake_system::

        name: SrgPositionDriver
        input_ports:
        - plant_state
        - query_object
        - contact_results
        - body_poses
        - closure_commanded
        - joint_position_commanded (optional)
        - hold (optional)
        - force_limit (optional)
        - closure_messages (with per_message)
        output_ports:
        - state_measured
        - proximity
        - contact_force
        - contact_wrench
        - grasped
        - pwm
        - actuation
        - desired_state (servo.law plant)

    `AddDriver` connects `plant_state`, `contact_results`, `body_poses` and `actuation`,
    the joint torques [N m] in the order of the gripper's actuators. It also connects
    `desired_state` (8), [q; v] of the plant's PD actuators in that order, and, given
    the scene graph, `query_object`. The fingers move from their initial positions. The
    other ports:

    * `closure_commanded` (1): 0 open .. 1 closed;
    * `joint_position_commanded` (4) [rad]: a finite entry overrides the joint's target
      from closure;
    * `hold` (1): while nonzero, the fingers keep their positions and their grip;
    * `force_limit` (1): largest PWM, a fraction 0 .. 1 of full scale;
    * `closure_messages` (1): number of messages so far that commanded a closure;
    * `state_measured` (8): [q; v] in rad, rad/s;
    * `proximity` (4) [m], `contact_force` (4) [N], `contact_wrench` (24) [N m, N]: see
      `ProximitySensors` and `ContactForceSensors`;
    * `grasped` (1): see `GraspDetector`;
    * `pwm` (4): fraction of full scale.

    Joints and sensors are in the order of `JOINT_NAMES`.
    """

    layout: ClassVar[FingerLayout] = SRG_FINGERS

    underactuation: UnderactuationConfig = dc.field(
        default_factory=UnderactuationConfig
    )
    minimum_jerk: MinimumJerkConfig = dc.field(default_factory=MinimumJerkConfig)
    servo: GripperServoConfig = dc.field(default_factory=_default_servo)

    def empty_hand(self, closure: float) -> tuple[float, Vector]:
        """Return the travel of one motor for an empty hand, and its joints [rad]."""
        config = self.underactuation
        return empty_hand(closure, config.full_scale, config.base_limit)

    def AddControl(
        self,
        inner: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        sensing: FingerSensing,
    ) -> GripperControl:
        """Add the systems from commands to the actuators, and return their ports."""
        logic = inner.AddNamedSystem(
            "underactuation_logic", UnderactuationLogic(self.underactuation)
        )
        reference = inner.AddNamedSystem(
            "minimum_jerk_reference",
            MinimumJerkReference(np.zeros(len(JOINT_NAMES)), self.minimum_jerk),
        )
        inner.Connect(sensing.state_measured, logic.GetInputPort("state_measured"))
        inner.Connect(sensing.triggered, logic.GetInputPort("triggered"))
        inner.Connect(sensing.state_measured, reference.GetInputPort("state_measured"))
        inner.Connect(
            logic.get_output_port(), reference.GetInputPort("position_desired")
        )
        servos = AddJointServos(
            inner,
            plant,
            gripper,
            self.joint_names,
            self.servo,
            strength=self.motor_strength,
            state_measured=sensing.state_measured,
            reference=reference.get_output_port(),
            position_desired=logic.get_output_port(),
        )
        measured = ("state_measured", "triggered")
        inputs = {k: v for k, v in input_ports(logic).items() if k not in measured}
        return GripperControl({**inputs, **servos.inputs}, servos.outputs)
