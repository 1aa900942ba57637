"""The lines of the servo: where it listens, and what clients may do to it."""

import asyncio
import contextlib
import errno
import os
import socket
import struct
import threading
import time

import numpy as np
import pytest
from helpers import needs_pty

from drake_srg.robot.drive.dynamixel.bus import BusError, open_line
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import ServoBridge
from drake_srg.robot.serve.dynamixel.protocol import Instruction, Packet1, PacketReader
from drake_srg.robot.serve.dynamixel.servo import Servo
from robot.serve.dynamixel.fake_station import (
    PING,
    PING_2,
    PONG,
    PONG_2,
    FakeStation,
    answers,
    connect,
    master_of,
)


@pytest.fixture
def station():
    with FakeStation("tcp:0") as station:
        yield station


@pytest.fixture
def line(station):
    """A function that opens a new connection."""
    with contextlib.ExitStack() as stack:
        yield lambda: stack.enter_context(connect(station.bridge))


# Where it listens.


def test_the_status_has_the_terminal_s_device():
    with FakeStation("pty") as other:
        assert other.bridge.status == f"servo at {other.bridge.address}"
        assert other.bridge.address.startswith("/dev/")


@pytest.mark.parametrize("where", ["", "tcp", "tcp:", "tcp:x", "tcp:70000", "usb:1"])
def test_an_invalid_address_is_refused(where):
    with pytest.raises(ValueError, match="must be tcp:PORT, tcp:HOST:PORT or pty, got"):
        ServoBridge(CommandInbox([], Warnings(print)), where)


@pytest.mark.parametrize("host", ["nowhere.invalid", "a..b", "[::1]"])  # RFC 6761
def test_an_unknown_host_is_refused(host):
    with pytest.raises(OSError, match="HOST must be an IPv4 address or name of"):
        ServoBridge(CommandInbox([], Warnings(print)), f"tcp:{host}:0")


def test_a_port_in_use_is_named(station):
    threads = threading.active_count()
    where = f"tcp:{station.bridge.address}"
    with pytest.raises(OSError, match=f"servo: {where}: Address already in use"):
        ServoBridge(CommandInbox([], Warnings(print)), where)
    assert threading.active_count() == threads


@pytest.mark.parametrize("where", ["tcp:0", "pty"])
def test_a_closed_bridge_leaves_no_thread_or_connection(where):
    if where == "pty":
        needs_pty()
    threads = threading.active_count()
    bridge = ServoBridge(CommandInbox([], Warnings(print)), where)
    client = connect(bridge) if where == "tcp:0" else None
    bridge.close()
    bridge.close()
    assert threading.active_count() == threads
    if client:
        with contextlib.suppress(ConnectionResetError):
            assert client.recv(1) == b""
        client.close()


# What clients may do.


def test_a_terminal_survives_clients_that_leave_half_a_packet():
    with FakeStation("pty") as station:
        for _ in range(2):
            with contextlib.closing(master_of(station.bridge)) as master:
                master.write(1, "led", 1)
            with contextlib.closing(open_line(station.bridge.address, 57600)) as line:
                line.write(b"\xff\xff\x01\x05\x03")  # half a packet
            time.sleep(0.15)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("protocol", "abuse"),
    [
        (1, b"\xff\xff\x01\xfe\x02" * 5000),
        (1, np.random.default_rng(0).bytes(50_000)),
        (1, PING[:4]),
        (2, b"\xff\xff\xfd\x00\x01\xff\x03\x02" * 2000),
        (2, np.random.default_rng(0).bytes(20_000)),
        (2, PING_2[:8]),
    ],
)
def test_garbage_is_reported_once_and_skipped(protocol, abuse):
    ping, pong = {1: (PING, PONG), 2: (PING_2, PONG_2)}[protocol]
    with FakeStation("tcp:0", protocol) as station, connect(station.bridge) as line:
        for _ in range(3):
            line.sendall(abuse)
            assert answers(line, ping, pong)
        with connect(station.bridge) as other:
            assert answers(other, ping, pong)
    assert 1 <= len(station.warnings) == len(set(station.warnings))


def test_vanishing_clients_do_not_disturb_others(line):
    for _ in range(3):
        connection = line()
        connection.sendall(PING[:3])
        # A reset instead of a regular close.
        linger = struct.pack("ii", 1, 0)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
        connection.close()
    assert answers(line())


def test_a_client_that_reads_no_replies_delays_nobody(line):
    slow, other = line(), line()
    slow.settimeout(0.2)
    for _ in range(10):
        with contextlib.suppress(TimeoutError):
            slow.sendall(PING * 6000)
        assert answers(other)


@pytest.mark.slow
@pytest.mark.parametrize("where", ["tcp:0", "pty"])
def test_an_unexpected_error_is_reported_and_ends_no_line(where, monkeypatch):
    answer = Servo.answer

    def fail_once(self, packet):
        monkeypatch.setattr(Servo, "answer", answer)
        raise RuntimeError("unforeseen")

    with FakeStation(where) as station:
        monkeypatch.setattr(Servo, "answer", fail_once)
        for fails in (True, False):
            with contextlib.closing(master_of(station.bridge, 0.5)) as master:
                # A connection is closed, a terminal is silent.
                expected = pytest.raises((BusError, OSError), match=r".")
                with expected if fails else contextlib.nullcontext():
                    master.write(1, "led", 1)
    (text,) = station.warnings
    assert "unforeseen" in text


def test_clients_are_accepted_again_after_too_many_open_files(
    station, line, monkeypatch
):
    monkeypatch.setattr(asyncio.constants, "ACCEPT_RETRY_DELAY", 0.05)
    real, failures = socket.socket.accept, iter(range(3))

    def accept(self):
        if next(failures, None) is not None:
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))
        return real(self)

    monkeypatch.setattr(socket.socket, "accept", accept)
    assert answers(line())
    assert next(failures, None) is None
    (text,) = station.warnings
    assert "Too many open files" in text


@pytest.mark.slow
def test_at_a_terminal_replies_are_whole_or_lost():
    read = Packet1(1, Instruction.READ, bytes([0, 74])).encode()
    with FakeStation("pty") as station:
        line = os.open(station.bridge.address, os.O_RDWR | os.O_NOCTTY)
        os.set_blocking(line, False)
        for _ in range(50):  # many more replies than the terminal takes
            with contextlib.suppress(BlockingIOError):
                os.write(line, 50 * read)
            time.sleep(0.01)
        reader, replies, idle = PacketReader(Packet1), 0, 0
        while idle < 30:  # a while of silence
            try:
                replies += len(list(reader.feed(os.read(line, 100), 0.0)))
                idle = 0
            except BlockingIOError:
                time.sleep(0.01)
                idle += 1
        os.close(line)
    assert replies > 20
    assert reader.dropped == reader.pending == 0
