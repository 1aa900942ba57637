"""A servo bridge with a fake motor, and tools to talk to it."""

import contextlib
import socket
import threading

import numpy as np
from helpers import needs_pty

from drake_srg.robot.drive.dynamixel.bus import ServoBus, open_line
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import ServoBridge
from drake_srg.robot.serve.dynamixel.protocol import Instruction, Packet1, Packet2
from robot.serve.waiting import wait_until

COUNT = 2 * np.pi / 4096
CLOSED = 2.8  # angle at which the fake gripper's fingers meet [rad]
PING = Packet1(1, Instruction.PING).encode()
PONG = Packet1(1, 0).encode()
PING_2 = Packet2(1, Instruction.PING).encode()
PONG_2 = Packet2(1, Instruction.STATUS, b"\x00\x37\x01\x2d").encode()


STEP = 0.005  # of a fake motor [s]


class FakeMotor:
    """A motor without inertia whose fingers meet, or an object that they hold.

    Attributes:
        commands: Commands that it obeys, by input port.
        angle: Angle of the spool [rad].
        pwm: As a fraction of full scale.
        time: Simulated [s].
        meets: Angle at which the fingers stop [rad].
        temperature: [degrees Celsius].
    """

    def __init__(self, inbox, ports):
        self.inbox, self._ports = inbox, ports
        self.commands = {}
        self.angle = self.time = self.pwm = 0.0
        self.meets, self.temperature = CLOSED, 30.0

    def step(self):
        """Return the time and the values of the station's ports after a step."""
        self.commands.update(self.inbox.take())
        values = {k.split(".")[1]: v[0] for k, v in self.commands.items()}
        limit = values.get("force_limit", 1.0)
        pull = 5.0 * (values.get("motor_position_commanded", np.nan) - self.angle)
        torque = values.get("motor_torque_commanded", np.nan)
        wanted = torque if np.isfinite(torque) else np.nan_to_num(pull)
        self.pwm = float(np.clip(wanted, -limit, limit))
        moved = min(self.angle + STEP * 10.0 * self.pwm, self.meets)
        speed, self.angle = (moved - self.angle) / STEP, moved
        self.time += STEP
        values = [self.angle, speed], [self.pwm], [self.temperature]
        return self.time, dict(zip(self._ports, map(np.array, values), strict=True))


class FakeStation(FakeMotor, threading.Thread):
    """A bridge to a fake motor, ten times as fast as real time."""

    def __init__(self, where, protocol=1):
        threading.Thread.__init__(self, daemon=True)
        if where == "pty":
            needs_pty()
        self.warnings = []
        inbox = CommandInbox([], Warnings(self.warnings.append))
        self.bridge = ServoBridge(inbox, where, protocol=protocol)
        FakeMotor.__init__(self, inbox, self.bridge.ports)
        self._done = threading.Event()

    def run(self):
        while not self._done.wait(0.0005):
            self.bridge.update(*self.step())

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


def connect(bridge):
    host, _, port = bridge.address.rpartition(":")
    return socket.create_connection((host.strip("[]"), int(port)), timeout=20.0)


def answers(connection, ping=PING, pong=PONG):
    """Return whether a ping is eventually answered, whatever came before."""
    received = b""
    connection.settimeout(0.2)  # longer than the reader waits for the rest of a packet
    for _ in range(25):
        connection.sendall(ping)
        with contextlib.suppress(TimeoutError):
            while not received.endswith(pong):
                received += connection.recv(1000)
            return True
    return False


def master_of(bridge, timeout=5.0):
    """Return a master of the bridge's servos, with Protocol 1.0."""
    terminal = bridge.address.startswith("/")
    port = bridge.address if terminal else f"tcp:{bridge.address}"
    return ServoBus(open_line(port, 57600), timeout=timeout, retries=0)
