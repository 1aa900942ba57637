"""Calibrate, open and close a gripper through its servo, with Dynamixel Protocol 2.0.

    drake-srg serve gripper_bench --servo pty --protocol 2    # shows the terminal
    pip install dynamixel-sdk
    python examples/servo_client.py /dev/pts/3

The servo has ID 1. Percent are SAKE's: 100 open, 0 closed.
"""

import math
import os
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import dynamixel_sdk as sdk

OPERATING_MODE, TORQUE_ENABLE = 11, 64
GOAL_PWM, GOAL_CURRENT, GOAL_POSITION = 100, 102, 116
CURRENT_MODE, CURRENT_BASED_POSITION_MODE = 0, 5
FULL_PWM, FULL_CURRENT = 885, 1220  # registers of 100 % effort; 1220 is 4.1 A
TRAVEL = 2500  # counts from closed to open, SAKE's 100 %
# Registers that are read as one block, and its ends.
ERRORS, TICK, CURRENT, POSITION, TEMPERATURE = 70, 120, 126, 132, 146
FIRST, SIZE = ERRORS, TEMPERATURE + 1 - ERRORS


class Sample(NamedTuple):
    """State of the gripper: percent of opening, amperes, degrees Celsius, error bits.

    A current that closes is negative.
    """

    position: float
    current: float
    temperature: int
    errors: int


class Gripper:
    """An SRG at a serial port.

    It takes its time from the servo's clock, so it works at any pace of a simulation.

    Args:
        device: The port.

    Attributes:
        zero: Position at which the fingers meet [counts], found by `calibrate`.
        samples: All so far.
    """

    def __init__(self, device: str):
        self.zero = 0
        self.samples: list[Sample] = []
        self._servo = sdk.PacketHandler(2.0)
        self._port = sdk.PortHandler(device)
        self._port.openPort()
        self._port.setBaudRate(57600)
        self._block = sdk.GroupBulkRead(self._port, self._servo)
        self._block.addParam(1, FIRST, SIZE)

    def close(self) -> None:
        """Close the port."""
        self._port.closePort()

    def calibrate(self, effort: float = 20.0) -> None:
        """Close with an effort [%]; where the fingers meet is zero."""
        self._switch(CURRENT_MODE)
        self._write(GOAL_CURRENT, 2, -FULL_CURRENT * effort / 100)
        self._wait()
        self.sleep(0.5)  # until nothing swings any more
        self.zero += round(self.sample().position * TRAVEL / 100)
        self._switch(CURRENT_BASED_POSITION_MODE)

    def move(self, position: float, effort: float) -> Sample:
        """Go to a position with an effort, both in percent, until goal or contact."""
        self._write(GOAL_PWM, 2, FULL_PWM)
        self._write(GOAL_CURRENT, 2, FULL_CURRENT * effort / 100)
        self._write(GOAL_POSITION, 4, self.zero + TRAVEL * position / 100)
        return self._wait()

    def hold(self, effort: float) -> None:
        """Go on with an effort [%] that may last."""
        self._write(GOAL_PWM, 2, FULL_PWM * effort / 100)

    def sleep(self, duration: float) -> None:
        """Wait for a duration [s]."""
        start = self._tick()
        while (self._tick() - start) % 32768 < 1000 * duration:
            time.sleep(0.002)

    def sample(self) -> Sample:
        """Read the gripper's state, in one packet."""
        self._refresh()
        counts = self._read(POSITION, 4) - self.zero
        sample = Sample(
            counts * 100 / TRAVEL,
            self._read(CURRENT, 2) * 3.36e-3,
            self._read(TEMPERATURE, 1),
            self._read(ERRORS, 1),
        )
        self.samples.append(sample)
        return sample

    def _wait(self) -> Sample:
        """Sample at 30 Hz until three positions are within 2 %."""
        self.sleep(0.2)  # until it moves
        recent = [math.inf]
        while len(recent) < 3 or max(recent) - min(recent) > 2.0:
            self.sleep(1 / 30)
            recent = [*recent[-2:], self.sample().position]
        return self.samples[-1]

    def _switch(self, mode: int) -> None:
        self._write(TORQUE_ENABLE, 1, 0)  # which unlocks the operating mode
        self._write(OPERATING_MODE, 1, mode)
        self._write(TORQUE_ENABLE, 1, 1)

    def _tick(self) -> int:
        """Return the servo's time [ms], which goes on from 0 after 32767."""
        self._refresh()
        return self._read(TICK, 2)

    def _refresh(self) -> None:
        """Read the block."""
        _exchange(lambda: (self._block.txRxPacket(), 0))

    def _read(self, address: int, size: int) -> int:
        value: int = self._block.getData(1, address, size)
        return value - (value >> 8 * size - 1 << 8 * size)  # two's complement

    def _write(self, address: int, size: int, value: float) -> None:
        data = round(value).to_bytes(size, "little", signed=value < 0)
        arguments = self._port, 1, address, size, list(data)
        _exchange(lambda: self._servo.writeTxRx(*arguments))


def _exchange(send: Callable[[], tuple[int, int]], attempts: int = 10) -> None:
    """Send a packet until it is answered in time, which is 34 ms for the SDK."""
    servo = sdk.PacketHandler(2.0)
    for _ in range(attempts):
        result, error = send()
        if error:
            raise OSError(servo.getRxPacketError(error))
        if result == sdk.COMM_SUCCESS:
            return
        time.sleep(0.1)  # for a late reply, which the next attempt discards
    raise OSError(servo.getTxRxResult(result))


def main() -> None:
    """Calibrate, open half, close until contact and hold."""
    if len(sys.argv) != 2:
        sys.exit("usage: servo_client.py DEVICE")
    try:
        gripper = Gripper(sys.argv[1])
    except OSError as error:
        sys.exit(f"{sys.argv[1]}: {os.strerror(error.errno or 0)}")
    gripper.calibrate()
    print(f"the fingers meet at {gripper.zero} counts")
    for position, effort in ((50, 30), (-10, 20)):
        sample = gripper.move(position, effort)
        print(f"asked for {position} %, stopped at {sample.position:.0f} %")
    gripper.hold(15)
    for _ in range(3):
        gripper.sleep(0.5)
        sample = gripper.sample()
        print(
            f"  {sample.current:.2f} A, {sample.temperature} degrees Celsius, "
            f"errors {sample.errors}"
        )
    gripper.close()


if __name__ == "__main__":
    main()
