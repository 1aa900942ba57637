"""A line to emulated servos in this process, without sockets, threads or clocks."""

import numpy as np

from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import Arm, EmulatedBus, ServoGripper
from drake_srg.robot.serve.dynamixel.mx64 import Mx64, Mx64P2
from drake_srg.robot.serve.dynamixel.protocol import PacketReader

POSITION, CLOSURE = "arm.position_desired", "gripper.closure_commanded"
TRAVEL = 0.69  # of the gripper's servo at closure 1 [rad]
END = 3.0  # of each joint [rad]


class EmulatedLine:
    """A line to servos 1 .. n of an arm and n + 1 of a gripper, which follow at once.

    Attributes:
        bus: The servos.
        q: Positions of the joints [rad].
        closure: Closure of the gripper.
        load: Load of the gripper's servo, as a fraction of full PWM.
        spoil: Changes replies on their way.
        silent: Whether replies are lost.
        writes: Number of packets sent.
    """

    def __init__(self, protocol=1, joints=3):
        self.warned = []
        self.inbox = CommandInbox([], Warnings(self.warned.append))
        ends = np.full(joints, END)
        parts = [Arm(-ends, ends, ends), ServoGripper(TRAVEL, 2)]
        kind = {1: Mx64, 2: Mx64P2}[protocol]
        self.bus = EmulatedBus(self.inbox, parts, kind, self.inbox.warnings.warn)
        self._reader = PacketReader(self.bus.packets)
        self.q, self.closure, self.load = np.zeros(joints), 0.0, 0.0
        self.spoil, self.silent, self.writes, self.closed = None, False, 0, False
        self._time = 0.0
        self._replies = b""
        self.step()

    def step(self, duration=0.01):
        """Obey the commands and tell the servos where their motors are."""
        taken = self.inbox.take()
        wanted = taken.get(POSITION, np.full(len(self.q), np.nan))
        self.q = np.where(np.isfinite(wanted), wanted, self.q)
        self.closure = taken.get(CLOSURE, [self.closure])[0]
        self.sense(duration)

    def sense(self, duration=0.01):
        """Tell the servos where their motors are."""
        self._time += duration
        angles = np.full(2, self.closure * TRAVEL)
        self.bus.sense(
            self._time,
            {
                "arm.state_measured": np.append(self.q, 0.0 * self.q),
                "arm.torque_measured": 0.0 * self.q,
                "gripper.state_measured": np.append(angles, np.zeros(2)),
                "gripper.pwm": np.full(2, self.load),
            },
        )

    def ask(self, number, code, parameters=b""):
        """Return the replies to a packet."""
        packet = self.bus.packets(number, code, bytes(parameters))
        (reply,) = self.bus.answer([packet])
        return list(PacketReader(self.bus.packets).feed(reply, 0.0))

    def write(self, data):
        if self.closed:
            raise ConnectionResetError("closed")
        self.writes += 1
        packets = list(self._reader.feed(data, 0.0))
        reply = b"".join(self.bus.answer(packets))
        if self.spoil is not None:
            reply = self.spoil(reply)
        self._replies += b"" if self.silent else reply

    def read(self, timeout):
        if self.closed:
            raise ConnectionResetError("closed")
        # In pieces, as a line may deliver them.
        piece, self._replies = self._replies[:7], self._replies[7:]
        return piece

    def drain(self, silence=0.0):
        self._replies = b""

    def close(self):
        self.closed = True
