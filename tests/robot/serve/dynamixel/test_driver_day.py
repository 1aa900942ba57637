"""A day of SAKE's driver of today: its calls and registers, through ROBOTIS's SDK.

It opens a connection per servo, sets modes and limits with torque off, calibrates by a
goal far beyond closed, moves by registered writes and an action, reads by sync read or
word by word (also words that end in a gap between registers), and reboots after errors.
"""

import dynamixel_sdk as sdk
import pytest

from robot.serve.dynamixel.fake_station import FakeStation

MODE, CURRENT_LIMIT, TORQUE, ERROR = 11, 38, 64, 70
GOAL_CURRENT, GOAL_POSITION = 102, 116
CURRENT, POSITION, VOLTAGE, TEMPERATURE = 126, 132, 144, 146


class PatientPort(sdk.PortHandler):
    """Waits 5 s for a reply: the SDK's 34 ms are too few on a busy machine."""

    def setPacketTimeout(self, packet_length):
        self.setPacketTimeoutMillis(5000.0)


class Driver:
    """Raises an AssertionError at the first reply with an error."""

    def __init__(self, device):
        self.port, self.servo = PatientPort(device), sdk.PacketHandler(2.0)
        assert self.port.openPort() and self.port.setBaudRate(1000000)
        model, *result = self.servo.ping(self.port, 1)
        assert (model, *result) == (311, sdk.COMM_SUCCESS, 0)

    def read(self, address, size=2):
        data, *result = self.servo.readTxRx(self.port, 1, address, size)
        assert result == [sdk.COMM_SUCCESS, 0], address
        return int.from_bytes(bytes(data), "little", signed=size == 4)

    def write(self, address, size, value):
        data = list(value.to_bytes(size, "little", signed=value < 0))
        result = self.servo.writeTxRx(self.port, 1, address, size, data)
        assert result == (sdk.COMM_SUCCESS, 0), address

    def go(self, position, current):
        for address, size, value in (
            (GOAL_CURRENT, 2, current),
            (GOAL_POSITION, 4, position),
        ):
            data = list(value.to_bytes(size, "little", signed=value < 0))
            result = self.servo.regWriteTxRx(self.port, 1, address, size, data)
            assert result == (sdk.COMM_SUCCESS, 0), address
        assert self.servo.action(self.port, 1) == sdk.COMM_SUCCESS
        # The SDK does not wait for this reply, and could take it for the next one.
        self.port.setPacketTimeout(11)
        status, result = self.servo.rxPacket(self.port, False)
        assert (status[2 + 2], result) == (1, sdk.COMM_SUCCESS)
        # A servo keeps only the last registered write: the position.
        self.write(GOAL_CURRENT, 2, current)

    def sync_position(self):
        group = sdk.GroupSyncRead(self.port, self.servo, POSITION, 4)
        assert group.addParam(1)
        assert group.txRxPacket() == sdk.COMM_SUCCESS
        return group.getData(1, POSITION, 4)


@pytest.fixture
def station():
    with FakeStation("pty", protocol=2) as station:
        yield station


def test_a_day_passes_without_an_error(station):
    driver = Driver(station.bridge.address)
    assert driver.read(ERROR) == 0
    assert driver.read(10) >> 8 == driver.read(MODE, 1) == 3
    driver.write(TORQUE, 1, 0)
    driver.write(MODE, 1, 5)
    driver.write(CURRENT_LIMIT, 2, 1600)
    assert driver.read(CURRENT_LIMIT) == 1600
    driver.write(TORQUE, 1, 1)
    # Calibration: beyond closed at 30 %, then half open.
    driver.go(-7500, 480)
    station.sleep(4.0)
    zero = driver.sync_position()
    assert zero == driver.read(POSITION, 4) == 1473
    driver.go(zero + 1250, 800)
    station.sleep(4.0)
    assert abs(driver.sync_position() - zero - 1250) < 250
    # Grasp, hold and release, at the driver's pace.
    for percent, force in ((0, 50), (0, 15), (100, 50)):
        for _ in range(10):
            driver.go(zero + 25 * percent, 16 * force)
            words = [driver.read(a) for a in (POSITION, CURRENT, VOLTAGE, TEMPERATURE)]
            assert words[2:] == [120, 30] and driver.read(ERROR) == 0
            station.sleep(1 / 30)
    # What it does after an error.
    assert driver.servo.reboot(driver.port, 1) == (sdk.COMM_SUCCESS, 0)
    assert driver.read(TORQUE, 1) == 0
    driver.write(TORQUE, 1, 1)
    driver.port.closePort()
    assert station.warnings == []
