"""A servo bridge with a fake motor, and tools to talk to it."""

import contextlib
import socket
import threading

import numpy as np
from helpers import needs_pty

from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import ServoBridge
from drake_srg.robot.serve.dynamixel.protocol import Instruction, Packet1, Packet2
from robot.serve.dynamixel.servo_client import ServoClient
from robot.serve.waiting import wait_until

COUNT = 2 * np.pi / 4096
CLOSED = 2.8  # angle at which the fake gripper's fingers meet [rad]
PING = Packet1(1, Instruction.PING).encode()
PONG = Packet1(1, 0).encode()
PING_2 = Packet2(1, Instruction.PING).encode()
PONG_2 = Packet2(1, Instruction.STATUS, b"\x00\x37\x01\x2d").encode()


class FakeStation(threading.Thread):
    """A bridge to a motor without inertia, ten times as fast as real time."""

    def __init__(self, where, protocol=1):
        super().__init__(daemon=True)
        if where == "pty":
            needs_pty()
        self.warnings = []
        self.inbox = CommandInbox([], Warnings(self.warnings.append))
        self.bridge = ServoBridge(self.inbox, where, protocol=protocol)
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


def client_of(station, url=None):
    url = url or f"socket://{station.bridge.address}"
    return ServoClient(url, station.sleep, lambda: station.time)
