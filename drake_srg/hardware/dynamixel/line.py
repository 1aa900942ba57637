"""The line to a bus of servos: a serial device, or a socket that stands for one."""

from __future__ import annotations

import array
import contextlib
import fcntl
import os
import select
import socket
import termios
import tty

# ASYNC_LOW_LATENCY (linux/tty_flags.h) hands on bytes as they arrive; an FTDI adapter,
# such as the U2D2, otherwise keeps them for up to 16 ms. The flags are the fifth int of
# `serial_struct` (linux/serial.h), for which 32 are room enough.
_LOW_LATENCY, _FLAGS, _SERIAL = 1 << 13, 4, 32
_CHUNK = 4096  # bytes read at once
_PATIENCE = 2.0  # for a TCP connection [s]
# Most reads of noise that wait for a silent line.
_LONGEST_NOISE = 64


class Line:
    """Sends and receives bytes. It owns its descriptor.

    Args:
        descriptor: Of a serial device, a terminal or a socket.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor: int | None = descriptor

    def write(self, data: bytes) -> None:
        """Send all of `data`.

        Raises:
            OSError: If the line is closed.
        """
        while data:
            data = data[os.write(self._open, data) :]

    def read(self, timeout: float) -> bytes:
        """Return what has arrived, or no bytes if nothing does within `timeout` [s].

        Raises:
            OSError: If the line is closed, by either side.
        """
        ready, _, _ = select.select([self._open], [], [], timeout)
        if not ready:
            return b""
        data = os.read(self._open, _CHUNK)
        if not data:
            raise ConnectionResetError("the other side has closed the line")
        return data

    def drain(self, silence: float = 0.0) -> None:
        """Ignore what arrives until nothing has for a time [s].

        Raises:
            OSError: If the line is closed.
        """
        for _ in range(_LONGEST_NOISE):
            if not self.read(silence):
                return

    def close(self) -> None:
        """Close it. A second call does nothing."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    @property
    def _open(self) -> int:
        if self._descriptor is None:
            raise ConnectionResetError("the line is closed")
        return self._descriptor


def open_line(port: str, baud: int) -> Line:
    """Open the line at a port.

    Args:
        port: `tcp:HOST:PORT`, or the path of a serial device or pseudo terminal.
        baud: Of a serial device.

    Raises:
        ValueError: If `port` or `baud` is invalid.
        OSError: If it cannot be opened.
    """
    if port.startswith("tcp:"):
        return Line(_connected(port))
    if not port.startswith("/"):
        raise ValueError(f"port: must be tcp:HOST:PORT or a device, got {port!r}")
    speed = getattr(termios, f"B{baud}", None)
    if speed is None:
        known = sorted(
            int(b[1:]) for b in dir(termios) if b[:1] == "B" and b[1:].isdecimal()
        )
        raise ValueError(f"baud: must be one of {known}, got {baud}")
    descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC)
    try:
        tty.setraw(descriptor, termios.TCSANOW)
        mode = termios.tcgetattr(descriptor)
        mode[4] = mode[5] = speed
        mode[2] |= termios.CLOCAL | termios.CREAD
        termios.tcsetattr(descriptor, termios.TCSANOW, mode)
        termios.tcflush(descriptor, termios.TCIOFLUSH)
        _ask_for_low_latency(descriptor)
    except termios.error as error:
        os.close(descriptor)
        raise OSError(*error.args) from None
    except OSError:
        os.close(descriptor)
        raise
    return Line(descriptor)


def _ask_for_low_latency(descriptor: int) -> None:
    """Have a serial device hand on bytes as they arrive, if it can be told to."""
    settings = array.array("i", [0] * _SERIAL)
    # Pseudo terminals cannot, and macOS does not know the request.
    with contextlib.suppress(OSError, AttributeError):
        fcntl.ioctl(descriptor, termios.TIOCGSERIAL, settings)
        settings[_FLAGS] |= _LOW_LATENCY
        fcntl.ioctl(descriptor, termios.TIOCSSERIAL, settings)


def _connected(port: str) -> int:
    """Return the descriptor of a socket that is connected to tcp:HOST:PORT."""
    host, _, number = port.removeprefix("tcp:").rpartition(":")
    if not host or not number.isdecimal() or not 0 < int(number) < 65536:
        raise ValueError(f"port: must be tcp:HOST:PORT or a device, got {port!r}")
    connection = socket.create_connection((host.strip("[]"), int(number)), _PATIENCE)
    connection.settimeout(None)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection.detach()
