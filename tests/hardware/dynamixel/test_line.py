import os
import socket
import termios

import pytest
from helpers import needs_pty

from drake_srg.hardware.dynamixel.line import Line, open_line


@pytest.fixture
def pair():
    """A line and the socket at its other end."""
    ours, theirs = socket.socketpair()
    with theirs:
        line = Line(ours.detach())
        yield line, theirs
        line.close()


def test_bytes_go_both_ways(pair):
    line, other = pair
    line.write(b"to")
    other.sendall(b"from")
    assert other.recv(9) == b"to"
    assert line.read(20.0) == b"from"
    assert line.read(0.0) == b""


def test_a_drained_line_forgets_what_has_arrived(pair):
    line, other = pair
    other.sendall(b"late" * 3000)
    line.drain()
    assert line.read(0.0) == b""


def test_a_line_that_babbles_is_drained_in_finite_time(pair, monkeypatch):
    line, _ = pair
    monkeypatch.setattr(line, "read", lambda timeout: b"noise")
    line.drain()


def test_a_line_that_the_other_side_closes_is_an_error(pair):
    line, other = pair
    other.close()
    with pytest.raises(ConnectionResetError):
        line.read(20.0)
    line.close()
    line.close()
    for use in (lambda: line.read(0.0), lambda: line.write(b"x")):
        with pytest.raises(ConnectionResetError, match="the line is closed"):
            use()


def test_a_socket_is_reached_by_its_address():
    with socket.create_server(("127.0.0.1", 0)) as server:
        line = open_line(f"tcp:127.0.0.1:{server.getsockname()[1]}", 57600)
        other, _ = server.accept()
        with other:
            other.sendall(b"x")
            assert line.read(20.0) == b"x"
        line.close()


def test_a_terminal_is_raw():
    needs_pty()
    ours, theirs = os.openpty()
    line = open_line(os.ttyname(theirs), 1_000_000)
    line.write(b"\r\n\x03")
    assert os.read(ours, 9) == b"\r\n\x03"
    os.write(ours, b"\r\x04")
    assert line.read(20.0) == b"\r\x04"
    line.close()
    os.close(ours)
    os.close(theirs)


def test_a_serial_device_hands_on_bytes_at_once(monkeypatch):
    needs_pty()
    before, low_latency, after = 0x10000040, 0x2000, []

    def ioctl(descriptor, request, settings):
        if request == termios.TIOCGSERIAL:
            settings[4] = before
        else:
            assert request == termios.TIOCSSERIAL
            after.append(settings[4])

    monkeypatch.setattr("fcntl.ioctl", ioctl)
    master, terminal = os.openpty()
    open_line(os.ttyname(terminal), 57600).close()
    os.close(master)
    os.close(terminal)
    assert after == [before | low_latency]


@pytest.mark.parametrize("port", ["", "COM3", "tcp:", "tcp:4001", "tcp:h:0"])
def test_an_invalid_port_is_refused(port):
    with pytest.raises(ValueError, match="must be tcp:HOST:PORT or a device, got"):
        open_line(port, 57600)


def test_an_unknown_baud_rate_is_refused():
    with pytest.raises(ValueError, match=r"must be one of .* 57600, .* got 12345"):
        open_line("/dev/null", 12345)


@pytest.mark.parametrize("port", ["/dev/null", "/nowhere", "tcp:127.0.0.1:1"])
def test_a_port_that_cannot_be_opened_is_an_os_error(port):
    with pytest.raises(OSError, match=r"."):
        open_line(port, 57600)
