"""The servo with drivers of others: SAKE's, and ROBOTIS's SDK."""

import contextlib
import importlib.util
from pathlib import Path

import dynamixel_sdk as sdk
import numpy as np
import pytest
from helpers import needs_pty

from robot.serve.dynamixel.fake_station import CLOSED, COUNT, FakeStation
from robot.serve.dynamixel.simulated_gripper import SimulatedGripper

# ROBOTIS's SDK.

ONE, TWO = (pytest.mark.parametrize("protocol", [n]) for n in (1, 2))
LED, GOAL_POSITION = 65, 116


@pytest.fixture
def master(protocol, monkeypatch):
    """The SDK at the servo's pseudo terminal: (handler, port, station)."""
    # Its timeout of 34 ms is too short on a busy machine. One test waits for it, with
    # Protocol 1.0.
    monkeypatch.setattr(sdk.port_handler, "LATENCY_TIMER", {1: 250, 2: 2500}[protocol])
    with FakeStation("pty", protocol=protocol) as station:
        port = sdk.PortHandler(station.bridge.address)
        assert port.openPort()
        assert port.setBaudRate(57600)
        yield sdk.PacketHandler(float(protocol)), port, station
        port.closePort()


@ONE
def test_the_sdk_pings_reads_and_writes(master):
    handler, port, station = master
    assert handler.ping(port, 1) == (310, sdk.COMM_SUCCESS, 0)
    goal = 3298 - 1000
    assert handler.write2ByteTxRx(port, 1, 30, goal) == (0, 0)
    station.sleep(3.0)
    position, *outcome = handler.read2ByteTxRx(port, 1, 36)
    assert outcome == [sdk.COMM_SUCCESS, 0]
    assert abs(position - goal) <= 1
    assert station.angle == pytest.approx(1000 * COUNT, abs=COUNT)


@ONE
def test_the_sdk_writes_and_reads_in_groups(master):
    handler, port, _ = master
    write = sdk.GroupSyncWrite(port, handler, 30, 4)
    write.addParam(1, [0x00, 0x08, 0x64, 0x00])
    write.addParam(2, [0x00, 0x00, 0x00, 0x00])
    assert write.txPacket() == sdk.COMM_SUCCESS
    # Its GroupBulkRead calls this with one argument too many (version 4.1.0).
    assert handler.bulkReadTx(port, [4, 1, 30], 3) == sdk.COMM_SUCCESS
    expected = [0x00, 0x08, 0x64, 0x00], sdk.COMM_SUCCESS, 0
    assert handler.readRx(port, 1, 4) == expected


@pytest.mark.slow
@ONE
def test_the_sdk_receives_errors(master):
    handler, port, _ = master
    assert handler.write2ByteTxRx(port, 1, 34, 2000)[1] == 8
    assert handler.factoryReset(port, 1)[1] == 64
    assert handler.ping(port, 2)[1] == sdk.COMM_RX_TIMEOUT


@pytest.fixture
def sake(master):
    """Functions of SAKE's driver that write and read registers by address."""
    handler, port, _ = master
    writers = {
        1: handler.write1ByteTxRx,
        2: handler.write2ByteTxRx,
        4: handler.write4ByteTxRx,
    }

    def write(address, value, size=2, error=0):
        assert writers[size](port, 1, address, value) == (sdk.COMM_SUCCESS, error)

    def read(address, error=0):
        value, *outcome = handler.read2ByteTxRx(port, 1, address)
        assert outcome == [sdk.COMM_SUCCESS, error]
        return value

    return write, read


@pytest.mark.slow
@ONE
def test_sake_s_driver_calibrates_moves_and_holds(master, sake):
    station, (write, read) = master[2], sake

    def set_effort(percent):
        write(34, 8 * percent)
        write(71, 1024 + 8 * percent)

    write(6, 0x0FFF0FFF, size=4)
    write(34, 500)
    write(24, 0, size=1)
    write(70, 1, size=1)
    write(71, 1024 + 100)
    station.sleep(4.0)
    write(71, 1024 + 10)
    write(20, 0)
    zero = read(36)
    assert zero == 3298 - round(CLOSED / COUNT)
    # To 60 % with full effort, and holding with 13 %.
    set_effort(100)
    write(70, 0, size=1)
    write(30, zero + 1500)
    station.sleep(3.0)
    assert read(36) == pytest.approx(zero + 1500, abs=1)
    assert station.angle == pytest.approx(CLOSED - 1500 * COUNT, abs=COUNT)
    set_effort(13)
    station.sleep(0.1)
    assert station.commands["gripper.force_limit"] == pytest.approx([0.13])
    # To 0 %, by torque.
    set_effort(50)
    write(70, 1, size=1)
    station.sleep(3.0)
    assert read(36) == pytest.approx(zero, abs=1)
    set_effort(13)
    station.sleep(0.1)
    # Held by a goal torque of 104 units of 4.5 mA. The stall current is 4.1 A, and full
    # PWM gives 800/1023 of the stall torque.
    assert np.isnan(station.commands["gripper.motor_position_commanded"][0])
    torque = station.commands["gripper.motor_torque_commanded"]
    assert torque == pytest.approx([104 * 4.5e-3 / 4.1 * 1023 / 800])
    assert station.commands["gripper.force_limit"] == pytest.approx([1.0])
    assert read(43) % 256 == 30  # degrees Celsius
    write(70, 0, size=1)
    assert station.warnings == []


@pytest.mark.slow
@ONE
def test_sake_s_driver_recovers_from_an_overload(master, sake):
    station, (write, read) = master[2], sake
    write(34, 800)
    write(30, 0)  # far beyond the closed fingers
    station.sleep(11.0)
    read(34, error=32)
    write(71, 0, error=32)
    write(70, 0, size=1, error=32)
    write(34, 500)
    assert read(34) == 500
    station.sleep(0.1)
    assert station.commands["gripper.motor_torque_commanded"] == [0.0]
    assert len(station.warnings) == 1


@TWO
def test_the_sdk_writes_and_reads_in_groups_by_protocol_2(master):
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


@TWO
def test_the_sdk_receives_the_errors_of_protocol_2(master):
    handler, port, _ = master
    assert handler.write4ByteTxRx(port, 1, GOAL_POSITION, 4096) == (0, 6)
    assert handler.write2ByteTxRx(port, 1, GOAL_POSITION, 0) == (0, 5)
    assert handler.write2ByteTxRx(port, 1, 0, 0) == (0, 7)


@TWO
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


# The simulated gripper.


@pytest.fixture(scope="module")
def driver():
    """The module of the example, which is such a driver."""
    path = Path(__file__).parents[4] / "examples" / "servo_client.py"
    spec = importlib.util.spec_from_file_location("servo_client", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
