"""The bridge with Protocol 2.0."""

import contextlib
import importlib.util
from pathlib import Path

import dynamixel_sdk as sdk
import numpy as np
import pytest
from helpers import needs_pty

from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import ServoBridge
from robot.serve.dynamixel.fake_station import (
    CLOSED,
    COUNT,
    PING_2,
    PONG_2,
    FakeStation,
    answers,
    connect,
)
from robot.serve.dynamixel.simulated_gripper import SimulatedGripper

OPEN = 3298
LED, CURRENT_LIMIT, GOAL_POSITION, POSITION = 65, 38, 116, 132


def test_an_unknown_protocol_is_refused():
    with pytest.raises(ValueError, match="protocol: must be 1 or 2, got 3"):
        ServoBridge(CommandInbox([], Warnings(print)), "tcp:0", protocol=3)


@pytest.mark.parametrize(
    "abuse",
    [
        b"\xff\xff\xfd" * 3000,
        b"\xff\xff\xfd\x00\x01\xff\x03\x02" * 2000,
        np.random.default_rng(0).bytes(20_000),
        PING_2[:8],
        PING_2[:-1] + b"\x00",
    ],
)
def test_garbage_is_reported_once_and_skipped(abuse):
    with FakeStation("tcp:0", protocol=2) as station, connect(station.bridge) as line:
        for _ in range(2):
            line.sendall(abuse)
            assert answers(line, PING_2, PONG_2)
        with connect(station.bridge) as other:
            assert answers(other, PING_2, PONG_2)
    assert 1 <= len(station.warnings) == len(set(station.warnings))


# ROBOTIS's dynamixel-sdk.


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    # The sdk's timeout of 34 ms is too short on a busy machine.
    monkeypatch.setattr(sdk.port_handler, "LATENCY_TIMER", 2500)


@pytest.fixture
def master():
    """dynamixel-sdk at the servo's pseudo terminal: (handler, port, station)."""
    with FakeStation("pty", protocol=2) as station:
        port = sdk.PortHandler(station.bridge.address)
        assert port.openPort()
        assert port.setBaudRate(57600)
        yield sdk.PacketHandler(2.0), port, station
        port.closePort()


def test_the_sdk_pings_reads_and_writes(master):
    handler, port, station = master
    assert handler.ping(port, 1) == (311, sdk.COMM_SUCCESS, 0)
    assert handler.write1ByteTxRx(port, 1, 64, 1) == (0, 0)
    assert handler.read2ByteTxRx(port, 1, CURRENT_LIMIT) == (1941, 0, 0)
    goal = OPEN - 1000
    assert handler.write4ByteTxRx(port, 1, GOAL_POSITION, goal) == (0, 0)
    station.sleep(3.0)
    position, *outcome = handler.read4ByteTxRx(port, 1, POSITION)
    assert outcome == [sdk.COMM_SUCCESS, 0]
    assert abs(position - goal) <= 1
    assert station.angle == pytest.approx(1000 * COUNT, abs=COUNT)


def test_the_sdk_registers_and_executes_a_write(master):
    handler, port, _ = master
    assert handler.regWriteTxRx(port, 1, LED, 1, [1]) == (0, 0)
    assert handler.read1ByteTxRx(port, 1, LED) == (0, 0, 0)
    assert handler.action(port, 1) == sdk.COMM_SUCCESS
    # Its `action` waits for no reply, which is still to come.
    port.setPacketTimeout(11)
    assert handler.rxPacket(port, False)[1] == sdk.COMM_SUCCESS
    assert handler.read1ByteTxRx(port, 1, LED) == (1, 0, 0)


def test_the_sdk_writes_and_reads_in_groups(master):
    handler, port, _ = master
    write = sdk.GroupSyncWrite(port, handler, 112, 4)
    assert write.addParam(1, [100, 0, 0, 0]) and write.addParam(2, [1, 0, 0, 0])
    assert write.txPacket() == sdk.COMM_SUCCESS
    write = sdk.GroupBulkWrite(port, handler)
    assert write.addParam(1, LED, 1, [1])
    assert write.txPacket() == sdk.COMM_SUCCESS
    sync, bulk = (
        sdk.GroupSyncRead(port, handler, 112, 4),
        sdk.GroupBulkRead(port, handler),
    )
    assert sync.addParam(1) and bulk.addParam(1, LED, 1)
    for read in (sync.txRxPacket, sync.fastSyncRead):
        assert read() == sdk.COMM_SUCCESS
        assert sync.getData(1, 112, 4) == 100
    for read in (bulk.txRxPacket, bulk.fastBulkRead):
        assert read() == sdk.COMM_SUCCESS
        assert bulk.getData(1, LED, 1) == 1


def test_the_sdk_receives_errors(master):
    handler, port, _ = master
    assert handler.write4ByteTxRx(port, 1, GOAL_POSITION, 4096) == (0, 6)
    assert handler.write2ByteTxRx(port, 1, GOAL_POSITION, 0) == (0, 5)
    assert handler.write2ByteTxRx(port, 1, 0, 0) == (0, 7)


def test_the_sdk_reboots_and_resets(master):
    handler, port, _ = master
    handler.write1ByteTxRx(port, 1, 11, 5)
    handler.write1ByteTxRx(port, 1, LED, 1)
    assert handler.reboot(port, 1) == (sdk.COMM_SUCCESS, 0)
    assert handler.read1ByteTxRx(port, 1, LED) == (0, 0, 0)
    assert handler.read1ByteTxRx(port, 1, 11) == (5, 0, 0)
    assert handler.clearMultiTurn(port, 1) == (sdk.COMM_SUCCESS, 0)
    assert handler.factoryReset(port, 1, 0xFF) == (sdk.COMM_SUCCESS, 0)
    assert handler.read1ByteTxRx(port, 1, 11) == (3, 0, 0)


# A driver for Protocol 2.0.


@pytest.fixture(scope="module")
def driver():
    """The module of the example, which is such a driver."""
    path = Path(__file__).parents[4] / "examples" / "servo_client.py"
    spec = importlib.util.spec_from_file_location("servo_client", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_driver_calibrates_by_current_and_tells_contact(driver):
    with FakeStation("pty", protocol=2) as station:
        gripper = driver.Gripper(station.bridge.address)
        with contextlib.closing(gripper):
            gripper.calibrate()
            assert gripper.zero == OPEN - round(CLOSED / COUNT)
            assert gripper.move(60, effort=30).position == pytest.approx(60, abs=2)
            gripper.move(-10, effort=30)  # the fingers meet at 0
            position, current, temperature, errors = gripper.sample()
            assert position == pytest.approx(0, abs=0.1)
            # The goal current, which the motor gives at rest.
            assert current == pytest.approx(-0.3 * 4.1, abs=0.01)
            assert (temperature, errors) == (30, 0)
    assert station.warnings == []


@pytest.mark.slow
def test_a_driver_moves_the_simulated_gripper(driver):
    needs_pty()
    with SimulatedGripper("pty", protocol=2) as simulated:
        gripper = driver.Gripper(simulated.bridge.address)
        with contextlib.closing(gripper):
            gripper.calibrate()
            # In the vendor's geometry the pads meet at 100.7 degrees.
            met = np.deg2rad([100.7] * 2)
            assert simulated.q[:2] == pytest.approx(met, abs=0.05)
            assert gripper.samples[-1].current == pytest.approx(-0.2 * 4.1, rel=0.05)

            assert gripper.move(50, effort=30).position == pytest.approx(50, abs=2)

            # Told by contact: nearer to it than to the goal. With less effort than at
            # the calibration, the wires stretch less: the motor goes back by 3 %,
            # and a busy machine samples late enough to see that.
            assert gripper.move(-10, effort=15).position == pytest.approx(0, abs=5)
            gripper.sleep(0.6)
            _, current, temperature, errors = gripper.sample()
            assert current == pytest.approx(-0.15 * 4.1, rel=0.05)
            # Of 6 N m, on two wires at a radius of 7.6 mm.
            force = 0.15 * 6.0 / (2 * 7.6e-3)
            assert simulated.force == pytest.approx([force] * 2, rel=0.05)
            assert 25 <= temperature < 30
            assert errors == 0

            gripper.hold(effort=10)
            gripper.sleep(1.0)  # the wires slacken slowly against the motor
            assert gripper.sample().current == pytest.approx(-0.1 * 4.1, rel=0.05)
    assert simulated.told == []
