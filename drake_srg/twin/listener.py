"""Listens to a robot, and never says anything to it."""

from __future__ import annotations

import dataclasses as dc
import math
import threading
import time as wall
from typing import Any

import numpy as np

from drake_srg.bridges.commands import CommandError
from drake_srg.common.exceptions import ScenarioError
from drake_srg.hardware.config import HardwareConfig
from drake_srg.hardware.link import JointStates, Robot, RosDriver
from drake_srg.scenario.twin import TwinConfig
from drake_srg.twin.sightings import Sighting, read_blobs
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class Told:
    """What a robot has told last. Times are by its clock.

    Attributes:
        stamp: Time of the arm's state [s].
        arm_state: [q; v] of the arm, shape (2N,) [rad, rad/s].
        arm_torque: Of its joints, shape (N,) [N m]; NaN: not told.
        gripper_state: [q; v] of the fingers, shape (2n,); NaN: not told.
        closure: Command to the gripper, 0 open .. 1 closed; None: not told.
        sightings: Of objects, since the last call of `Listener.take`.
    """

    stamp: float
    arm_state: Vector
    arm_torque: Vector
    gripper_state: Vector
    closure: float | None = None
    sightings: tuple[Sighting, ...] = ()


class Listener:
    """Subscribes to a robot's topics. Any thread may deliver messages.

    Args:
        config: The hardware's, with drivers that speak ROS.
        twin: The other topics.
        robot: The robot; its nodes are opened by the caller.

    Attributes:
        heard_at: When the arm's state arrived last [s, real].

    Raises:
        ScenarioError: If a driver has no topics.
    """

    def __init__(self, config: HardwareConfig, twin: TwinConfig, robot: Robot) -> None:
        arm, gripper = config.arm, config.gripper
        for key, driver in (("arm", arm), ("gripper", gripper)):
            if not isinstance(driver, RosDriver):
                raise ScenarioError(
                    f"{key}: a twin cannot listen to !{type(driver).__name__}, because "
                    "a bus has one master (allowed: the drivers of ROS 1 and ROS 2)"
                )
        assert isinstance(arm, RosDriver)
        assert isinstance(gripper, RosDriver)
        self._lock = threading.Lock()
        self._arm = JointStates(arm.names(robot))
        self._fingers = JointStates(gripper.names(robot))
        self._told: Told | None = None
        self._gripper_state = np.full(2 * len(robot.gripper_joints), np.nan)
        self._closure: float | None = None
        self._sightings: list[Sighting] = []
        self.heard_at = -math.inf
        node, hand = robot.nodes.of(arm.version), robot.nodes.of(gripper.version)
        states = "sensor_msgs/msg/JointState"
        node.subscribe(arm.state, states, self._receive_arm)
        hand.subscribe(gripper.state, states, self._receive_gripper)
        for topic, kind, receive in (
            (twin.closure, "std_msgs/msg/Float64", self._receive_closure),
            (twin.grasp, "std_msgs/msg/Int32", self._receive_grasp),
            (twin.blobs, "std_msgs/msg/String", self._receive_blobs),
        ):
            if topic:
                hand.subscribe(topic, kind, receive)

    def take(self) -> Told | None:
        """Return what has been told, if the arm's state is new since the last call."""
        with self._lock:
            told, self._told = self._told, None
            if told is None:
                return None
            seen, self._sightings = tuple(self._sightings), []
            state, closure = self._gripper_state, self._closure
        return dc.replace(told, gripper_state=state, closure=closure, sightings=seen)

    def _receive_arm(self, message: Any) -> None:
        with self._lock:
            read = self._arm.read(message)
            if read is None:
                return
            stamp, state, effort = read
            torque = np.full(len(state) // 2, np.nan) if effort is None else effort
            self._told = Told(stamp, state, torque, self._gripper_state)
            self.heard_at = wall.monotonic()

    def _receive_gripper(self, message: Any) -> None:
        with self._lock:
            read = self._fingers.read(message)
            if read is not None:
                self._gripper_state = read[1]

    def _receive_closure(self, message: Any) -> None:
        self._command(float(message.data))

    def _receive_grasp(self, message: Any) -> None:
        self._command(0.01 * float(message.data))

    def _command(self, closure: float) -> None:
        if not 0.0 <= closure <= 1.0:
            raise CommandError("range", f"must be open to closed, got {closure:g}")
        with self._lock:
            self._closure = closure

    def _receive_blobs(self, message: Any) -> None:
        seen = read_blobs(message.data)
        with self._lock:
            self._sightings += seen
