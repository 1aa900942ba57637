import contextlib

import dynamixel_sdk
import numpy as np
import pytest

from bridges.dynamixel.fake_station import CLOSED, COUNT, FakeStation, client_of
from bridges.dynamixel.servo_client import ServoClient
from bridges.dynamixel.simulated_gripper import SimulatedGripper
from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.dynamixel.bridge import ServoBridge
from drake_srg.bridges.dynamixel.mechanisms import WiredGripper

# SAKE's driver.


@pytest.mark.slow
def test_sake_s_driver_calibrates_moves_and_holds(station):
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
    # Held with 13 % of torque, the limit of 104/800.
    assert np.isnan(station.commands["gripper.motor_position_commanded"][0])
    assert station.commands["gripper.force_limit"] == pytest.approx([0.13])
    assert client.get_temperature() == 30
    client.release()
    assert station.warnings == []


@pytest.mark.slow
def test_sake_s_driver_recovers_from_an_overload(station):
    client = client_of(station)
    client.write(34, 800)
    client.write(30, 0)  # far beyond the closed fingers
    station.sleep(11.0)
    assert client.check_overload_and_recover() == (32, 0)
    assert client.check_overload_and_recover() == (0, 0)
    station.sleep(0.1)
    assert station.commands["gripper.motor_torque_commanded"] == [0.0]
    assert len(station.warnings) == 1


# Other sources of commands.


def grasp(percent=50):
    """Return another source's command: a closure, and no motor command."""
    ports = ("motor_position_commanded", "motor_torque_commanded", "force_limit")
    free = {f"gripper.{port}": np.array([np.nan]) for port in ports}
    return {"gripper.closure_commanded": np.array([percent / 100.0]), **free}


@pytest.fixture
def quiet():
    """A bridge whose motor stands still: (bridge, inbox, client)."""
    inbox = CommandInbox([], Warnings(print))
    with contextlib.closing(ServoBridge(inbox, "tcp:0")) as bridge:
        client = ServoClient(f"socket://{bridge.address}", lambda _: None)
        bridge.update(0.0, motor())
        inbox.take()
        yield bridge, inbox, client
        client.close()


def motor(angle=0.0):
    values = map(np.array, ([angle, 0.0], [0.0], [25.0]))
    return dict(zip(WiredGripper.ports, values, strict=True))


def test_a_repeated_write_wins_over_another_source(quiet):
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
    client.write(34, 104)  # a register that moves nothing
    np.testing.assert_equal(inbox.take(), grasp())


def test_write_packets_are_counted_once_good_or_bad(quiet):
    bridge, inbox, client = quiet
    before = inbox.received
    client.write(32, 2)
    client.write(30, 1000)
    client.read(36, 2)
    for k in range(100):
        bridge.update(0.005 * k, motor())
    client.send(3, 0, 1)  # read only
    assert inbox.received == before + 3


# An independent driver.


@pytest.fixture
def master(monkeypatch):
    """dynamixel-sdk at the servo's pseudo terminal: (handler, port, station)."""
    # Its default timeout of 34 ms is too short on a busy machine.
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


def test_dynamixel_sdk_writes_and_reads_in_groups(master):
    handler, port, _ = master
    write = dynamixel_sdk.GroupSyncWrite(port, handler, 30, 4)
    write.addParam(1, [0x00, 0x08, 0x64, 0x00])
    write.addParam(2, [0x00, 0x00, 0x00, 0x00])
    assert write.txPacket() == dynamixel_sdk.COMM_SUCCESS
    # Its GroupBulkRead calls this with one argument too many (version 4.1.0).
    assert handler.bulkReadTx(port, [4, 1, 30], 3) == dynamixel_sdk.COMM_SUCCESS
    expected = [0x00, 0x08, 0x64, 0x00], dynamixel_sdk.COMM_SUCCESS, 0
    assert handler.readRx(port, 1, 4) == expected


@pytest.mark.slow
def test_dynamixel_sdk_receives_errors(master):
    handler, port, _ = master
    assert handler.write2ByteTxRx(port, 1, 34, 2000)[1] == 8
    assert handler.factoryReset(port, 1)[1] == 64
    assert handler.ping(port, 2)[1] == dynamixel_sdk.COMM_RX_TIMEOUT


# The simulated gripper.


@pytest.mark.slow
def test_sake_s_driver_moves_the_simulated_gripper():
    with SimulatedGripper("tcp:0") as gripper:
        client = ServoClient(
            f"socket://{gripper.bridge.address}", gripper.sleep, lambda: gripper.time
        )
        client.calibrate()
        closed = gripper.q
        # In the vendor's geometry the pads meet at 100.7 degrees.
        assert closed[:2] == pytest.approx(np.deg2rad([100.7] * 2), abs=0.05)

        client.goto_position(100, 100)
        assert client.get_position() == pytest.approx(100, abs=1)
        gripper.sleep(2.0)  # the springs open the fingers slower than the motor turns
        assert gripper.q == pytest.approx([0.0] * 4, abs=0.02)

        client.goto_position(0, 50)
        assert client.get_position() <= 1
        assert gripper.q[:2] == pytest.approx(closed[:2], abs=0.05)
        gripper.sleep(1.0)
        # 13 % of 308 N per wire.
        assert gripper.force == pytest.approx([40.0, 40.0], rel=0.05)

        client.goto_position(50, 50)
        assert client.get_position() == pytest.approx(50, abs=1)
        assert 25 <= client.get_temperature() < 30
        assert client.check_overload_and_recover() == (0, 0)
    assert gripper.told == []
