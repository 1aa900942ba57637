"""The gripper's own servo, reached over TCP or a pseudo terminal.

Clients speak to it as to a Dynamixel MX-64 on a serial line: by a pyserial URL such as
socket://127.0.0.1:4001, or by the device /dev/pts/N.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
import threading
import tty
from collections.abc import Callable, Coroutine, Mapping
from typing import Any

import numpy as np

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox, PortValues, gripper_command
from drake_srg.bridges.dynamixel.mx64 import MotorCommand, Mx64
from drake_srg.bridges.dynamixel.protocol import PacketReader
from drake_srg.bridges.io_thread import IoThread
from drake_srg.gripper.drivers import SrgTendonDriver
from drake_srg.types import Vector

_CHUNK = 4096  # bytes read at once
_PAUSE = 1.0  # until clients are let in again who could not be [s]
_SOURCE = "servo"
_POSITION = "gripper.motor_position_commanded"


class ServoBridge(Bridge):
    """An MX-64 whose motor is that of `SrgTendonDriver`.

    It replies at once, from what the motor did at the last `update`, whatever the
    return delay in its registers. Of what it commands and what others do, the last
    counts, see `gripper_command`.

    Args:
        inbox: For its commands.
        where: `tcp:PORT`, `tcp:HOST:PORT` (HOST is this machine unless told otherwise,
            an IPv6 address stands in brackets, PORT 0 is a free one) or `pty`.
        gripper: Whose motor it is.

    Attributes:
        address: Where clients find it, "HOST:PORT" or a device.

    Raises:
        ValueError: If `where` is none of these.
        OSError: If nobody can listen there.
    """

    ports = ("gripper.motor_state", "gripper.pwm", "gripper.motor_temperature")

    def __init__(
        self,
        inbox: CommandInbox,
        where: str,
        gripper: SrgTendonDriver | None = None,
    ):
        endpoint = _parse(where)
        gripper = gripper or SrgTendonDriver()
        self._inbox = inbox
        self._servo = Mx64(gripper.drive, gripper.temperature, self._warn)
        self._lock = threading.Lock()  # of the servo
        self._commanded: MotorCommand | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._stack = contextlib.ExitStack()
        self._io = IoThread("servo")
        self._io.loop.set_exception_handler(self._fault)
        self._stack.callback(self._io.stop)
        try:
            if endpoint is None:
                self.address = self._io.call(self._open_pty())
            else:
                self.address = self._io.call(self._listen(*endpoint))
        except (socket.gaierror, UnicodeError):  # UnicodeError: as of "a..b"
            self._stack.close()
            raise OSError(
                errno.EADDRNOTAVAIL,
                f"servo: {where}: HOST must be an address or a name of this machine",
            ) from None
        except OSError as error:
            self._stack.close()
            reason = os.strerror(error.errno) if error.errno else str(error)
            raise OSError(error.errno, f"servo: {where}: {reason}") from None
        self._status = f"servo at {'tcp:' if endpoint else ''}{self.address}"

    @property
    def status(self) -> str:
        """Where it is reached, as in "servo at tcp:127.0.0.1:4001"."""
        return self._status

    def update(self, time: float, values: Mapping[str, Vector]) -> None:
        """Take what the motor does, every control period."""
        motor, pwm, temperature = (values[name] for name in ServoBridge.ports)
        with self._lock:
            self._yield()
            self._servo.sense(time, motor[0], motor[1], pwm[0], temperature[0])
            self._command(self._inbox.amend)

    def close(self) -> None:
        """Hang up."""
        self._stack.close()

    def _warn(self, kind: str, message: str) -> None:
        self._inbox.warnings.warn(f"servo {kind}", f"servo: {message}")

    def _fault(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Tell of what nobody expected; the loop goes on."""
        self._warn("fault", repr(context.get("exception") or context["message"]))

    def _yield(self) -> None:
        """Leave the motor alone if somebody else has commanded it since."""
        if self._commanded and self._inbox.source(_POSITION) != _SOURCE:
            self._servo.release()
            self._commanded = None

    def _command(self, tell: Callable[[PortValues, str], None]) -> None:
        command = self._servo.command()
        if command is None or command.same(self._commanded):
            return
        self._commanded = command
        values = {
            _POSITION: np.array([command.position]),
            "gripper.motor_torque_commanded": np.array([command.torque]),
            "gripper.force_limit": np.array([command.limit]),
        }
        tell(gripper_command(values, values), _SOURCE)

    def _answer(self, reader: PacketReader, data: bytes) -> list[bytes]:
        """Take in what came over a line, and return the packets that go back."""
        dropped, servo = reader.dropped, self._servo
        now = asyncio.get_running_loop().time()
        with self._lock:
            self._yield()
            written = servo.writes
            replies = [servo.answer(packet) for packet in reader.feed(data, now)]
            self._command(self._inbox.put)
            self._inbox.count(servo.writes - written)
        if reader.dropped > dropped:
            self._warn("noise", "bytes that are no packet, or half of one; ignored")
        return replies

    # TCP.

    async def _listen(self, host: str, port: int) -> str:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        # (By itself, create_server loses what is wrong with a name.)
        found = socket.getaddrinfo(host, port, family, socket.SOCK_STREAM)
        server = socket.create_server(found[0][4], family=family)
        server.setblocking(False)
        self._start(self._accept(server))
        host, port = server.getsockname()[:2]
        return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"

    def _start(self, coroutine: Coroutine[None, None, None]) -> None:
        task = asyncio.get_running_loop().create_task(coroutine)
        self._tasks.add(task)  # the loop itself would forget it
        task.add_done_callback(self._tasks.discard)

    async def _accept(self, server: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        with server:
            while True:
                try:
                    connection, _ = await loop.sock_accept(server)
                except OSError as error:  # as where there are too many open files
                    self._warn("accept", f"cannot let clients in: {error.strerror}")
                    await asyncio.sleep(_PAUSE)
                    continue
                self._start(self._serve(connection))

    async def _serve(self, connection: socket.socket) -> None:
        loop, reader = asyncio.get_running_loop(), PacketReader()
        # Of a client that reads no replies, nothing more is read either; one that is
        # not there any more is found out by the kernel.
        with connection, contextlib.suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while data := await loop.sock_recv(connection, _CHUNK):
                replies = self._answer(reader, data)
                await loop.sock_sendall(connection, b"".join(replies))

    # Pseudo terminal.

    async def _open_pty(self) -> str:
        # The other end stays open here, too: else it hangs up with its first client.
        ours, theirs = os.openpty()
        self._stack.callback(os.close, ours)
        self._stack.callback(os.close, theirs)
        tty.setraw(theirs)
        os.set_blocking(ours, False)
        reader, loop = PacketReader(), asyncio.get_running_loop()
        tail = b""  # of the packet that is on its way

        def send(packet: bytes) -> bytes:
            """Return what does not fit in."""
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
                    # What nobody reads is lost, as on a wire; but no half packets.
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
    """Host and port; None for a pseudo terminal."""
    kind, _, rest = where.partition(":")
    host, _, port = rest.rpartition(":")
    if where == "pty":
        return None
    if kind != "tcp" or not port.isdecimal() or int(port) > 65535:
        raise ValueError(
            f"servo: {where!r}; allowed are tcp:PORT, tcp:HOST:PORT and pty"
        )
    return host.strip("[]") or "127.0.0.1", int(port)
