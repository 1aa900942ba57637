"""Drivers of the SRG over ROS 1 or ROS 2, with the topics of its thesis."""

import dataclasses as dc
import math
from typing import Any, ClassVar

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.rosbag import MakeMessage, Topic
from drake_srg.robot.drive.link import (
    ARRAY,
    JOINT_STATE,
    JointStates,
    Link,
    Mailbox,
    Node,
    Robot,
    RosDriver,
)
from drake_srg.robot.serve.commands import PortValues, numbers

# An unchanged command is repeated after so many control periods, in case it was lost.
_REPEAT = 20


@dc.dataclass(kw_only=True)
class RosGripper(RosDriver):
    """An SRG that speaks ROS, with the topics of its thesis."""

    part: ClassVar[str] = "gripper"
    own_topics = ("proximity", "contact_force", "command", "hold")

    # Topics of the finger sensors, std_msgs/Float64MultiArray: distances [m] and normal
    # forces [N]. Empty: the gripper has no such sensors.
    proximity: str = "gripper/proximity"
    contact_force: str = "gripper/contact_force"
    # Topic of the commands, std_msgs/Int32: 0 open .. 100 closed.
    command: str = "grasp"
    # Topic that halts the gripper while the arm is stopped, std_msgs/Bool: false: stay
    # and keep the grip, true: obey. Empty: the gripper has no such topic; it finishes
    # its last command and gets no new ones.
    hold: str = "startgrasp"

    def connect(self, robot: Robot) -> Link:
        """Return a link to the hardware."""
        return _GripperLink(self, robot, robot.nodes.of(self.version))


class Ros1Gripper(RosGripper):
    """An SRG that speaks ROS 1."""

    version = 1


class Ros2Gripper(RosGripper):
    """An SRG that speaks ROS 2."""

    version = 2


class _GripperLink(Link):
    def __init__(self, config: RosGripper, robot: Robot, node: Node) -> None:
        gripper = robot.scenario.gripper
        if gripper is None:
            raise ScenarioError("gripper: the scenario has none")
        if gripper.trigger not in ("proximity", "touch"):
            raise ScenarioError(
                f"gripper.trigger: must be proximity or touch, got {gripper.trigger}"
            )
        n, m = len(gripper.joint_names), len(gripper.sensor_names)
        self.outputs = {
            "gripper.state_measured": 2 * n,
            "gripper.triggered": m,
            "gripper.proximity": m,
        }
        self._node, self._mail, self._m = node, Mailbox(), m
        self._gripper = gripper
        self._joints = JointStates(config.names(robot))
        self._topic = percent(robot.topic(config.command))
        self._obeys = obeys(robot.topic(config.hold)) if config.hold else None
        self._sent, self._ticks = (math.nan, 0.0), 0
        node.subscribe(robot.topic(config.state), JOINT_STATE, self._receive_state)
        proximity = robot.topic(config.proximity)
        node.subscribe(proximity, ARRAY, self._receive_proximity)
        if config.contact_force:
            self.outputs["gripper.contact_force"] = m
            force = robot.topic(config.contact_force)
            node.subscribe(force, ARRAY, self._receive_force)
        node.publish(self._topic)
        if self._obeys is not None:
            node.publish(self._obeys)

    def take(self) -> PortValues:
        return self._mail.take()

    def close(self) -> None:
        pass  # `Nodes` closes the shared node

    def send(self, commands: PortValues) -> None:
        closure = float(commands["gripper.closure_commanded"][0])
        hold = float(commands["gripper.hold"][0])
        self._ticks += 1
        if (closure, hold) == self._sent and self._ticks < _REPEAT:
            return
        if self._obeys is not None:
            self._node.send(self._obeys, 0.0, hold)
        self._node.send(self._topic, 0.0, closure)
        self._sent, self._ticks = (closure, hold), 0

    def _receive_state(self, message: Any) -> None:
        read = self._joints.read(message)
        if read is not None:
            self._mail.put({"gripper.state_measured": read[1]})

    def _receive_proximity(self, message: Any) -> None:
        distance = numbers(message.data, self._m)
        values = {"gripper.proximity": distance}
        if self._gripper.trigger == "proximity":
            near = distance < self._gripper.proximity.trigger_distance
            values["gripper.triggered"] = near.astype(float)
        self._mail.put(values)

    def _receive_force(self, message: Any) -> None:
        force = numbers(message.data, self._m)
        values = {"gripper.contact_force": force}
        if self._gripper.trigger == "touch":
            touched = force >= self._gripper.touch.trigger_force
            values["gripper.triggered"] = touched.astype(float)
        self._mail.put(values)


def percent(name: str) -> Topic:
    """Return a topic of closures 0 .. 1 as std_msgs/Int32, 0 open .. 100 closed."""
    kind = "std_msgs/msg/Int32"

    def convert(make: MakeMessage, time: float, closure: float) -> Any:
        return make(kind, data=round(100.0 * min(max(closure, 0.0), 1.0)))

    return Topic(name, kind, {}, convert)


def obeys(name: str) -> Topic:
    """Return a topic that halts a gripper as std_msgs/Bool: false to hold."""
    kind = "std_msgs/msg/Bool"

    def convert(make: MakeMessage, time: float, hold: float) -> Any:
        return make(kind, data=hold < 0.5)

    return Topic(name, kind, {}, convert)
