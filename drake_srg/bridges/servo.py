"""The gripper's own servo, reached over TCP or a pseudo terminal.

Clients speak to it as to a Dynamixel MX-64 on a serial line: by a pyserial URL such as
socket://127.0.0.1:4001, or by the device /dev/pts/N.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import threading
import tty
from collections.abc import Coroutine, Mapping

import numpy as np

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox
from drake_srg.bridges.dynamixel import PacketReader
from drake_srg.bridges.io_thread import IoThread
from drake_srg.bridges.mx64 import MotorCommand, Mx64
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.types import Vector

_CHUNK = 4096  # bytes read at once


class ServoBridge(Bridge):
    """An MX-64 whose motor is that of `SrgTendonDriver`.

    It replies at once, from what the motor did at the last `update`, whatever the
    return delay in its registers. What it commands holds until the next command: other
    bridges move the fingers only until somebody moves the servo.

    Args:
        inbox: For its commands.
        where: `tcp:PORT`, `tcp:HOST:PORT` (HOST is this machine unless told otherwise,
            PORT 0 a free one) or `pty`.
        drive: The motor's.

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
        drive: TendonDriveConfig | None = None,
    ):
        endpoint = _parse(where)
        self._inbox = inbox
        self._servo = Mx64(drive or TendonDriveConfig(), self._warn)
        self._lock = threading.Lock()  # of the servo
        self._commanded: MotorCommand | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._stack = contextlib.ExitStack()
        self._io = IoThread("servo")
        self._stack.callback(self._io.stop)
        try:
            if endpoint is None:
                self.address = self._io.call(self._open_pty())
            else:
                self.address = self._io.call(self._listen(*endpoint))
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
            self._servo.sense(time, motor[0], motor[1], pwm[0], temperature[0])
            self._command()

    def close(self) -> None:
        """Hang up."""
        self._stack.close()

    def _warn(self, kind: str, message: str) -> None:
        self._inbox.warnings.warn(f"servo {kind}", f"servo: {message}")

    def _command(self) -> None:
        command = self._servo.command()
        if command is None or command.same(self._commanded):
            return
        self._commanded = command
        self._inbox.put(
            {
                "gripper.motor_position_commanded": np.array([command.position]),
                "gripper.motor_torque_commanded": np.array([command.torque]),
                "gripper.force_limit": np.array([command.limit]),
            }
        )

    def _answer(self, reader: PacketReader, data: bytes) -> bytes:
        """Take in what came over a line, and return what goes back."""
        dropped, replies = reader.dropped, b""
        now = asyncio.get_running_loop().time()
        with self._lock:
            for packet in reader.feed(data, now):
                replies += self._servo.answer(packet)
            self._command()
        if reader.dropped > dropped:
            self._warn("noise", "bytes that are no packet, or half of one; ignored")
        return replies

    # TCP.

    async def _listen(self, host: str, port: int) -> str:
        server = socket.create_server((host, port))
        server.setblocking(False)
        self._start(self._accept(server))
        host, port = server.getsockname()
        return f"{host}:{port}"

    def _start(self, coroutine: Coroutine[None, None, None]) -> None:
        task = asyncio.get_running_loop().create_task(coroutine)
        self._tasks.add(task)  # the loop itself would forget it
        task.add_done_callback(self._tasks.discard)

    async def _accept(self, server: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        with server:
            while True:
                connection, _ = await loop.sock_accept(server)
                self._start(self._serve(connection))

    async def _serve(self, connection: socket.socket) -> None:
        loop, reader = asyncio.get_running_loop(), PacketReader()
        # Of a client that reads no replies, nothing more is read either; one that is
        # not there any more is found out by the kernel.
        with connection, contextlib.suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while data := await loop.sock_recv(connection, _CHUNK):
                await loop.sock_sendall(connection, self._answer(reader, data))

    # Pseudo terminal.

    async def _open_pty(self) -> str:
        # The other end stays open here, too: else it hangs up with its first client.
        ours, theirs = os.openpty()
        self._stack.callback(os.close, ours)
        self._stack.callback(os.close, theirs)
        tty.setraw(theirs)
        os.set_blocking(ours, False)
        reader = PacketReader()

        def receive() -> None:
            with contextlib.suppress(BlockingIOError):
                data = os.read(ours, _CHUNK)
                # What nobody reads is lost, as on a wire.
                os.write(ours, self._answer(reader, data))

        loop = asyncio.get_running_loop()
        loop.add_reader(ours, receive)

        async def hang_up() -> None:
            loop.remove_reader(ours)

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
