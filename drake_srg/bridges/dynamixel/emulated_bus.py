"""Emulated servos on one bus, between the packets of masters and a station's ports."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from drake_srg.bridges.commands import CommandInbox, PortValues
from drake_srg.bridges.dynamixel.mechanisms import Mechanism
from drake_srg.bridges.dynamixel.motor import MotorCommand
from drake_srg.bridges.dynamixel.protocol import Packet
from drake_srg.bridges.dynamixel.servo import Servo
from drake_srg.types import Vector

_SOURCE = "servo"

# Passes values of input ports and their source to an inbox: its `put` or `amend`.
Keep = Callable[[PortValues, str], None]


class _Drive:
    """A mechanism, its servos, and the commands that they gave last."""

    def __init__(self, mechanism: Mechanism, servos: Sequence[Servo]):
        self.mechanism, self.servos = mechanism, servos
        self._commanded: list[MotorCommand | None] = [None] * len(servos)

    def yield_motors(self, inbox: CommandInbox) -> None:
        """Release the motors if another source has commanded them since."""
        engaged = any(self._commanded)
        if engaged and inbox.source(self.mechanism.commanded) != _SOURCE:
            for servo in self.servos:
                servo.release()
            self._commanded = [None] * len(self.servos)

    def sense(self, time: float, values: Mapping[str, Vector]) -> None:
        """Pass the state of the motors to the servos."""
        states = self.mechanism.sense(values)
        for servo, state in zip(self.servos, states, strict=True):
            servo.sense(time, *state)

    def command(self, keep: Keep) -> None:
        """Pass the servos' commands on if one of them is new."""
        commands = [servo.command() for servo in self.servos]
        pairs = zip(commands, self._commanded, strict=True)
        if all(new is None or new.same(old) for new, old in pairs):
            return
        self._commanded = commands
        keep(self.mechanism.command(commands), _SOURCE)


class EmulatedBus:
    """Servos that share a line. The most recent source of commands wins.

    Their IDs count from 1, in the order of the mechanisms and their motors.

    Args:
        inbox: Where their commands go.
        mechanisms: What they move.
        kind: Their firmware.
        warn: Called with a kind and a message for refusals and shutdowns.

    Attributes:
        packets: Of their protocol.
        servos: By ID at the start.
        ports: Names of the station's output ports whose values `sense` needs.
    """

    def __init__(
        self,
        inbox: CommandInbox,
        mechanisms: Sequence[Mechanism],
        kind: type[Servo],
        warn: Callable[[str, str], None],
    ):
        self.servos: dict[int, Servo] = {}
        self._inbox = inbox
        self._drives = []
        several = sum(len(mechanism.motors) for mechanism in mechanisms) > 1
        for mechanism in mechanisms:
            servos = []
            for motor in mechanism.motors:
                number = len(self.servos) + 1
                label = f"servo {number}" if several else "servo"
                self.servos[number] = kind(motor, _labeled(warn, label), number)
                servos.append(self.servos[number])
            self._drives.append(_Drive(mechanism, servos))
        first = next(iter(self.servos.values()))
        self.packets = first.table.packets
        self.ports = tuple(port for m in mechanisms for port in m.ports)

    def sense(self, time: float, values: Mapping[str, Vector]) -> None:
        """Pass values of `ports` at a time [s] to the servos, and their commands on."""
        for drive in self._drives:
            drive.yield_motors(self._inbox)
            drive.sense(time, values)
            drive.command(self._inbox.amend)

    def answer(self, packets: Sequence[Packet]) -> list[bytes]:
        """Carry out packets from the line, and return a reply to each, or no bytes."""
        for drive in self._drives:
            drive.yield_motors(self._inbox)
        written = self._writes
        replies = [b"".join(self._replies(packet)) for packet in packets]
        for drive in self._drives:
            drive.command(self._inbox.put)
        self._inbox.count(self._writes - written)
        return replies

    def _replies(self, packet: Packet) -> Iterator[bytes]:
        """Yield the servos' replies in the order in which they give them."""
        order = {block[0]: k for k, block in enumerate(packet.asked)}

        def turn(servo: Servo) -> tuple[int, int]:
            number = servo.table["id"]
            return order.get(number, len(order)), number

        return (
            servo.answer(packet) for servo in sorted(self.servos.values(), key=turn)
        )

    @property
    def _writes(self) -> int:
        return sum(servo.writes for servo in self.servos.values())


def _labeled(
    warn: Callable[[str, str], None], label: str
) -> Callable[[str, str], None]:
    return lambda kind, message: warn(f"{label} {kind}", f"{label}: {message}")
