"""What a master of servos must know of each Dynamixel protocol."""

from __future__ import annotations

import abc
import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import ClassVar

from drake_srg.bridges.dynamixel import protocol1, protocol2, registers2
from drake_srg.bridges.dynamixel.protocol import Instruction, Packet, Refusal
from drake_srg.bridges.dynamixel.registers import ControlTable
from drake_srg.bridges.dynamixel.registers1 import (
    FULL_TORQUE,
    SPEED_UNIT,
    ControlTable1,
    decode_directed,
)
from drake_srg.bridges.dynamixel.servo import Fault


@dc.dataclass(frozen=True)
class Status:
    """A status packet's content.

    Attributes:
        fault: What is wrong with the servo; empty if nothing is.
        refusal: Why it refuses the instruction; None if it does not.
        data: What it was asked for.
    """

    fault: str
    refusal: Refusal | None
    data: bytes


@dc.dataclass(frozen=True)
class ServoState:
    """A servo's state, in the sense in which its position rises.

    Attributes:
        torque: Whether its torque is on.
        marked: Whether the LED is on, which a reboot turns off.
        position: [counts].
        velocity: [rad/s].
        load: Fraction of the stall torque, as the servo estimates it.
        fault: What is wrong with the servo; empty if nothing is.
    """

    torque: bool
    marked: bool
    position: int
    velocity: float
    load: float
    fault: str


class Dialect(abc.ABC):
    """A protocol and the registers of the servos that speak it.

    Attributes:
        packets: Its packets.
        width: Bytes of an address or a length.
        table: The registers.
        identity: Number of data bytes in the reply to a ping.
        reads: Registers with a servo's state.
        effort: Register that limits the torque.
        full_effort: Its value for all the torque.
    """

    packets: ClassVar[type[Packet]]
    width: ClassVar[int]
    table: ClassVar[type[ControlTable]]
    identity: ClassVar[int]
    reads: ClassVar[Sequence[str]]
    effort: ClassVar[str]
    full_effort: ClassVar[int]

    @abc.abstractmethod
    def group_read(
        self, numbers: Sequence[int], address: int, size: int
    ) -> tuple[Instruction, bytes]:
        """Return the instruction that reads the same block of several servos."""

    @abc.abstractmethod
    def status(self, packet: Packet) -> Status | None:
        """Return a status packet's content; None if the packet is none, or broken."""

    @abc.abstractmethod
    def state(self, values: Mapping[str, int], fault: str) -> ServoState:
        """Return the state that the registers `reads` hold, with a `Status`'s fault."""


class _Dialect1(Dialect):
    packets = protocol1.Packet1
    width = 1
    table = ControlTable1
    identity = 0
    reads = (
        "torque_enable",
        "led",
        "present_position",
        "present_speed",
        "present_load",
    )
    effort, full_effort = "torque_limit", FULL_TORQUE

    def group_read(
        self, numbers: Sequence[int], address: int, size: int
    ) -> tuple[Instruction, bytes]:
        blocks = [bytes([size, number, address]) for number in numbers]
        return Instruction.BULK_READ, b"\0" + b"".join(blocks)

    def status(self, packet: Packet) -> Status | None:
        if not packet.intact:
            return None
        fault = Fault(packet.code & sum(Fault))
        refused = next(
            (r for r, bit in protocol1.ERRORS.items() if packet.code & bit), None
        )
        return Status(str(fault), refused, packet.parameters)

    def state(self, values: Mapping[str, int], fault: str) -> ServoState:
        return ServoState(
            torque=bool(values["torque_enable"]),
            marked=bool(values["led"]),
            position=values["present_position"],
            velocity=-decode_directed(values["present_speed"]) * SPEED_UNIT,
            load=-decode_directed(values["present_load"]) / FULL_TORQUE,
            fault=fault,
        )


class _Dialect2(Dialect):
    packets = protocol2.Packet2
    width = 2
    table = registers2.ControlTable2
    identity = 3
    reads = (
        *("torque_enable", "led", "hardware_error_status"),
        *("present_position", "present_velocity", "present_pwm"),
    )
    effort, full_effort = "goal_pwm", registers2.FULL_PWM

    def group_read(
        self, numbers: Sequence[int], address: int, size: int
    ) -> tuple[Instruction, bytes]:
        head = address.to_bytes(2, "little") + size.to_bytes(2, "little")
        return Instruction.SYNC_READ, head + bytes(numbers)

    def status(self, packet: Packet) -> Status | None:
        if not packet.intact or packet.code != Instruction.STATUS:
            return None
        if not packet.parameters:
            return None
        error, data = packet.parameters[0], packet.parameters[1:]
        refusals = {int(number): why for why, number in protocol2.ERRORS.items()}
        number = error & ~protocol2.ALERT
        if number and number not in refusals:
            return None
        fault = "hardware error" if error & protocol2.ALERT else ""
        return Status(fault, refusals.get(number), data)

    def state(self, values: Mapping[str, int], fault: str) -> ServoState:
        return ServoState(
            torque=bool(values["torque_enable"]),
            marked=bool(values["led"]),
            position=values["present_position"],
            velocity=values["present_velocity"] * registers2.VELOCITY_UNIT,
            load=values["present_pwm"] / registers2.FULL_PWM,
            fault=str(Fault(values["hardware_error_status"])) or fault,
        )


DIALECTS: Mapping[int, Dialect] = {1: _Dialect1(), 2: _Dialect2()}
