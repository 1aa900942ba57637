import contextlib
import errno
import os
import socket
import struct
import threading
import time
from types import SimpleNamespace

import dynamixel_sdk
import numpy as np
import pytest
from helpers import needs_pty

from bridges.conftest import wait_until
from bridges.dynamixel.servo_client import ServoClient
from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.dynamixel import bridge as servo
from drake_srg.bridges.dynamixel.bridge import ServoBridge
from drake_srg.bridges.dynamixel.protocol import Instruction, Packet, PacketReader
from drake_srg.bridges.serve import Serve
from drake_srg.scenario import load_scenario

COUNT = 2 * np.pi / 4096
CLOSED = 2.8  # rad, where the fake gripper's fingers meet
PING = Packet(1, Instruction.PING).encode()
PONG = Packet(1, 0).encode()


class FakeStation(threading.Thread):
    """A motor without inertia behind a bridge, ten times as fast as real."""

    def __init__(self, where):
        super().__init__(daemon=True)
        if where == "pty":
            needs_pty()
        self.warnings = []
        self.inbox = CommandInbox([], Warnings(self.warnings.append))
        self.bridge = ServoBridge(self.inbox, where)
        self.time = self.angle = 0.0
        self.commands = {}
        self._done = threading.Event()

    def run(self):
        while not self._done.wait(0.0005):
            self.commands.update(self.inbox.take())
            self.step(**{k.split(".")[1]: v[0] for k, v in self.commands.items()})

    def step(
        self,
        *,
        motor_position_commanded=np.nan,
        motor_torque_commanded=np.nan,
        force_limit=1.0,
    ):
        if np.isfinite(motor_torque_commanded):
            torque = np.clip(motor_torque_commanded, -force_limit, force_limit)
            pwm, speed = torque, 20.0 * torque
        else:
            pull = 5.0 * (motor_position_commanded - self.angle)
            pwm = np.clip(np.nan_to_num(pull), -force_limit, force_limit)
            speed = 5.0 * pwm
        if self.angle + 0.005 * speed > CLOSED:
            speed = (CLOSED - self.angle) / 0.005
        self.angle += 0.005 * speed
        self.time += 0.005
        values = [self.angle, speed], [pwm], [30.0]
        self.bridge.update(
            self.time,
            dict(zip(self.bridge.ports, map(np.array, values), strict=True)),
        )

    def sleep(self, duration):
        end = self.time + duration
        assert wait_until(lambda: self.time >= end, 20.0)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self._done.set()
        self.join()
        self.bridge.close()


@pytest.fixture
def station():
    with FakeStation("tcp:0") as station:
        yield station


@pytest.fixture
def line(station):
    """A function that opens another connection."""
    with contextlib.ExitStack() as stack:
        yield lambda: stack.enter_context(connect(station.bridge))


def connect(bridge):
    host, _, port = bridge.address.rpartition(":")
    return socket.create_connection((host.strip("[]"), int(port)), timeout=5.0)


def answers(connection):
    """Whether a ping is answered, by and by, whatever came before."""
    received = b""
    connection.settimeout(0.2)  # longer than the servo waits for the rest of a packet
    for _ in range(25):
        connection.sendall(PING)
        with contextlib.suppress(TimeoutError):
            while not received.endswith(PONG):
                received += connection.recv(1000)
            return True
    return False


def client_of(station, url=None):
    url = url or f"socket://{station.bridge.address}"
    return ServoClient(url, station.sleep, lambda: station.time)


# What SAKE's driver does.


def test_sakes_sequences(station):
    client = client_of(station)
    client.calibrate()
    assert client.zero == 3298 - round(CLOSED / COUNT)
    assert client.get_position() == 0
    client.goto_position(60, 100)
    assert client.get_position() == 60
    assert station.angle == pytest.approx(CLOSED - 1500 * COUNT, abs=COUNT)
    station.sleep(0.1)
    assert station.commands["gripper.force_limit"] == pytest.approx([0.13])
    client.goto_position(0, 50)
    assert client.get_position() == 0
    station.sleep(0.1)
    # Held by 13 % of torque: here that is what the limit says, 104 of 800.
    assert np.isnan(station.commands["gripper.motor_position_commanded"][0])
    assert station.commands["gripper.force_limit"] == pytest.approx([0.13])
    assert client.get_temperature() == 30
    client.release()
    assert station.warnings == []


def test_an_overload_is_recovered_from(station):
    client = client_of(station)
    client.write(34, 800)
    client.write(30, 0)  # as far as it would go, through closed fingers
    station.sleep(11.0)
    assert client.check_overload_and_recover() == (32, 0)
    assert client.check_overload_and_recover() == (0, 0)
    station.sleep(0.1)
    assert station.commands["gripper.motor_torque_commanded"] == [0.0]
    assert len(station.warnings) == 1


# Others who command the same gripper.


def grasp(percent=50):
    """What another source commands: closure, and nothing of the motor."""
    ports = ("motor_position_commanded", "motor_torque_commanded", "force_limit")
    free = {f"gripper.{port}": np.array([np.nan]) for port in ports}
    return {"gripper.closure_commanded": np.array([percent / 100.0]), **free}


@pytest.fixture
def quiet():
    """A bridge whose motor does nothing: (bridge, inbox, client)."""
    inbox = CommandInbox([], Warnings(print))
    with contextlib.closing(ServoBridge(inbox, "tcp:0")) as bridge:
        client = ServoClient(f"socket://{bridge.address}", lambda _: None)
        bridge.update(0.0, motor())
        inbox.take()
        yield bridge, inbox, client
        client.close()


def motor(angle=0.0):
    return dict(
        zip(
            ServoBridge.ports, map(np.array, ([angle, 0.0], [0.0], [25.0])), strict=True
        )
    )


def test_what_is_written_again_counts_again_after_another_source(quiet):
    bridge, inbox, client = quiet
    client.write(30, 2500)
    first = inbox.take()
    inbox.put(grasp(), "/grasp")
    bridge.update(0.005, motor())
    inbox.take()
    client.write(30, 2500)
    np.testing.assert_equal(inbox.take(), first)
    assert np.isfinite(first["gripper.motor_position_commanded"]).all()


def test_another_source_interrupts_a_slow_motion(quiet):
    bridge, inbox, client = quiet
    client.write(32, 20)
    client.write(30, 1000)
    inbox.put(grasp(), "/grasp")
    for k in range(100):
        bridge.update(0.005 * k, motor())
    client.write(34, 104)  # moves nothing
    np.testing.assert_equal(inbox.take(), grasp())


def test_packets_that_write_are_counted_once_good_or_bad(quiet):
    bridge, inbox, client = quiet
    before = inbox.received
    client.write(32, 2)
    client.write(30, 1000)
    client.read(36, 2)
    for k in range(100):
        bridge.update(0.005 * k, motor())
    client.send(3, 0, 1)  # read only
    assert inbox.received == before + 3


# An independent master.


@pytest.fixture
def master(monkeypatch):
    """dynamixel-sdk at the servo's pseudo terminal: (handler, port, station)."""
    # It would wait for 34 ms at most; busy machines need longer.
    monkeypatch.setattr(dynamixel_sdk.port_handler, "LATENCY_TIMER", 250)
    with FakeStation("pty") as station:
        port = dynamixel_sdk.PortHandler(station.bridge.address)
        assert port.openPort()
        assert port.setBaudRate(57600)
        yield dynamixel_sdk.PacketHandler(1.0), port, station
        port.closePort()


def test_dynamixel_sdk_pings_reads_and_writes(master):
    handler, port, station = master
    assert handler.ping(port, 1) == (310, dynamixel_sdk.COMM_SUCCESS, 0)
    goal = 3298 - 1000
    assert handler.write2ByteTxRx(port, 1, 30, goal) == (0, 0)
    station.sleep(3.0)
    position, *outcome = handler.read2ByteTxRx(port, 1, 36)
    assert outcome == [dynamixel_sdk.COMM_SUCCESS, 0]
    assert abs(position - goal) <= 1
    assert station.angle == pytest.approx(1000 * COUNT, abs=COUNT)


def test_dynamixel_sdk_writes_and_reads_many(master):
    handler, port, _ = master
    write = dynamixel_sdk.GroupSyncWrite(port, handler, 30, 4)
    write.addParam(1, [0x00, 0x08, 0x64, 0x00])
    write.addParam(2, [0x00, 0x00, 0x00, 0x00])
    assert write.txPacket() == dynamixel_sdk.COMM_SUCCESS
    # Its GroupBulkRead calls this with an argument too many (4.1.0).
    assert handler.bulkReadTx(port, [4, 1, 30], 3) == dynamixel_sdk.COMM_SUCCESS
    expected = [0x00, 0x08, 0x64, 0x00], dynamixel_sdk.COMM_SUCCESS, 0
    assert handler.readRx(port, 1, 4) == expected


def test_dynamixel_sdk_hears_of_faults(master):
    handler, port, _ = master
    assert handler.write2ByteTxRx(port, 1, 34, 2000)[1] == 8
    assert handler.factoryReset(port, 1)[1] == 64
    assert handler.ping(port, 2)[1] == dynamixel_sdk.COMM_RX_TIMEOUT


def test_at_a_terminal_clients_come_and_go():
    with FakeStation("pty") as station:
        for _ in range(2):
            client = client_of(station, station.bridge.address)
            client.write(25, 1, size=1)
            client._line.write(b"\xff\xff\x01\x05\x03")  # half a packet
            client.close()
            time.sleep(0.15)


# Where it listens.


def test_it_says_where_it_is(station):
    host, _, port = station.bridge.address.rpartition(":")
    assert host == "127.0.0.1"
    assert station.bridge.status == f"servo at tcp:127.0.0.1:{port}"


def test_it_says_at_which_terminal_it_is():
    with FakeStation("pty") as other:
        assert other.bridge.status == f"servo at {other.bridge.address}"
        assert other.bridge.address.startswith("/dev/")


@pytest.mark.parametrize("where", ["", "tcp", "tcp:", "tcp:x", "tcp:70000", "usb:1"])
def test_where_it_cannot_be(where):
    with pytest.raises(ValueError, match="allowed are tcp:PORT, tcp:HOST:PORT and pty"):
        ServoBridge(CommandInbox([], Warnings(print)), where)


@pytest.mark.parametrize("host", ["nowhere.invalid", "a..b"])  # RFC 6761: nobody's
def test_a_host_that_is_not_found_is_told(host):
    with pytest.raises(OSError, match="HOST must be an address or a name of this mach"):
        ServoBridge(CommandInbox([], Warnings(print)), f"tcp:{host}:0")


def test_it_listens_at_ipv6_addresses():
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("this machine has no IPv6")
    with FakeStation("tcp:[::1]:0") as station:
        assert station.bridge.address.startswith("[::1]:")
        with connect(station.bridge) as connection:
            assert answers(connection)


def test_a_taken_port_is_told(station):
    threads = threading.active_count()
    where = f"tcp:{station.bridge.address}"
    with pytest.raises(OSError, match=f"servo: {where}: Address already in use"):
        ServoBridge(CommandInbox([], Warnings(print)), where)
    assert threading.active_count() == threads


@pytest.mark.parametrize("where", ["tcp:0", "pty"])
def test_closed_it_leaves_nothing(where):
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


# Abuse.


def test_several_clients_at_once(line):
    connections = [line() for _ in range(5)]
    assert all(answers(connection) for connection in connections)


@pytest.mark.parametrize(
    "abuse",
    [
        b"\xff" * 10_000,
        b"\xff\xff\x01\xfe\x02" * 5000,
        np.random.default_rng(0).bytes(50_000),
        PING[:4],
        PING[:-1] + b"\x00",
    ],
)
def test_garbage_is_told_once_and_done_with(station, line, abuse):
    connection = line()
    for _ in range(3):
        connection.sendall(abuse)
        assert answers(connection)
    assert answers(line())
    assert 1 <= len(station.warnings) == len(set(station.warnings))


def test_clients_may_vanish(line):
    for _ in range(3):
        connection = line()
        connection.sendall(PING[:3])
        # Gone with a reset, not with a goodbye.
        linger = struct.pack("ii", 1, 0)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
        connection.close()
    assert answers(line())


def test_who_reads_no_replies_stops_nobody_else(line):
    slow, other = line(), line()
    slow.settimeout(0.2)
    for _ in range(30):
        with contextlib.suppress(TimeoutError):
            slow.sendall(PING * 2000)
        assert answers(other)


def test_too_many_open_files_are_no_end(station, line, monkeypatch):
    monkeypatch.setattr(servo, "_PAUSE", 0.05)
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


def test_at_a_terminal_replies_are_whole_or_lost(monkeypatch):
    read = Packet(1, Instruction.READ, bytes([0, 74])).encode()
    with FakeStation("pty") as station:
        line = os.open(station.bridge.address, os.O_RDWR | os.O_NOCTTY)
        os.set_blocking(line, False)
        end = time.monotonic() + 1.0
        while time.monotonic() < end:  # many more replies than fit in
            with contextlib.suppress(BlockingIOError):
                os.write(line, 50 * read)
            time.sleep(0.01)
        reader, replies, idle = PacketReader(), 0, 0
        while idle < 20:
            try:
                replies += len(list(reader.feed(os.read(line, 100), 0.0)))
                idle = 0
            except BlockingIOError:
                time.sleep(0.01)
                idle += 1
        os.close(line)
    assert replies > 20
    assert reader.dropped == len(reader._buffer) == 0


# The gripper itself.


def test_sakes_sequences_move_the_simulated_gripper():
    # As fast as it goes; the client's clock is the simulation's.
    seen = SimpleNamespace(time=0.0, q=None)
    ready, stop = threading.Event(), threading.Event()

    class Watched(ServoBridge):
        ports = (*ServoBridge.ports, "gripper.state_measured", "gripper.wire_force")

        def update(self, time, values):
            super().update(time, values)
            seen.q = values["gripper.state_measured"][:4].copy()
            seen.force = values["gripper.wire_force"].copy()
            seen.time = time

    def connect(inbox, topics):
        seen.bridge = Watched(inbox, "tcp:0")
        ready.set()
        return [seen.bridge]

    def sleep(duration):
        end = seen.time + duration
        assert wait_until(lambda: seen.time >= end, 60.0)

    # Pointing to the front: down, the fingers would fall shut against their springs.
    front = "directives.gripper::palm.add_weld.X_PC.rotation=!Rpy {deg: [0, 0, 0]}"
    scenario = load_scenario(
        "gripper_bench_fast", overrides=["object.present=false", front]
    )
    told = []
    served = threading.Thread(
        target=lambda: Serve(scenario, connect, rate=0.0, stop=stop, tell=told.append),
        daemon=True,
    )
    served.start()
    assert ready.wait(60.0)
    try:
        client = ServoClient(
            f"socket://{seen.bridge.address}", sleep, lambda: seen.time
        )
        client.calibrate()
        closed = seen.q
        # Pads at each other: the vendor's geometry has them so at 100.7 degrees.
        assert closed[:2] == pytest.approx(np.deg2rad([100.7] * 2), abs=0.05)

        client.goto_position(100, 100)
        assert client.get_position() == pytest.approx(100, abs=1)
        sleep(2.0)  # the springs are slower than the motor
        assert seen.q == pytest.approx([0.0] * 4, abs=0.02)

        client.goto_position(0, 50)
        assert client.get_position() <= 1
        assert seen.q[:2] == pytest.approx(closed[:2], abs=0.05)
        sleep(1.0)
        # 13 % of 308 N at each wire
        assert seen.force == pytest.approx([40.0, 40.0], rel=0.05)

        client.goto_position(50, 50)
        assert client.get_position() == pytest.approx(50, abs=1)
        assert 25 <= client.get_temperature() < 30
        assert client.check_overload_and_recover() == (0, 0)
    finally:
        stop.set()
        served.join(60.0)
    assert told == []
