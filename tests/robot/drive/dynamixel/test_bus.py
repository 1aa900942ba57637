import os
import socket
import termios

import numpy as np
import pytest
from helpers import needs_pty
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.robot.drive.dynamixel.bus import (
    Line,
    NoReplyError,
    RefusedByServoError,
    ServoBus,
    open_line,
)
from drake_srg.robot.serve.dynamixel.servo import JOINT
from robot.drive.dynamixel.emulated_line import EmulatedLine


@pytest.fixture
def pair():
    """A line and the socket at its other end."""
    ours, theirs = socket.socketpair()
    with theirs:
        line = Line(ours.detach())
        yield line, theirs
        line.close()


def test_a_drained_line_forgets_what_has_arrived(pair):
    line, other = pair
    other.sendall(b"late" * 3000)
    line.drain()
    assert line.read(0.0) == b""


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


PROTOCOLS = pytest.mark.parametrize("protocol", [1, 2])
BLOCK = ("torque_enable", "led", "present_position")


def bus_with(protocol, **options):
    line = EmulatedLine(protocol)
    return line, ServoBus(line, protocol, **options)


def test_an_unknown_protocol_is_refused():
    with pytest.raises(ValueError, match="protocol: must be 1 or 2, got 3"):
        ServoBus(EmulatedLine(), 3)


@PROTOCOLS
def test_registers_are_read_and_written_by_name(protocol):
    line, bus = bus_with(protocol)
    line.q = np.array([0.5, -0.5, 1.0])
    line.step()
    bus.write(2, "led", 1)
    reply = bus.read_all([2], *BLOCK)[2]
    counts = round(JOINT.to_counts(0.5))
    assert reply.values == {"torque_enable": 0, "led": 1, "present_position": counts}
    assert reply.fault == ""


@PROTOCOLS
@settings(max_examples=12)
@given(numbers=st.permutations([1, 2, 3, 4]), count=st.integers(1, 4))
def test_a_group_read_gives_each_servo_its_own(protocol, numbers, count):
    line, bus = bus_with(protocol)
    line.q = np.array([0.1, 0.2, 0.3])
    line.step()
    asked = numbers[:count]
    replies = bus.read_all(asked, "present_position")
    assert list(replies) == asked
    for number in asked:
        assert replies[number] == bus.read_all([number], "present_position")[number]


@PROTOCOLS
def test_a_refusal_is_told_and_not_repeated(protocol):
    line, bus = bus_with(protocol)
    before = line.writes
    with pytest.raises(RefusedByServoError, match=r"servo 2: refuses \((range|data)"):
        bus.write(2, "torque_enable", 7)
    assert line.writes == before + 1


@PROTOCOLS
def test_silence_ends_in_an_error_after_the_tries(protocol):
    line, bus = bus_with(protocol, retries=3, timeout=0.005)
    line.silent = True
    with pytest.raises(NoReplyError, match=r"servo 1, 3: .* 5 ms, tried 4 times"):
        bus.read_all([1, 3], "present_position")
    assert line.writes == 4


@PROTOCOLS
def test_a_missing_servo_is_an_error_for_all(protocol):
    _, bus = bus_with(protocol)
    with pytest.raises(NoReplyError):
        bus.read_all([1, 9, 2], "present_position")


def test_an_overload_is_told_with_the_values():
    line, bus = bus_with(1)
    bus.write(4, "torque_limit", 300)
    bus.write(4, "goal_position", 2400)
    line.load = 0.3
    for _ in range(110):
        line.step(duration=0.1)
    reply = bus.read_all([4], "present_position", "torque_limit")[4]
    assert reply.fault == "overload"
    assert reply.values["torque_limit"] == 0


@PROTOCOLS
def test_a_repeated_instruction_succeeds(protocol):
    line, bus = bus_with(protocol, retries=1)
    spoiled = iter([True])
    line.spoil = lambda reply: reply[:-1] if next(spoiled, False) else reply
    reply = bus.read_all([1], "present_position")[1]
    assert reply.values == {"present_position": 2048}


# Noise.


@st.composite
def noises(draw):
    """A function that changes, loses or adds a byte of a reply, or cuts its end."""
    place, byte = draw(st.integers(0, 200)), draw(st.integers(1, 255))
    kind = draw(st.sampled_from(["change", "lose", "add", "cut"]))

    def spoil(reply):
        if not reply:
            return reply
        k = place % len(reply)
        rest = {
            "change": bytes([reply[k] ^ byte]) + reply[k + 1 :],
            "lose": reply[k + 1 :],
            "add": bytes([byte]) + reply[k:],
            "cut": b"",
        }
        return reply[:k] + rest[kind]

    return spoil


@PROTOCOLS
@given(
    spoil=noises(),
    q=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    numbers=st.permutations([1, 2, 3, 4]),
    count=st.integers(1, 4),
)
def test_noise_never_gives_a_wrong_value(protocol, spoil, q, numbers, count):
    line, bus = bus_with(protocol, retries=0)
    line.q = np.array(q)
    line.step()
    asked = numbers[:count]
    truth = bus.read_all(asked, *BLOCK)
    line.spoil = spoil
    try:
        got = bus.read_all(asked, *BLOCK)
    except (NoReplyError, RefusedByServoError):
        return
    assert got == truth
