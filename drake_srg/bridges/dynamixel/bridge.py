"""The bridge to masters of a station's servos, over TCP or a pseudo terminal.

Clients talk to them as to Dynamixel MX-64 on a serial line, at a pyserial URL such as
socket://127.0.0.1:4001 or at the device /dev/pts/N.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import functools
import os
import socket
import threading
import tty
from collections.abc import Coroutine, Mapping, Sequence
from typing import Any

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox
from drake_srg.bridges.dynamixel.emulated_bus import EmulatedBus
from drake_srg.bridges.dynamixel.mechanisms import Mechanism, WiredGripper
from drake_srg.bridges.dynamixel.mx64 import Mx64
from drake_srg.bridges.dynamixel.mx64_2 import Mx64P2
from drake_srg.bridges.dynamixel.protocol import Packet, PacketReader
from drake_srg.bridges.io_thread import IoThread
from drake_srg.gripper.drivers import SrgTendonDriver
from drake_srg.types import Vector

# Firmware by protocol.
_SERVOS: dict[int, type[Mx64] | type[Mx64P2]] = {1: Mx64, 2: Mx64P2}
_CHUNK = 4096  # bytes read at once
_PAUSE = 1.0  # before the next attempt after a client could not be accepted [s, real]


def _set_ready(ready: asyncio.Future[None]) -> None:
    """Wake up whoever waits for a client, once."""
    if not ready.done():
        ready.set_result(None)


def _close(connection: socket.socket, _: asyncio.Task[None]) -> None:
    """Close a connection once the task that serves it is over."""
    connection.close()


class ServoBridge(Bridge):
    """MX-64 servos on one bus that drive the motors of a station.

    They reply at once, with the motors' state at the last `update`, and ignore the
    return delay in their registers. The most recent source of commands wins, see
    `EmulatedBus`.

    Args:
        inbox: Where its commands go.
        where: `tcp:PORT`, `tcp:HOST:PORT` or `pty`. HOST is 127.0.0.1 by default, an
            IPv6 address needs brackets, PORT 0 takes a free port.
        mechanisms: What the servos move; None takes a default `SrgTendonDriver`.
        protocol: Dynamixel protocol, 1 or 2.

    Attributes:
        address: Where clients find the servos, "HOST:PORT" or a device.
        bus: The servos.

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
        self._tasks: set[asyncio.Task[None]] = set()
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
                f"servo: {where}: HOST must be an address or a name of this machine",
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
        """Where clients reach it, such as "servo at tcp:127.0.0.1:4001"."""
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
        """Report an unexpected error; the loop goes on."""
        self._warn("fault", repr(context.get("exception") or context["message"]))

    def _reader(self) -> PacketReader[Packet]:
        return PacketReader(self.bus.packets)

    def _answer(self, reader: PacketReader[Packet], data: bytes) -> list[bytes]:
        """Take bytes from a client and return the packets for it."""
        dropped = reader.dropped
        # Before the lock: the simulation waits for it, and noise takes time.
        packets = list(reader.feed(data, asyncio.get_running_loop().time()))
        with self._lock:
            replies = self.bus.answer(packets)
        if reader.dropped > dropped:
            self._warn("noise", "ignored bytes that are not a complete packet")
        return replies

    # TCP.

    async def _listen(self, host: str, port: int) -> str:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        # create_server alone would not report what is wrong with a name.
        found = socket.getaddrinfo(host, port, family, socket.SOCK_STREAM)
        server = socket.create_server(found[0][4], family=family)
        server.setblocking(False)
        self._start(self._accept(server))
        host, port = server.getsockname()[:2]
        return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"

    def _start(self, coroutine: Coroutine[None, None, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(coroutine)
        self._tasks.add(task)  # the loop keeps weak references only
        task.add_done_callback(self._tasks.discard)
        return task

    async def _accept(self, server: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        with server:
            while True:
                # Not loop.sock_accept: when it is cancelled, a connection that it has
                # already accepted may stay open.
                ready = loop.create_future()
                loop.add_reader(server, _set_ready, ready)
                try:
                    await ready
                finally:
                    loop.remove_reader(server)
                try:
                    connection, _ = server.accept()
                except BlockingIOError:  # the client has gone again
                    continue
                except OSError as error:  # such as too many open files
                    self._warn("accept", f"cannot accept clients: {error.strerror}")
                    await asyncio.sleep(_PAUSE)
                    continue
                connection.setblocking(False)
                task = self._start(self._serve(connection))
                # A task that is cancelled before its first step closes nothing itself.
                task.add_done_callback(functools.partial(_close, connection))

    async def _serve(self, connection: socket.socket) -> None:
        loop, reader = asyncio.get_running_loop(), self._reader()
        # While a client does not read its replies, nothing more is read from it. The
        # kernel's keepalive detects clients that have vanished.
        with connection, contextlib.suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while data := await loop.sock_recv(connection, _CHUNK):
                replies = self._answer(reader, data)
                await loop.sock_sendall(connection, b"".join(replies))

    # Pseudo terminal.

    async def _open_pty(self) -> str:
        # The clients' end stays open here too: otherwise the terminal would hang up
        # when its first client closes it.
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
                    # Unread packets are lost, as on a wire, but only whole ones.
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
    """Return host and port, or None for a pseudo terminal."""
    kind, _, rest = where.partition(":")
    host, _, port = rest.rpartition(":")
    if where == "pty":
        return None
    if kind != "tcp" or not port.isdecimal() or int(port) > 65535:
        raise ValueError(
            f"servo: must be tcp:PORT, tcp:HOST:PORT or pty, got {where!r}"
        )
    return host.strip("[]") or "127.0.0.1", int(port)
