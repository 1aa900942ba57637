"""A simulated gripper and its servo's registers, used as a driver on a serial line."""

from __future__ import annotations

from drake_srg import Rig, Scenario, ScenarioError
from drake_srg.robot.identify.press_test import TRANSACTION
from drake_srg.robot.serve.dynamixel.mx64 import Mx64
from drake_srg.robot.serve.dynamixel.protocol import Instruction, Packet1
from drake_srg.robot.serve.dynamixel.registers import ControlTable1
from drake_srg.robot.serve.dynamixel.servo import SpoolMotor

_PERIOD = 0.004  # between exchanges of servo and motor [s]
_BY_NAME = {register.name: register for register in ControlTable1.registers}


class ServoStand:
    """A gripper on the bench whose servo a script drives by its registers.

    Reading and writing take their time, as on a serial line.

    Raises:
        ScenarioError: If the gripper has no wires.
    """

    def __init__(self, scenario: Scenario, name: str) -> None:
        motor = None if scenario.gripper is None else scenario.gripper.wire_motor
        if motor is None:
            raise ScenarioError(f"{name}: gripper: needs !SrgTendonDriver")
        self.rig = Rig(scenario, name=name)
        self._servo = Mx64(SpoolMotor(motor), self._refuse)
        self._name = name

    def _refuse(self, kind: str, message: str) -> None:
        raise ScenarioError(f"{self._name}: {message}")

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.rig.time

    def sleep(self, duration: float) -> None:
        """Simulate for a while, with the servo in command of its motor."""
        rig = self.rig
        for _ in range(round(duration / _PERIOD)):
            angle, speed = rig.measured("gripper.motor_state")
            (pwm,) = rig.measured("gripper.pwm")
            (temperature,) = rig.measured("gripper.motor_temperature")
            self._servo.sense(rig.time, angle, speed, pwm, temperature)
            if command := self._servo.command():
                rig.fix("gripper.motor_position_commanded", command.position)
                rig.fix("gripper.motor_torque_commanded", command.torque)
                rig.fix("gripper.force_limit", command.limit)
            rig.advance(_PERIOD)

    def write(self, name: str, value: int) -> None:
        """Write a register by its name in the manual."""
        register = _BY_NAME[name]
        data = value.to_bytes(register.size, "little", signed=value < 0)
        packet = Packet1(1, Instruction.WRITE, bytes([register.address]) + data)
        self._servo.answer(packet)
        self.sleep(TRANSACTION)

    def read(self, name: str) -> int:
        """Read a register by its name in the manual."""
        self.sleep(TRANSACTION)
        return self._servo.table[name]
