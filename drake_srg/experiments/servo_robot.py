"""A simulated cell behind its servo bus, and a planner at the other end of the line.

Both advance in turn, so that nothing depends on the speed of the machine.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.systems import MakeSimulator
from drake_srg.robot.drive.cameras import Camera, Picture
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import EmulatedBus, station_mechanisms
from drake_srg.robot.serve.dynamixel.mx64 import Mx64, Mx64P2
from drake_srg.robot.serve.dynamixel.protocol import Packet, PacketReader
from drake_srg.robot.serve.loop import AddServedStation
from drake_srg.scenario import Scenario
from drake_srg.station import MakeStation
from drake_srg.types import Vector

_FIRMWARE: dict[int, type[Mx64] | type[Mx64P2]] = {1: Mx64, 2: Mx64P2}


class ServoRobot:
    """A served station whose clients are the masters of its servos.

    Args:
        scenario: With an arm of bus servos.
        protocol: Dynamixel protocol, 1 or 2.
        warnings: Where the servos report refusals and shutdowns.

    Attributes:
        bus: The servos.
        time: Simulated [s].
    """

    def __init__(self, scenario: Scenario, protocol: int, warnings: Warnings) -> None:
        builder = DiagramBuilder()
        AddServedStation(builder, scenario, lambda _: MakeStation(scenario))
        self._station = builder.Build()
        self._simulator = MakeSimulator(self._station, scenario.simulator_config)
        self._context = self._simulator.get_mutable_context()
        self._fix("gripper.closure_commanded", np.zeros(1))
        self._simulator.Initialize()
        self._inbox = CommandInbox([], warnings)
        self.bus = EmulatedBus(
            self._inbox,
            station_mechanisms(scenario),
            _FIRMWARE[protocol],
            warnings.warn,
        )
        self.time = 0.0
        self._pick = scenario.task.pick
        self._sense()

    def advance(self, until: float) -> None:
        """Obey the servos until a time [s]."""
        for name, value in self._inbox.take().items():
            self._fix(name, value)
        self._simulator.AdvanceTo(until)
        self.time = until
        self._sense()

    def picture(self, camera: str) -> Picture:
        """Return what a camera sees now."""
        color, depth = (
            np.array(self._eval(f"camera_{camera}.{kind}_image").data)
            for kind in ("color", "depth")
        )
        return Picture(self.time, color, depth[..., 0])

    def pose(self) -> RigidTransform:
        """Return the true pose of the picked object, X_WO [m]."""
        X_WO: RigidTransform = self._eval("object_poses_cheat")[self._pick]
        return X_WO

    def arm_position(self) -> Vector:
        """Return the true positions of the arm's joints, shape (N,) [rad]."""
        q, _ = np.split(self._eval("arm.state_cheat"), 2)
        return q

    def _sense(self) -> None:
        values = {name: self._eval(name) for name in self.bus.ports}
        self.bus.sense(self.time, values)

    def _eval(self, name: str) -> Any:
        return self._station.GetOutputPort(name).Eval(self._context)

    def _fix(self, name: str, value: Vector) -> None:
        self._station.GetInputPort(name).FixValue(self._context, value)


class SimulatedCamera(Camera):
    """A camera of a robot, without delay.

    Args:
        robot: The robot.
        name: The camera's.
    """

    def __init__(self, robot: ServoRobot, name: str) -> None:
        self._robot, self._name = robot, name

    def picture(self, after: float, patience: float | None = None) -> Picture:
        """See `Camera`."""
        return self._robot.picture(self._name)

    def newest(self) -> Picture:
        """See `Camera`."""
        return self._robot.picture(self._name)


class DirectLine:
    """A line to a robot's servos without a wire, which loses some of their replies.

    Args:
        robot: The robot.
        loss: Share of the packets that lose a byte, in both directions.
        seed: Of the losses.

    Attributes:
        silent: Whether all replies are lost.
    """

    def __init__(self, robot: ServoRobot, loss: float, seed: int) -> None:
        self.silent = False
        self._bus, self._loss = robot.bus, loss
        self._random = np.random.default_rng(seed)
        kind: type[Packet] = robot.bus.packets
        self._reader, self._time = PacketReader(kind), 0.0
        self._replies = b""

    def write(self, data: bytes) -> None:
        """Send an instruction; the servos reply at once."""
        self._time += 1.0  # what is incomplete is forgotten by the next packet
        packets = list(self._reader.feed(self._worn(data), self._time))
        for reply in self._bus.answer(packets):
            self._replies += self._worn(reply)

    def read(self, timeout: float) -> bytes:
        """Return the replies; nothing else ever arrives."""
        replies, self._replies = self._replies, b""
        return b"" if self.silent else replies

    def drain(self, silence: float = 0.0) -> None:
        """Forget replies."""
        self._replies = b""

    def close(self) -> None:
        """See `Line`."""

    def _worn(self, data: bytes) -> bytes:
        """Return the bytes that arrive."""
        if not data or self._random.random() >= self._loss:
            return data
        lost = int(self._random.integers(len(data)))
        return data[:lost] + data[lost + 1 :]
