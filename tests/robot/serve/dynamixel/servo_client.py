"""A client of the gripper's servo that sends the packets of SAKE's public driver."""

import time

import serial

TORQUE_FULL = 800  # registers of 100 % effort
POSITION_FULL = 2500  # counts from closed to open
HOLDING = 13  # % of effort


class ServoError(Exception):
    pass


class ServoClient:
    """A dual SRG at a serial line, in SAKE's percent: 100 open, 0 closed.

    Args:
        url: URL or device for pyserial.
        sleep: Waits for a duration of the gripper's time [s].
        elapsed: Returns the gripper's time [s].

    Attributes:
        line: The serial line.
        sent: Instructions sent so far, without header and checksum.
        zero: Position of the closed gripper, found by `calibrate` [counts].
    """

    retries = 3

    def __init__(self, url, sleep=time.sleep, elapsed=time.monotonic):
        self._sleep, self._elapsed = sleep, elapsed
        self.zero = 0
        self.sent = []
        # SAKE's driver has this timeout, and opens, closes and reopens the line.
        self.line = serial.serial_for_url(url, baudrate=57600, timeout=0.2)
        self.line.close()
        self.line.open()
        self.read(3, 1)
        self.read(5, 1)
        if self.read(22, 1) != b"\x01":
            self.write(22, 1, size=1)

    def close(self):
        self.line.close()

    # Packets.

    def send(self, instruction, *parameters):
        """Return the reply's parameters and error; retry like SAKE's driver."""
        body = bytes([1, len(parameters) + 2, instruction, *parameters])
        self.sent.append(body[2:])
        for _ in range(1 + self.retries):
            self.line.reset_input_buffer()
            self.line.write(b"\xff\xff" + body + bytes([~sum(body) & 0xFF]))
            head = self.line.read(5)
            if len(head) < 5 or head[:3] != b"\xff\xff\x01":
                continue
            rest = self.line.read(head[3] - 1)
            intact = ~sum(head[2:] + rest[:-1]) & 0xFF == rest[-1]
            if intact and not head[4] & 16:
                return rest[:-1], head[4]
        raise ServoError("no answer")

    def read(self, address, size):
        data, error = self.send(2, address, size)
        if error:
            raise ServoError(error)
        return data

    def write(self, address, value, size=2):
        _, error = self.send(3, address, *value.to_bytes(size, "little"))
        if error:
            raise ServoError(error)

    # Sequences.

    def calibrate(self):
        self.write(6, 0x0FFF0FFF, size=4)
        self.write(34, 500)
        self.write(24, 0, size=1)
        self.write(70, 1, size=1)
        self.write(71, 1024 + 100)
        self._sleep(4.0)
        self.write(71, 1024 + 10)
        self.write(20, 0)
        self.zero = self.signed(36)

    def goto_position(self, percent, effort):
        self._set_effort(effort)
        if percent == 0:
            self.write(70, 1, size=1)
        else:
            self.write(70, 0, size=1)
            self.write(30, (self.zero + POSITION_FULL * percent // 100) & 0xFFFF)
        self._wait_for_stop()
        self._set_effort(min(HOLDING, effort))

    def _set_effort(self, effort):
        self.write(34, TORQUE_FULL * effort // 100)
        self.write(71, 1024 + TORQUE_FULL * effort // 100)

    def _wait_for_stop(self):
        end, last = self._elapsed() + 5.0, None
        while (now := self.read(36, 2)) != last and self._elapsed() < end:
            last = now
            self._sleep(0.1)

    def get_position(self):
        percent = round((self.signed(36) - self.zero) * 100 / POSITION_FULL)
        return min(max(percent, 0), 100)

    def get_temperature(self):
        return self.read(43, 1)[0]

    def release(self):
        self.write(70, 0, size=1)

    def check_overload_and_recover(self):
        """Return the errors before and after."""
        _, before = self.send(2, 34, 2)
        if before & 32:
            self.send(3, 71, 0, 0)
            self.send(3, 70, 0)
            self.send(3, 34, 500 % 256, 500 // 256)
        return before, self.send(2, 34, 2)[1]

    def signed(self, address):
        return int.from_bytes(self.read(address, 2), "little", signed=True)
