"""A client of the gripper's servo that does what drivers for Protocol 2.0 do."""

import math

import dynamixel_sdk as sdk

OPERATING_MODE, TORQUE, GOAL_PWM, GOAL_CURRENT, GOAL_POSITION = 11, 64, 100, 102, 116
CURRENT, CURRENT_BASED_POSITION = 0, 5
FULL_PWM = 885
FULL_CURRENT = 1023  # registers of 100 % effort
FULL_POSITION = 2500  # counts from closed to open
# Of the block that is read: hardware error status to temperature.
FIRST, ERRORS, MEASURED_CURRENT, POSITION, TEMPERATURE = 70, 70, 126, 132, 146
PERIOD = 1 / 30  # s
STEADY = 2  # % of position


class ServoClient2:
    """A dual SRG at a pseudo terminal, in SAKE's percent: 100 open, 0 closed.

    Args:
        device: The terminal.
        sleep: Waits for a duration of the gripper's time [s].

    Attributes:
        zero: Position of the closed gripper, found by `calibrate` [counts].
        samples: (position [%], current [registers], temperature, errors) so far.
    """

    def __init__(self, device, sleep):
        self._sleep = sleep
        self.zero = 0
        self.samples = []
        self.port = sdk.PortHandler(device)
        assert self.port.openPort() and self.port.setBaudRate(57600)
        self.handler = sdk.PacketHandler(2.0)
        assert self.handler.ping(self.port, 1) == (311, sdk.COMM_SUCCESS, 0)
        self._block = sdk.GroupBulkRead(self.port, self.handler)
        self._block.addParam(1, FIRST, TEMPERATURE + 1 - FIRST)

    def close(self):
        self.port.closePort()

    def write(self, address, size, value):
        write = getattr(self.handler, f"write{size}ByteTxRx")
        assert write(self.port, 1, address, value) == (sdk.COMM_SUCCESS, 0)

    def sample(self):
        """Read the gripper's state in one packet, and keep it."""
        assert self._block.txRxPacket() == sdk.COMM_SUCCESS

        def value(address, size):
            data = self._block.getData(1, address, size)
            return data - (1 << 8 * size) * (data >> 8 * size - 1)

        position = (value(POSITION, 4) - self.zero) * 100 / FULL_POSITION
        self.samples.append(
            (
                *(position, value(MEASURED_CURRENT, 2)),
                *(value(TEMPERATURE, 1), value(ERRORS, 1)),
            )
        )
        return self.samples[-1]

    def calibrate(self):
        """Close by current; there is zero. Then go by position and current."""
        self._switch(CURRENT)
        self.write(GOAL_CURRENT, 2, -FULL_CURRENT // 4)
        self.wait_until_steady()
        self._sleep(0.6)  # until the wires ring no more
        self.zero += round(self.sample()[0] * FULL_POSITION / 100)
        self._switch(CURRENT_BASED_POSITION)

    def _switch(self, mode):
        self.write(TORQUE, 1, 0)
        self.write(OPERATING_MODE, 1, mode)
        self.write(TORQUE, 1, 1)

    def move_to(self, percent, effort):
        """Go to a position with a limited current, both in percent."""
        self.write(GOAL_PWM, 2, FULL_PWM)
        self.write(GOAL_CURRENT, 2, FULL_CURRENT * effort // 100)
        self.write(GOAL_POSITION, 4, self.zero + FULL_POSITION * percent // 100)
        self.wait_until_steady()

    def hold(self, effort):
        """Hold on with a limited PWM, in percent."""
        self.write(GOAL_PWM, 2, FULL_PWM * effort // 100)

    def wait_until_steady(self):
        """Sample at 30 Hz until three positions agree, which tells contact or goal."""
        self._sleep(0.2)  # until it moves
        recent = [math.inf]
        while len(recent) < 3 or max(recent) - min(recent) > STEADY:
            self._sleep(PERIOD)
            recent = [*recent[-2:], self.sample()[0]]
