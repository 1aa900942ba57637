"""The SRG with its own drive: one motor that winds a wire per finger."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import MatrixGain

from drake_srg.common.actuators import joint_to_actuator, model_actuators
from drake_srg.gripper.driver import GripperControl, GripperDriver, WireMotor
from drake_srg.gripper.finger_layout import SRG_FINGERS, FingerLayout
from drake_srg.gripper.finger_sensing import FingerSensing
from drake_srg.gripper.minimum_jerk import MinimumJerkConfig, MinimumJerkReference
from drake_srg.gripper.moment_arms import empty_hand
from drake_srg.gripper.motor_temperature import (
    MotorTemperature,
    MotorTemperatureConfig,
)
from drake_srg.gripper.servo import GripperServo_, GripperServoConfig
from drake_srg.gripper.spool_command import SpoolCommand, SpoolCommandConfig
from drake_srg.gripper.tendon import TendonDrive_, TendonDriveConfig
from drake_srg.gripper.torque_control import TorqueControl
from drake_srg.types import Vector


def _default_motor_servo() -> GripperServoConfig:
    # As for the joints of SrgPositionDriver: K = J w² with w = 40 rad/s and J the
    # motor's inertia at the spool, over its full torque. The back-EMF damps more than
    # critically (0.91 against 2 J w = 0.8 N m s/rad), and the first feedforward gain
    # makes up for it.
    drive = TendonDriveConfig()
    return GripperServoConfig(
        kp=[drive.reflected_inertia * 40.0**2 / drive.full_torque],
        ki=[0.0],
        kd=[0.0],
        kff1=[drive.motor_damping / drive.full_torque],
        kff2=[drive.reflected_inertia / drive.full_torque],
        # The servo is so stiff that it presses with all that this allows: 103 N at
        # each wire.
        force_limit=1 / 3,
    )


@dc.dataclass(kw_only=True)
class SrgTendonDriver(GripperDriver):
    """One motor that winds a wire per finger, as in the real SRG.

    closure -> SpoolCommand -> MinimumJerkReference -> GripperServo on the motor ->
    TendonDrive.
    """

    layout: ClassVar[FingerLayout] = SRG_FINGERS
    # The wires are a spring of the fingers' own time scale, updated with the plant. On
    # an error-controlled plant, what they hold creeps (docs/speed.md).
    needs_discrete_plant: ClassVar[bool] = True

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

    @property
    def num_motors(self) -> int:
        """One motor moves all joints."""
        return 1

    @property
    def wire_motor(self) -> WireMotor | None:
        """That motor."""
        return self

    def empty_hand(self, closure: float) -> tuple[float, Vector]:
        """See `GripperDriver`."""
        config = self.spool
        return empty_hand(closure, config.full_scale, config.base_limit)

    def prepare_plant(self, plant: MultibodyPlant, gripper: ModelInstanceIndex) -> None:
        """See `GripperDriver` and `SetTendonDynamics`."""
        SetTendonDynamics(plant, gripper, self.drive)

    def AddControl(
        self,
        inner: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        sensing: FingerSensing,
    ) -> GripperControl:
        """See `GripperDriver`.

        Raises:
            ValueError: If `prepare_plant` was not called, or the plant is continuous.
        """
        actuators = model_actuators(plant, gripper)
        if any(actuator.default_rotor_inertia() != 0.0 for actuator in actuators):
            raise ValueError(
                "the gripper's joints have rotors of their own: call SetTendonDynamics "
                "before the plant is finalized"
            )
        command = inner.AddNamedSystem(
            "spool_command", SpoolCommand(self.drive.spool_radius, self.spool)
        )
        reference = inner.AddNamedSystem(
            "minimum_jerk_reference",
            MinimumJerkReference(np.zeros(1), self.minimum_jerk),
        )
        servo = inner.AddNamedSystem("servo", GripperServo_[float](self.servo))
        step = plant.time_step()
        if step == 0.0:
            raise ValueError("wires need a discrete plant, got a continuous one")
        drive = inner.AddNamedSystem(
            "tendon_drive", TendonDrive_[float](self.drive, step)
        )
        temperature = inner.AddNamedSystem(
            "motor_temperature", MotorTemperature(self.drive, self.temperature)
        )
        joints = inner.AddNamedSystem(
            "joints", MatrixGain(joint_to_actuator(plant, gripper, self.joint_names))
        )

        angle, torque = (
            command.GetOutputPort(name) for name in ("angle_desired", "torque_desired")
        )
        if self.drive.dead_band or self.drive.torque_rise:
            control = TorqueControl(self.drive, self.servo.period)
            inner.AddNamedSystem("torque_control", control)
            inner.Connect(torque, control.get_input_port())
            torque = control.get_output_port()
        pwm = servo.get_output_port()
        motor_state = drive.GetOutputPort("motor_state")
        for source, target in (
            (motor_state, command.GetInputPort("motor_state")),
            (sensing.triggered, command.GetInputPort("triggered")),
            (angle, reference.get_input_port()),
            (angle, servo.GetInputPort("position_desired")),
            (torque, servo.GetInputPort("torque_commanded")),
            (reference.get_output_port(), servo.GetInputPort("reference")),
            (motor_state, servo.GetInputPort("state_measured")),
            (pwm, drive.GetInputPort("pwm")),
            (sensing.state_measured, drive.GetInputPort("state_measured")),
            (pwm, temperature.GetInputPort("pwm")),
            (motor_state, temperature.GetInputPort("motor_state")),
            (drive.GetOutputPort("joint_torque"), joints.get_input_port()),
        ):
            inner.Connect(source, target)

        commands = (
            *("closure_commanded", "hold"),
            *("motor_position_commanded", "motor_torque_commanded"),
        )
        return GripperControl(
            inputs={
                **{name: command.GetInputPort(name) for name in commands},
                "force_limit": servo.GetInputPort("force_limit"),
            },
            outputs={
                "pwm": pwm,
                "motor_state": motor_state,
                "wire_force": drive.GetOutputPort("wire_force"),
                "motor_temperature": temperature.get_output_port(),
                "actuation": joints.get_output_port(),
            },
        )


def SetTendonDynamics(
    plant: MultibodyPlant, gripper: ModelInstanceIndex, config: TendonDriveConfig
) -> None:
    """Prepare an SRG's joints for `AddSrgTendonDriver`, before the plant is finalized.

    The model's joints carry a share of the motor's inertia, friction and torque limit,
    for drivers without a motor of their own. With wires, the motor is on their other
    side.

    Args:
        plant: With the gripper, not yet finalized.
        gripper: Its model instance.
        config: Of the drive.
    """
    for actuator in model_actuators(plant, gripper):
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
        - motor_position_commanded (optional)
        - motor_torque_commanded (optional)
        - force_limit (optional)
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

    The ports are those of `AddSrgPositionDriver`, except that single joints cannot be
    commanded, and that `pwm` (1) is the motor's, so `force_limit` limits its torque and
    its speed. See `TendonDrive` for `motor_state` and `wire_force`, and
    `MotorTemperature` for `motor_temperature`.

    Commands, the strongest first:

    * `hold`;
    * a finite `motor_torque_commanded` (1), a fraction of the torque at full PWM: 0 is
      a motor without power, which the springs turn back;
    * a finite `motor_position_commanded` (1), a spool angle [rad];
    * `closure_commanded`.

    `force_limit` holds for all of them. See `SpoolCommand` and `GripperServo`.

    Call `SetTendonDynamics` before the plant is finalized.

    Args:
        builder: Of the diagram.
        plant: With the gripper, finalized.
        gripper: Its model instance.
        config: Of the driver.
        seed: Of the encoders' noise.

    Raises:
        ValueError: If `SetTendonDynamics` was not called, or the plant is continuous.
    """
    return (config or SrgTendonDriver()).AddDriver(builder, plant, gripper, seed)
