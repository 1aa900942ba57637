"""What servos move: where their state comes from, and which ports their commands set.

Angles of motors are positive clockwise, as in `Motor`.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar

import numpy as np

from drake_srg.bridges.commands import PortValues, gripper_command
from drake_srg.bridges.dynamixel.encoder import JOINT
from drake_srg.bridges.dynamixel.motor import Motor, MotorCommand, SpoolMotor
from drake_srg.gripper.driver import WireMotor
from drake_srg.scenario import Scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector

_AMBIENT = 25.0  # degrees Celsius, of motors whose heat is not simulated

# Angle [rad], speed [rad/s], fraction of full PWM, temperature [degrees Celsius].
Sensed = tuple[float, float, float, float]


class Mechanism(abc.ABC):
    """A part of a station that one or more servos move.

    Attributes:
        ports: Names of the station's output ports with the state of the motors.
        commanded: The input port whose last source is in command of the motors.
        motors: One per servo.
    """

    ports: ClassVar[Collection[str]]
    commanded: ClassVar[str]
    motors: Sequence[Motor]

    @abc.abstractmethod
    def sense(self, values: Mapping[str, Vector]) -> Sequence[Sensed]:
        """Return the state of each motor from the values of `ports`."""

    @abc.abstractmethod
    def command(self, commands: Sequence[MotorCommand | None]) -> PortValues:
        """Return values of the station's input ports for a command per motor.

        A motor without a command, None, stays as it is.
        """


class WiredGripper(Mechanism):
    """An SRG whose wires one motor winds.

    Args:
        motor: The motor.
    """

    ports = ("gripper.motor_state", "gripper.pwm", "gripper.motor_temperature")
    commanded = "gripper.motor_position_commanded"

    def __init__(self, motor: WireMotor):
        self.motors = [SpoolMotor(motor)]

    def sense(self, values: Mapping[str, Vector]) -> Sequence[Sensed]:
        """See `Mechanism`."""
        (angle, speed), (pwm,), (temperature,) = (values[name] for name in self.ports)
        return [(float(angle), float(speed), float(pwm), float(temperature))]

    def command(self, commands: Sequence[MotorCommand | None]) -> PortValues:
        """See `Mechanism`."""
        (command,) = commands
        if command is None:
            return {}
        values = {
            self.commanded: np.array([command.position]),
            "gripper.motor_torque_commanded": np.array([command.torque]),
            "gripper.force_limit": np.array([command.limit]),
        }
        return gripper_command(values, values)


class Arm(Mechanism):
    """An arm with a servo per joint, which turns the joint's way: its zero is 2048.

    The joints hold their positions also without torque, and whatever limits it: the
    simulated arm has no input for that.

    Args:
        lower: Position limits, shape (N,) [rad].
        upper: Position limits, shape (N,) [rad].
        effort: Torque at full PWM, shape (N,) [N m].
    """

    ports = ("arm.state_measured", "arm.torque_measured")
    commanded = "arm.position_desired"

    def __init__(self, lower: Vector, upper: Vector, effort: Vector):
        self.motors = [Motor(JOINT) for _ in effort]
        self._lower, self._upper, self._effort = lower, upper, effort

    def sense(self, values: Mapping[str, Vector]) -> Sequence[Sensed]:
        """See `Mechanism`."""
        state, torque = (values[name] for name in self.ports)
        q, v = np.split(-state, 2)
        pwm = np.clip(-torque / self._effort, -1.0, 1.0)
        temperature = np.full(len(q), _AMBIENT)
        return [tuple(row) for row in np.c_[q, v, pwm, temperature].tolist()]

    def command(self, commands: Sequence[MotorCommand | None]) -> PortValues:
        """See `Mechanism`; NaN leaves a joint where it is."""
        q = np.array([math.nan if c is None else -c.position for c in commands])
        return {self.commanded: np.clip(q, self._lower, self._upper)}


class ServoGripper(Mechanism):
    """A gripper with one servo for closure, which obeys its own driver otherwise.

    Closing raises the position from 2048.

    Args:
        travel: Angle of the first joint at closure 1 [rad].
        joints: Number of joints that its driver commands.
    """

    ports = ("gripper.state_measured", "gripper.pwm")
    commanded = "gripper.closure_commanded"

    def __init__(self, travel: float, joints: int):
        self.motors = [Motor(JOINT)]
        self._travel, self._joints = travel, joints

    def sense(self, values: Mapping[str, Vector]) -> Sequence[Sensed]:
        """See `Mechanism`."""
        state, pwm = (values[name] for name in self.ports)
        q, v = np.split(-state, 2)
        return [(float(q[0]), float(v[0]), float(-pwm[0]), _AMBIENT)]

    def command(self, commands: Sequence[MotorCommand | None]) -> PortValues:
        """See `Mechanism`; without torque, the fingers are free."""
        (command,) = commands
        if command is None:
            return {}
        values = {"gripper.force_limit": np.array([command.limit])}
        if math.isnan(command.position):
            values["gripper.force_limit"] = np.zeros(1)
        else:
            closure = min(max(-command.position / self._travel, 0.0), 1.0)
            values[self.commanded] = np.array([closure])
        ports = {*values, "gripper.joint_position_commanded"}
        return gripper_command(ports, values, self._joints)


def station_mechanisms(scenario: Scenario) -> list[Mechanism]:
    """Return what the servos of a scenario's station move, in the order of their IDs.

    An arm of servos has its gripper's on the same bus.

    Raises:
        ScenarioError: If no one servo closes the gripper of an arm of servos.
        ValueError: If the station has no servos.
    """
    arm, gripper = scenario.arm, scenario.gripper
    mechanisms: list[Mechanism] = []
    if arm is not None and arm.bus_servos:
        if arm.limits is None:
            raise ValueError("--servo: arm.limits: must be given, got null")
        plant = MakeModelsPlant(scenario)
        model = plant.GetModelInstanceByName("arm")
        motors = [plant.get_joint_actuator(a) for a in plant.GetJointActuatorIndices()]
        motors = [motor for motor in motors if motor.model_instance() == model]
        lower = [motor.joint().position_lower_limits()[0] for motor in motors]
        upper = [motor.joint().position_upper_limits()[0] for motor in motors]
        effort = [arm.motor_strength * motor.effort_limit() for motor in motors]
        mechanisms.append(Arm(np.array(lower), np.array(upper), np.array(effort)))
    if gripper is not None and gripper.wire_motor is not None:
        mechanisms.append(WiredGripper(gripper.wire_motor))
    elif gripper is not None and mechanisms:
        _, joints = gripper.empty_hand(1.0)
        mechanisms.append(ServoGripper(float(joints[0]), len(joints)))
    if not mechanisms:
        raise ValueError(
            "--servo: needs a gripper with a wire motor (!SrgTendonDriver, as in "
            "kitchen_tendon) or an arm of servos (arm.bus_servos, as in assistive_arm)"
        )
    return mechanisms
