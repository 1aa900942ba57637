"""The SRG as the thesis drives it: four position-controlled joints."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.common.joint_errors import AddLatency
from drake_srg.gripper.driver_wiring import AddDriver, AddJointServos
from drake_srg.gripper.finger_layout import SRG_FINGERS, FingerLayout
from drake_srg.gripper.finger_sensing import AddFingerSensing, FingerSensingConfig
from drake_srg.gripper.minimum_jerk import MinimumJerkConfig, MinimumJerkReference
from drake_srg.gripper.servo import GripperServoConfig
from drake_srg.gripper.underactuation import (
    JOINT_NAMES,
    UnderactuationConfig,
    UnderactuationLogic,
)
from drake_srg.types import positive


def _default_servo() -> GripperServoConfig:
    # Joint torque limits tau are 2.0 N m (base) and 1.4 N m (tip), the inertia J that
    # a joint turns is almost only its motor's, 0.0037 and 0.0019 kg m² (srg.sdf).
    # Stiffness K = J w²: the base gets w = 40 rad/s, a thirtieth of the sample rate. A
    # fingertip pinch presses with the middle of its pad, 34 mm beyond the tip hinge
    # and 85 mm beyond the base hinge, when base and tip torque are as 85 : 34; both
    # joints have the same error there (Algorithm 1), so K_tip = K_base / 2.5.
    # K_P = K / tau; K_D = 2 sqrt(K J) / tau (critical); K_FF1 the joint's damping
    # over tau; K_FF2 = J / tau.
    base, tip = 0, 1
    tau = np.array([2.0, 1.4])
    inertia = np.array([0.0037, 0.0019])
    stiffness = inertia[base] * 40.0**2 * np.array([1.0, 1.0 / 2.5])
    damping = 0.01

    def per_joint(gain: np.ndarray) -> list[float]:
        return [float(gain[i]) for i in (base, base, tip, tip)]

    return GripperServoConfig(
        kp=per_joint(stiffness / tau),
        ki=[0.0] * 4,
        kd=per_joint(2.0 * np.sqrt(stiffness * inertia) / tau),
        kff1=per_joint(damping / tau),
        kff2=per_joint(inertia / tau),
    )


@dc.dataclass(kw_only=True)
class SrgPositionDriver(FingerSensingConfig):
    """Four position-controlled joints, as in the SRG thesis's V-REP model.

    closure -> UnderactuationLogic -> MinimumJerkReference -> GripperServo; the PWM
    times the joint's torque limit is the torque.
    """

    layout: ClassVar[FingerLayout] = SRG_FINGERS

    underactuation: UnderactuationConfig = dc.field(
        default_factory=UnderactuationConfig
    )
    minimum_jerk: MinimumJerkConfig = dc.field(default_factory=MinimumJerkConfig)
    servo: GripperServoConfig = dc.field(default_factory=_default_servo)
    # Torque at full PWM, over the model's effort limit: supplies sag, motors differ.
    motor_strength: float = dc.field(default=1.0, metadata=positive())


def AddSrgPositionDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: SrgPositionDriver | None = None,
    seed: int = 0,
) -> Diagram:
    """Add the driver of an SRG to a diagram and connect it to the (finalized) plant.

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
        output_ports:
        - state_measured
        - proximity
        - contact_force
        - contact_wrench
        - grasped
        - pwm
        - actuation

    `actuation` is the joints' torques [N m] in the order of the gripper's actuators. It
    and the inputs up to `body_poses` are connected here, but for `query_object`, which
    is the scene graph's. The others are as in the table of station ports, in the order
    of `JOINT_NAMES`.
    """
    config = config or SrgPositionDriver()
    inner = DiagramBuilder()
    period = config.servo.period
    sensing = AddFingerSensing(inner, plant, gripper, config, period=period, seed=seed)
    logic = inner.AddNamedSystem(
        "underactuation_logic", UnderactuationLogic(config.underactuation)
    )
    reference = inner.AddNamedSystem(
        "minimum_jerk_reference",
        MinimumJerkReference(np.zeros(len(JOINT_NAMES)), config.minimum_jerk),
    )
    inner.Connect(sensing.state_measured, logic.GetInputPort("state_measured"))
    inner.Connect(sensing.triggered, logic.GetInputPort("triggered"))
    inner.Connect(logic.get_output_port(), reference.get_input_port())
    latency = config.errors.latency
    closure = AddLatency(
        inner, logic.GetInputPort("closure_commanded"), latency, period
    )
    inner.ExportInput(closure, "closure_commanded")
    for name in ("joint_position_commanded", "hold"):
        inner.ExportInput(logic.GetInputPort(name), name)
    AddJointServos(
        inner,
        plant,
        gripper,
        config.joint_names,
        config.servo,
        strength=config.motor_strength,
        state_measured=sensing.state_measured,
        reference=reference.get_output_port(),
    )
    return AddDriver(builder, plant, gripper, inner)
