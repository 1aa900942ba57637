"""The bridge to clients of a station's servos, over TCP or a pseudo terminal.

To clients, the servos are Dynamixel MX-64 on a serial line, at a pyserial URL such as
socket://127.0.0.1:4001 or at the device /dev/pts/N. Angles of motors are positive
clockwise, as in `Motor`.
"""

from __future__ import annotations

import abc
import asyncio
import contextlib
import errno
import math
import os
import socket
import threading
import tty
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from drake_srg.gripper.driver import WireMotor
from drake_srg.gripper.srg_tendon_driver import SrgTendonDriver
from drake_srg.robot.serve.bridge import Bridge
from drake_srg.robot.serve.commands import CommandInbox, PortValues, gripper_command
from drake_srg.robot.serve.dynamixel.mx64 import Mx64, Mx64P2
from drake_srg.robot.serve.dynamixel.protocol import Packet, PacketReader
from drake_srg.robot.serve.dynamixel.servo import (
    JOINT,
    Motor,
    MotorCommand,
    Servo,
    SpoolMotor,
)
from drake_srg.robot.serve.sockets import IoThread
from drake_srg.scenario import Scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector

_AMBIENT = 25.0  # temperature of motors whose heat is not simulated [degC]

# Angle [rad], speed [rad/s], fraction of full PWM, temperature [degC].
Sensed = tuple[float, float, float, float]


class Mechanism(abc.ABC):
    """A part of a station that one or more servos move.

    Attributes:
        ports: Names of the station's output ports with the state of the motors.
        commanded: The input port whose last source commands the motors.
        motors: The motors, one per servo.
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

        A motor whose command is None stays as it is.
        """


class WiredGripper(Mechanism):
    """An SRG with one motor, which winds the wires."""

    ports = ("gripper.motor_state", "gripper.pwm", "gripper.motor_temperature")
    commanded = "gripper.motor_position_commanded"

    def __init__(self, motor: WireMotor):
        self.motors = [SpoolMotor(motor)]

    def sense(self, values: Mapping[str, Vector]) -> Sequence[Sensed]:
        """Return the state of each motor from the values of `ports`."""
        (angle, speed), (pwm,), (temperature,) = (values[name] for name in self.ports)
        return [(float(angle), float(speed), float(pwm), float(temperature))]

    def command(self, commands: Sequence[MotorCommand | None]) -> PortValues:
        """Return values of the station's input ports for a command per motor."""
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
    """An arm with a servo per joint.

    A servo's position rises with its joint's angle, and is 2048 at 0. The joints hold
    their positions even with torque switched off or limited, because the simulated arm
    has no input for torque.

    Args:
        lower: Lower position limits, shape (N,) [rad].
        upper: Upper position limits, shape (N,) [rad].
        effort: Torque at full PWM, shape (N,) [N m].
    """

    ports = ("arm.state_measured", "arm.torque_measured")
    commanded = "arm.position_desired"

    def __init__(self, lower: Vector, upper: Vector, effort: Vector):
        self.motors = [Motor(JOINT) for _ in effort]
        self._lower, self._upper, self._effort = lower, upper, effort

    def sense(self, values: Mapping[str, Vector]) -> Sequence[Sensed]:
        """Return the state of each motor from the values of `ports`."""
        state, torque = (values[name] for name in self.ports)
        q, v = np.split(-state, 2)
        pwm = np.clip(-torque / self._effort, -1.0, 1.0)
        temperature = np.full(len(q), _AMBIENT)
        return [tuple(row) for row in np.c_[q, v, pwm, temperature].tolist()]

    def command(self, commands: Sequence[MotorCommand | None]) -> PortValues:
        """Return values of the station's input ports for a command per motor.

        A joint without a command gets NaN, and stays where it is.
        """
        q = np.array([math.nan if c is None else -c.position for c in commands])
        return {self.commanded: np.clip(q, self._lower, self._upper)}


class ServoGripper(Mechanism):
    """A gripper whose closure one servo commands, through the gripper's own driver.

    Closing raises the servo's position from 2048.

    Args:
        travel: Angle of the first joint at closure 1 [rad].
        joints: Number of joints that the gripper's driver commands.
    """

    ports = ("gripper.state_measured", "gripper.pwm")
    commanded = "gripper.closure_commanded"

    def __init__(self, travel: float, joints: int):
        self.motors = [Motor(JOINT)]
        self._travel, self._joints = travel, joints

    def sense(self, values: Mapping[str, Vector]) -> Sequence[Sensed]:
        """Return the state of each motor from the values of `ports`."""
        state, pwm = (values[name] for name in self.ports)
        q, v = np.split(-state, 2)
        return [(float(q[0]), float(v[0]), float(-pwm[0]), _AMBIENT)]

    def command(self, commands: Sequence[MotorCommand | None]) -> PortValues:
        """Return values of the station's input ports for a command per motor.

        Without torque, the fingers are free.
        """
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
    """Return the mechanisms that servos of a station move, in the order of their IDs.

    An arm of servos has the gripper's servo on the same bus.

    Raises:
        ScenarioError: If a single servo cannot close the gripper of an arm of servos.
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


_SOURCE = "servo"

# Passes values of input ports and their source to an inbox: its `put` or `amend`.
Keep = Callable[[PortValues, str], None]


class _Drive:
    """A mechanism, its servos, and their last commands."""

    def __init__(self, mechanism: Mechanism, servos: Sequence[Servo]):
        self.mechanism, self.servos = mechanism, servos
        self._commanded: list[MotorCommand | None] = [None] * len(servos)

    def yield_motors(self, inbox: CommandInbox) -> None:
        """Release the motors if another source has commanded them meanwhile."""
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
        """Pass the servos' commands to the station if any of them is new."""
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
        kind: Class of the servos, which decides their protocol.
        warn: Called with a kind and a message for refusals and shutdowns.

    Attributes:
        servos: The servos, by their initial IDs.
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
        """Pass values of `ports` at a time [s] to the servos, and commands back."""
        for drive in self._drives:
            drive.yield_motors(self._inbox)
            drive.sense(time, values)
            drive.command(self._inbox.amend)

    def answer(self, packets: Sequence[Packet]) -> list[bytes]:
        """Carry out packets, and return a reply to each; b"" if there is none."""
        for drive in self._drives:
            drive.yield_motors(self._inbox)
        replies = [b"".join(self._replies(packet)) for packet in packets]
        for drive in self._drives:
            drive.command(self._inbox.put)
        return replies

    def _replies(self, packet: Packet) -> Iterator[bytes]:
        """Return the servos' replies, in the order in which servos send them."""
        order = {block[0]: k for k, block in enumerate(packet.asked)}

        def turn(servo: Servo) -> tuple[int, int]:
            number = servo.table["id"]
            return order.get(number, len(order)), number

        return (
            servo.answer(packet) for servo in sorted(self.servos.values(), key=turn)
        )

    @property
    def writes(self) -> int:
        """Number of write packets so far, valid or not."""
        return sum(servo.writes for servo in self.servos.values())


def _labeled(
    warn: Callable[[str, str], None], label: str
) -> Callable[[str, str], None]:
    return lambda kind, message: warn(f"{label} {kind}", f"{label}: {message}")


# Firmware by protocol.
_SERVOS: dict[int, type[Mx64] | type[Mx64P2]] = {1: Mx64, 2: Mx64P2}
_CHUNK = 4096  # bytes read at once


class ServoBridge(Bridge):
    """MX-64 servos on one bus that drive the motors of a station.

    They reply at once, with the motors' state at the last `update`, and ignore the
    return delay in their registers. The most recent source of commands wins, see
    `EmulatedBus`.

    Args:
        where: `tcp:PORT`, `tcp:HOST:PORT` or `pty`. HOST is 127.0.0.1 by default; PORT
            0 chooses a free port.
        mechanisms: The mechanisms that servos move; None: a default `SrgTendonDriver`.
        protocol: Dynamixel protocol, 1 or 2.

    Attributes:
        address: Address for clients, "HOST:PORT" or a device.

    Raises:
        ValueError: If `where` or `protocol` is invalid.
        OSError: If the servos cannot listen there.
    """

    def __init__(
        self,
        inbox: CommandInbox,
        where: str,
        mechanisms: Sequence[Mechanism] | None = None,
        protocol: int = 1,
    ):
        endpoint = _parse(where)
        if protocol not in _SERVOS:
            raise ValueError(f"protocol: must be 1 or 2, got {protocol}")
        self._inbox = inbox
        self.bus = EmulatedBus(
            inbox,
            mechanisms or [WiredGripper(SrgTendonDriver())],
            _SERVOS[protocol],
            inbox.warnings.warn,
        )
        self.ports = self.bus.ports
        self._lock = threading.Lock()  # guards the bus
        self._stack = contextlib.ExitStack()
        self._io = IoThread("servo")
        self._io.loop.set_exception_handler(self._handle_fault)
        self._stack.callback(self._io.stop)
        try:
            if endpoint is None:
                self.address = self._io.call(self._open_pty())
            else:
                self.address = self._io.call(self._listen(*endpoint))
        except (socket.gaierror, UnicodeError):  # UnicodeError: such as "a..b"
            self._stack.close()
            raise OSError(
                errno.EADDRNOTAVAIL,
                f"servo: {where}: HOST must be an IPv4 address or name of this machine",
            ) from None
        except OSError as error:
            self._stack.close()
            reason = os.strerror(error.errno) if error.errno else str(error)
            raise OSError(error.errno, f"servo: {where}: {reason}") from None
        count = len(self.bus.servos)
        servos = "servo" if count == 1 else f"{count} servos"
        self._status = f"{servos} at {'tcp:' if endpoint else ''}{self.address}"

    @property
    def status(self) -> str:
        """Address for clients, such as "servo at tcp:127.0.0.1:4001"."""
        return self._status

    def update(self, time: float, values: Mapping[str, Vector]) -> None:
        """Pass the motors' state to the servos; called every control period."""
        with self._lock:
            self.bus.sense(time, values)

    def close(self) -> None:
        """Disconnect all clients. A second call does nothing."""
        self._stack.close()

    def _warn(self, kind: str, message: str) -> None:
        self._inbox.warnings.warn(f"servo {kind}", f"servo: {message}")

    def _handle_fault(
        self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]
    ) -> None:
        """Report an unexpected error; the loop continues."""
        self._warn("fault", repr(context.get("exception") or context["message"]))

    def _reader(self) -> PacketReader:
        return PacketReader(self.bus.packets)

    def _answer(self, reader: PacketReader, data: bytes) -> list[bytes]:
        """Take bytes from a client and return the replies."""
        dropped = reader.dropped
        # Parse before locking: the simulation waits for the lock, and noise takes time.
        packets = list(reader.feed(data, asyncio.get_running_loop().time()))
        with self._lock:
            written = self.bus.writes
            replies = self.bus.answer(packets)
            self._inbox.count(self.bus.writes - written)
        if reader.dropped > dropped:
            self._warn("noise", "ignored bytes that are not a complete packet")
        return replies

    # TCP.

    async def _listen(self, host: str, port: int) -> str:
        # create_server alone would not report why a name is invalid.
        found = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_STREAM)
        listener = socket.create_server((str(found[0][4][0]), port))
        server = await asyncio.start_server(self._serve, sock=listener)
        self._stack.callback(self._io.post, server.close)
        return "{}:{}".format(*listener.getsockname())

    async def _serve(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        packets, connection = self._reader(), writer.get_extra_info("socket")
        # While a client does not read its replies, nothing is read from it. The
        # kernel's keepalive detects clients that have vanished.
        try:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            while data := await reader.read(_CHUNK):
                writer.write(b"".join(self._answer(packets, data)))
                await writer.drain()
        except OSError:  # the client has gone
            pass
        except asyncio.CancelledError:  # drop what the client has not read yet
            writer.transport.abort()
            raise
        finally:
            writer.close()

    # Pseudo terminal.

    async def _open_pty(self) -> str:
        # Keep the clients' end open here, too. Otherwise the terminal would hang up
        # once its first client closes it.
        ours, theirs = os.openpty()
        self._stack.callback(os.close, ours)
        self._stack.callback(os.close, theirs)
        tty.setraw(theirs)
        os.set_blocking(ours, False)
        reader, loop = self._reader(), asyncio.get_running_loop()
        tail = b""  # unsent rest of a packet

        def send(packet: bytes) -> bytes:
            """Send as much as the terminal takes and return the rest."""
            try:
                return packet[os.write(ours, packet) :]
            except BlockingIOError:
                return packet

        def finish() -> None:
            nonlocal tail
            if not (tail := send(tail)):
                loop.remove_writer(ours)

        def receive() -> None:
            nonlocal tail
            with contextlib.suppress(BlockingIOError):
                for packet in self._answer(reader, os.read(ours, _CHUNK)):
                    # If the client does not read, drop whole packets, as a wire would.
                    if not tail and (rest := send(packet)) != packet:
                        tail = rest
            if tail:
                loop.add_writer(ours, finish)

        loop.add_reader(ours, receive)

        async def hang_up() -> None:
            loop.remove_reader(ours)
            loop.remove_writer(ours)

        self._stack.callback(lambda: self._io.call(hang_up()))
        return os.ttyname(theirs)


def _parse(where: str) -> tuple[str, int] | None:
    """Return host and port; None for a pseudo terminal."""
    kind, _, rest = where.partition(":")
    host, _, port = rest.rpartition(":")
    if where == "pty":
        return None
    if kind != "tcp" or not port.isdecimal() or int(port) > 65535:
        raise ValueError(
            f"servo: must be tcp:PORT, tcp:HOST:PORT or pty, got {where!r}"
        )
    return host or "127.0.0.1", int(port)
