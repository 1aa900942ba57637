"""The SRG with its real drive: one servo, a spool, and a wire per finger."""

import dataclasses as dc
import math
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues
from pydrake.systems.primitives import MatrixGain

from drake_srg.common.srg_geometry import SRG
from drake_srg.common.systems import joint_to_actuator, model_actuators, value_or_none
from drake_srg.config import Config, positive
from drake_srg.gripper.driver import (
    FingerSensing,
    GripperControl,
    GripperDriver,
    WireMotor,
)
from drake_srg.gripper.sensors import SRG_FINGERS, FingerLayout
from drake_srg.gripper.servo import (
    GripperServo,
    GripperServoConfig,
    MinimumJerkConfig,
    MinimumJerkReference,
)
from drake_srg.gripper.tendon import (
    MotorTemperature,
    MotorTemperatureConfig,
    TendonDrive,
    TendonDriveConfig,
    empty_hand,
)
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector


@dc.dataclass(kw_only=True)
class SpoolCommandConfig(Config):
    """Parameters of the map from closure to spool angle."""

    # Base plus tip angle of an empty hand at closure 1 [rad], as in
    # `UnderactuationConfig`.
    full_scale: float = dc.field(default=SRG.full_scale, metadata=positive())
    # Limit of the base, beyond which the tip closes [rad]. The fitted moment arms end
    # at 2.007 rad.
    base_limit: float = dc.field(default=SRG.joint_limit, metadata=positive(le=2.007))
    period: float = dc.field(default=0.01, metadata=positive())  # s


def spool_angle(
    closure: float, spool_radius: float, config: SpoolCommandConfig
) -> float:
    """Return the spool angle at which an empty hand has a given closure [rad].

    So closure means the same as for `SrgPositionDriver`; see `empty_hand`.

    Args:
        closure: 0 open .. 1 closed, clipped.
        spool_radius: [m].
        config: The map from closure to spool angle.
    """
    travel, _ = empty_hand(closure, config.full_scale, config.base_limit)
    return travel / spool_radius


class SpoolCommand(LeafSystem):
    """Turns closure, or commands to the motor, into a target of the spool.

    .. pydrake_system::

        name: SpoolCommand
        input_ports:
        - closure_commanded
        - motor_state
        - triggered
        - hold (optional)
        - motor_position_commanded (optional)
        - motor_torque_commanded (optional)
        - taut_state (optional)
        output_ports:
        - angle_desired
        - torque_desired

    The outputs, updated every `config.period`, are `angle_desired` (1) [rad] and
    `torque_desired` (1), a fraction of the torque at full PWM. The torque is NaN while
    the motor follows the angle. Commands, in order of priority:

    * `hold` (1): while nonzero, the hand keeps its state. If a sensor, `triggered` (4),
      fired when the hold began, the target (or a torque that winds the spool) stays,
      and with it the grip. Otherwise, the spool keeps its angle at that time, from
      `motor_state` (2).
    * `motor_torque_commanded` (1): a torque, if finite. Meanwhile, the target follows
      the spool, so that position control can take over from there.
    * `motor_position_commanded` (1): a spool angle [rad], if finite.
    * `closure_commanded` (1): 0 open .. 1 closed, clipped, NaN ignored.

    When a simulation starts, the target is the angle of `taut_state` (2).

    Args:
        spool_radius: [m].
        config: The map from closure to spool angle.
    """

    def __init__(
        self, spool_radius: float, config: SpoolCommandConfig | None = None
    ) -> None:
        super().__init__()
        self.config = config or SpoolCommandConfig()
        self._spool_radius = spool_radius
        self._closure, self._motor, self._triggered, self._hold, *self._commands = (
            self.DeclareVectorInputPort(name=name, size=size)
            for name, size in (
                ("closure_commanded", 1),
                ("motor_state", 2),
                ("triggered", 4),
                ("hold", 1),
                ("motor_position_commanded", 1),
                ("motor_torque_commanded", 1),
            )
        )
        self._taut = self.DeclareVectorInputPort(name="taut_state", size=2)
        self._target, self._torque, self._holding = (
            self.DeclareDiscreteState([value]) for value in (0.0, np.nan, 0.0)
        )
        self.DeclareStateOutputPort("angle_desired", self._target)
        self.DeclareStateOutputPort("torque_desired", self._torque)
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _initialize(self, context: Context, discrete_state: DiscreteValues) -> None:
        taut = value_or_none(self._taut, context)
        if taut is not None:
            discrete_state.set_value(self._target, taut[:1])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        target, torque, was_holding = (
            float(context.get_discrete_state(index).value()[0])
            for index in (self._target, self._torque, self._holding)
        )
        hold = value_or_none(self._hold, context)
        holding = hold is not None and hold[0] != 0.0
        closure, angle = (
            float(port.Eval(context)[0]) for port in (self._closure, self._motor)
        )
        position, torque_commanded = (
            math.nan if command is None else float(command[0])
            for command in (value_or_none(port, context) for port in self._commands)
        )
        gripping = self._triggered.Eval(context).any() and not torque <= 0.0
        if not holding:
            torque = torque_commanded
            if math.isfinite(position):
                target = position
            elif math.isfinite(closure):
                target = spool_angle(closure, self._spool_radius, self.config)
        elif not was_holding and not gripping:
            target, torque = angle, math.nan
        if math.isfinite(torque):
            target = angle
        for index, value in (
            (self._target, target),
            (self._torque, torque),
            (self._holding, float(holding)),
        ):
            discrete_state.set_value(index, [value])


class TorqueControl(LeafSystem):
    """Integrates to the PWM that gives a desired torque, like the servo's firmware.

    .. pydrake_system::

        name: TorqueControl
        input_ports:
        - torque_desired
        output_ports:
        - pwm_desired

    `torque_desired` (1) is a fraction of the torque at rest at full PWM without dead
    band. It is NaN while the motor controls its position. `pwm_desired` (1) is the
    fraction of full PWM that gives this torque, updated every `period`, or NaN. If
    `drive.torque_rise` is 0, it gives the torque at once. Otherwise, it starts from 0:

        pwm' = (torque_desired - useful(pwm)) / torque_rise

    Args:
        drive: The motor.
        period: Period of the updates [s].
    """

    def __init__(self, drive: TendonDriveConfig, period: float) -> None:
        super().__init__()
        self._drive, self._period = drive, period
        self._torque = self.DeclareVectorInputPort(name="torque_desired", size=1)
        pwm = self.DeclareDiscreteState([np.nan])
        self.DeclareStateOutputPort("pwm_desired", pwm)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        drive, torque = self._drive, self._torque.Eval(context)[0]
        before = context.get_discrete_state(0).value()[0]
        if not np.isfinite(torque):
            pwm = np.nan
        elif drive.torque_rise == 0.0:
            size = drive.pwm_of(abs(torque)) if torque else 0.0
            pwm = np.copysign(size, torque)
        else:
            pwm = before if np.isfinite(before) else 0.0
            error = torque - drive.useful_pwm(pwm)
            # With a shorter rise than this, updates would overshoot and never settle.
            rise = max(drive.torque_rise, self._period / (1.0 - drive.dead_band))
            pwm += self._period * error / rise
        discrete_state.set_value([np.clip(pwm, -1.0, 1.0)])


def _default_motor_servo() -> GripperServoConfig:
    # Gains as in SrgPositionDriver: K = J w² with w = 40 rad/s and J the motor's
    # inertia at the spool, over its full torque. The back-EMF overdamps the motor (0.91
    # against 2 J w = 0.8 N m s/rad), and the first feedforward gain compensates for it.
    drive = TendonDriveConfig()
    return GripperServoConfig(
        kp=[drive.reflected_inertia * 40.0**2 / drive.full_torque],
        ki=[0.0],
        kd=[0.0],
        kff1=[drive.motor_damping / drive.full_torque],
        kff2=[drive.reflected_inertia / drive.full_torque],
        # The servo is so stiff that it always presses as hard as this limit allows: 103
        # N at each wire.
        force_limit=1 / 3,
    )


@dc.dataclass(kw_only=True)
class SrgTendonDriver(GripperDriver):
    """One motor that winds a wire per finger, as in the real SRG.

    closure -> SpoolCommand -> MinimumJerkReference -> GripperServo on the motor ->
    TendonDrive.

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

    The ports are those of `SrgPositionDriver`, except that single joints cannot be
    commanded, and that `pwm` (1) is that of the one motor. So `force_limit` limits the
    motor's torque and speed, with all commands. See `SpoolCommand` for the commands and
    their priority, `TendonDrive` for `motor_state` and `wire_force`, and
    `MotorTemperature` for `motor_temperature`. With a `motor_torque_commanded` of 0,
    the motor has no power, and the springs turn it back.

    Call `prepare_plant` before the plant is finalized.
    """

    layout: ClassVar[FingerLayout] = SRG_FINGERS
    # The wires' dynamics are as fast as the fingers', so they are updated with the
    # plant's steps. On an error-controlled plant, held objects creep (docs/speed.md).
    needs_discrete_plant: ClassVar[bool] = True

    spool: SpoolCommandConfig = dc.field(default_factory=SpoolCommandConfig)
    # 4.5 rad/s at the spool is 0.87 times the motor's no-load speed at full scale.
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
        """The motor that winds the wires."""
        return self

    def empty_hand(self, closure: float) -> tuple[float, Vector]:
        """Return the wire's travel [m] for an empty hand, and its joints [rad]."""
        config = self.spool
        return empty_hand(closure, config.full_scale, config.base_limit)

    def prepare_plant(self, plant: MultibodyPlant, gripper: ModelInstanceIndex) -> None:
        """Prepare the plant for the driver; see `SetTendonDynamics`."""
        SetTendonDynamics(plant, gripper, self.drive)

    def AddControl(
        self,
        inner: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        sensing: FingerSensing,
    ) -> GripperControl:
        """Add the systems from commands to the actuators, and return their ports.

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
        servo = inner.AddNamedSystem("servo", GripperServo(self.servo))
        step = plant.time_step()
        if step == 0.0:
            raise ValueError("wires need a discrete plant, got a continuous one")
        drive = inner.AddNamedSystem("tendon_drive", TendonDrive(self.drive, step))
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
            (drive.GetOutputPort("taut_state"), command.GetInputPort("taut_state")),
            (
                drive.GetOutputPort("taut_state"),
                reference.GetInputPort("state_measured"),
            ),
            (sensing.triggered, command.GetInputPort("triggered")),
            (angle, reference.GetInputPort("position_desired")),
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
    """Prepare an SRG's joints for its wires, before the plant is finalized.

    In the model file, each joint has a share of the motor's inertia, friction and
    torque limit, for drivers that do not model the motor. Here, the motor is at the
    other end of the wires, so these shares are removed.

    Args:
        plant: Plant with the gripper, not yet finalized.
        gripper: Its model instance.
        config: Configuration of the drive.
    """
    for actuator in model_actuators(plant, gripper):
        actuator.set_default_rotor_inertia(0.0)
        actuator.set_effort_limit(np.inf)
        actuator.joint().set_default_damping(config.joint_damping)
