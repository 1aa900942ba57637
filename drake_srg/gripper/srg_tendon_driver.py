"""The SRG with its own drive: one motor that winds a wire per finger."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import MatrixGain

from drake_srg.common.joint_errors import AddLatency
from drake_srg.gripper.driver_wiring import (
    AddDriver,
    gripper_actuators,
    joint_to_actuator,
)
from drake_srg.gripper.finger_layout import SRG_FINGERS, FingerLayout
from drake_srg.gripper.finger_sensing import AddFingerSensing, FingerSensingConfig
from drake_srg.gripper.minimum_jerk import MinimumJerkConfig, MinimumJerkReference
from drake_srg.gripper.motor_temperature import (
    MotorTemperature,
    MotorTemperatureConfig,
)
from drake_srg.gripper.servo import GripperServo, GripperServoConfig
from drake_srg.gripper.spool_command import SpoolCommand, SpoolCommandConfig
from drake_srg.gripper.tendon import TendonDrive, TendonDriveConfig


def _default_motor_servo() -> GripperServoConfig:
    # As for the joints of SrgPositionDriver: K = J w² with w = 40 rad/s and J the
    # motor's at the spool, over its full torque. The back-EMF damps more than
    # critically (0.91 against 2 J w = 0.8 N m s/rad), and the first feedforward gain
    # makes up for it.
    drive = TendonDriveConfig()
    return GripperServoConfig(
        kp=[drive.reflected_inertia * 40.0**2 / drive.full_torque],
        ki=[0.0],
        kd=[0.0],
        kff1=[drive.motor_damping / drive.full_torque],
        kff2=[drive.reflected_inertia / drive.full_torque],
        # Stiff as it is, the servo presses with what this allows: 103 N at each wire.
        force_limit=1 / 3,
    )


@dc.dataclass(kw_only=True)
class SrgTendonDriver(FingerSensingConfig):
    """One motor that winds a wire per finger, as in the real SRG.

    closure -> SpoolCommand -> MinimumJerkReference -> GripperServo on the motor ->
    TendonDrive.
    """

    layout: ClassVar[FingerLayout] = SRG_FINGERS

    spool: SpoolCommandConfig = dc.field(default_factory=SpoolCommandConfig)
    # 4.5 rad/s at the spool is 0.87 of the motor's no-load speed at full scale.
    minimum_jerk: MinimumJerkConfig = dc.field(
        default_factory=lambda: MinimumJerkConfig(max_velocity=4.5)
    )
    servo: GripperServoConfig = dc.field(default_factory=_default_motor_servo)
    drive: TendonDriveConfig = dc.field(default_factory=TendonDriveConfig)
    temperature: MotorTemperatureConfig = dc.field(
        default_factory=MotorTemperatureConfig
    )


def SetTendonDynamics(
    plant: MultibodyPlant, gripper: ModelInstanceIndex, config: TendonDriveConfig
) -> None:
    """Prepare an SRG's joints for `AddSrgTendonDriver`, before the plant is finalized.

    The model's joints carry a share of the motor's inertia, friction and torque limit,
    for drivers without a motor of their own; with wires, the motor is on their other
    side.
    """
    for actuator in gripper_actuators(plant, gripper):
        actuator.set_default_rotor_inertia(0.0)
        actuator.set_effort_limit(np.inf)
        actuator.joint().set_default_damping(config.joint_damping)


def AddSrgTendonDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: SrgTendonDriver | None = None,
    seed: int = 0,
) -> Diagram:
    """Add the driver of an SRG to a diagram and connect it to the (finalized) plant.

    .. pydrake_system::

        name: SrgTendonDriver
        input_ports:
        - plant_state
        - query_object
        - contact_results
        - body_poses
        - closure_commanded
        - hold (optional)
        - force_limit (optional)
        - motor_position_commanded (optional)
        - motor_torque_commanded (optional)
        output_ports:
        - state_measured
        - proximity
        - contact_force
        - contact_wrench
        - grasped
        - pwm
        - motor_state
        - wire_force
        - motor_temperature
        - actuation

    As `AddSrgPositionDriver`, but `pwm` (1) is the motor's, so that `force_limit`
    limits its torque and its speed, and single joints cannot be commanded.
    `motor_state` and `wire_force` are those of `TendonDrive`, `motor_temperature` that
    of `MotorTemperature`.

    A finite `motor_position_commanded` (1), a spool angle [rad], goes before closure; a
    finite `motor_torque_commanded` (1), a fraction of the torque at full PWM, before
    both. `hold` goes before all of them, but not before `force_limit`. A motor without
    power is one with a torque of 0: the springs turn it back. See `SpoolCommand` and
    `GripperServo`.

    Call `SetTendonDynamics` before the plant is finalized.

    Raises:
        ValueError: If that was not done, or the plant is continuous.
    """
    config = config or SrgTendonDriver()
    if any(a.default_rotor_inertia() != 0.0 for a in gripper_actuators(plant, gripper)):
        raise ValueError(
            "the gripper's joints have rotors of their own: call SetTendonDynamics "
            "before the plant is finalized"
        )
    inner = DiagramBuilder()
    period = config.servo.period
    sensing = AddFingerSensing(inner, plant, gripper, config, period=period, seed=seed)
    command = inner.AddNamedSystem(
        "spool_command", SpoolCommand(config.drive.spool_radius, config.spool)
    )
    reference = inner.AddNamedSystem(
        "minimum_jerk_reference", MinimumJerkReference(np.zeros(1), config.minimum_jerk)
    )
    servo = inner.AddNamedSystem("servo", GripperServo(config.servo))
    # The wires are a spring of the fingers' own time scale: as often as the plant.
    step = plant.time_step()
    if step == 0.0:
        raise ValueError("wires need a discrete plant, this one is continuous")
    drive = inner.AddNamedSystem("tendon_drive", TendonDrive(config.drive, step))
    temperature = inner.AddNamedSystem(
        "motor_temperature", MotorTemperature(config.drive, config.temperature)
    )
    joints = inner.AddNamedSystem(
        "joints", MatrixGain(joint_to_actuator(plant, gripper, config.joint_names))
    )

    motor_state = drive.GetOutputPort("motor_state")
    inner.Connect(motor_state, command.GetInputPort("motor_state"))
    inner.Connect(motor_state, servo.GetInputPort("state_measured"))
    inner.Connect(sensing.triggered, command.GetInputPort("triggered"))
    inner.Connect(sensing.state_measured, drive.GetInputPort("state_measured"))
    inner.Connect(command.GetOutputPort("angle_desired"), reference.get_input_port())
    inner.Connect(
        command.GetOutputPort("torque_desired"), servo.GetInputPort("torque_commanded")
    )
    inner.Connect(reference.get_output_port(), servo.GetInputPort("reference"))
    inner.Connect(servo.get_output_port(), drive.GetInputPort("pwm"))
    inner.Connect(servo.get_output_port(), temperature.GetInputPort("pwm"))
    inner.Connect(motor_state, temperature.GetInputPort("motor_state"))
    inner.Connect(drive.GetOutputPort("joint_torque"), joints.get_input_port())

    latency = config.errors.latency
    closure = AddLatency(
        inner, command.GetInputPort("closure_commanded"), latency, period
    )
    inner.ExportInput(closure, "closure_commanded")
    for name in (
        "hold",
        *("motor_position_commanded", "motor_torque_commanded"),
    ):
        inner.ExportInput(command.GetInputPort(name), name)
    inner.ExportInput(servo.GetInputPort("force_limit"), "force_limit")
    inner.ExportOutput(servo.get_output_port(), "pwm")
    for name in ("motor_state", "wire_force"):
        inner.ExportOutput(drive.GetOutputPort(name), name)
    inner.ExportOutput(temperature.get_output_port(), "motor_temperature")
    inner.ExportOutput(joints.get_output_port(), "actuation")
    return AddDriver(builder, plant, gripper, inner)
