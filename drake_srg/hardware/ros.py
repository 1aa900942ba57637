"""Drivers of an arm and a gripper that speak ROS 1 or ROS 2."""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from drake_srg.bridges.commands import PortValues
from drake_srg.common.exceptions import ScenarioError
from drake_srg.hardware.arm_streams import ArmStream, PositionStream, TrajectoryStream
from drake_srg.hardware.goal_stream import GoalStream
from drake_srg.hardware.link import (
    EXTERNAL_TORQUE,
    STAMP,
    HardwareDriver,
    Link,
    Mailbox,
    Robot,
)
from drake_srg.hardware.messages import JointStates, numbers, obeys, percent
from drake_srg.hardware.nodes import Node

_JOINT_STATE = "sensor_msgs/msg/JointState"
_ARRAY = "std_msgs/msg/Float64MultiArray"
# Control periods between two equal gripper commands, in case one gets lost.
_REPEAT = 20


@dc.dataclass(kw_only=True)
class RosArm(HardwareDriver):
    """An arm that publishes joint states and obeys a stream of positions."""

    version: ClassVar[int]

    # Topic of the arm's sensor_msgs/JointState.
    state: str = "/joint_states"
    # Names of its joints in messages, in the order of the model's; empty: the model's.
    joints: list[str] = dc.field(default_factory=list)
    # Topic of the commands, one each control period. `trajectory`: a
    # trajectory_msgs/JointTrajectory with the positions of the last and the next `lead`
    # seconds by the robot's clock, as a joint_trajectory_controller takes them. The arm
    # follows that much later, and wires may be late or lose messages for as long.
    # `positions`: a std_msgs/Float64MultiArray [rad or m], to be taken at once.
    command: str = "/joint_trajectory"
    stream: str = dc.field(
        default="trajectory", metadata={"among": ("trajectory", "positions")}
    )
    lead: float = dc.field(default=0.05, metadata={"gt": 0.0})
    # Topic of the torques that the joints feel from outside, as the arm's controller
    # estimates them: std_msgs/Float64MultiArray [N m], one number per joint, in the
    # order of `joints`, at least every `safety.watchdog`. Limits of them need it.
    # Empty: the arm does not tell them.
    external_torque: str = ""

    def names(self, robot: Robot) -> Sequence[str]:
        """Return the names of the joints in messages, in the order of the model's.

        Raises:
            ScenarioError: If there are more or fewer than in the model, or equal ones.
        """
        return _names("arm", self.joints, robot.arm_joints)

    def connect(self, robot: Robot) -> Link:
        """See `HardwareDriver`."""
        node = robot.nodes.of(self.version)
        return _ArmLink(self, robot, node, self._stream(robot, node))

    def _stream(self, robot: Robot, node: Node) -> ArmStream:
        """Return the way of the commands."""
        joints, arm = self.names(robot), robot.scenario.arm
        assert arm is not None
        if self.stream == "positions":
            return PositionStream(node, self.command, len(joints))
        return TrajectoryStream(node, self.command, joints, self.lead, arm.period)


class Ros1Arm(RosArm):
    """An arm that speaks ROS 1."""

    version = 1


@dc.dataclass(kw_only=True)
class Ros2Arm(RosArm):
    """An arm that speaks ROS 2."""

    version: ClassVar[int] = 2

    # `action`: as trajectories, but as goals of the control_msgs/FollowJointTrajectory
    # named `action`, two for each `lead`. Answers must take less than half a `lead`.
    # The server must use rmw_cyclonedds_cpp.
    stream: str = dc.field(
        default="trajectory", metadata={"among": ("trajectory", "positions", "action")}
    )
    action: str = "/joint_trajectory_controller/follow_joint_trajectory"

    def _stream(self, robot: Robot, node: Node) -> ArmStream:
        if self.stream != "action":
            return super()._stream(robot, node)
        arm = robot.scenario.arm
        assert arm is not None
        return GoalStream(
            node,
            self.action,
            self.names(robot),
            self.lead,
            arm.period,
            robot.warnings,
        )


class _ArmLink(Link):
    def __init__(
        self, config: RosArm, robot: Robot, node: Node, stream: ArmStream
    ) -> None:
        n = len(robot.arm_joints)
        self.outputs = {"arm.state_measured": 2 * n, "arm.torque_measured": n}
        self._mail, self._stream, self.lag = Mailbox(), stream, stream.lag
        self._joints = JointStates(config.names(robot))
        node.subscribe(config.state, _JOINT_STATE, self._receive)
        self._needed = {"arm.state_measured"}
        if config.external_torque:
            self._needed.add(EXTERNAL_TORQUE)
            self.outputs[EXTERNAL_TORQUE] = n
            node.subscribe(config.external_torque, _ARRAY, self._receive_external)

    def take(self) -> PortValues:
        """See `Link`; an arm that stops telling any of what it must tell is silent."""
        return {} if self._stream.fails else self._mail.take(self._needed)

    def close(self) -> None:
        """See `Link`; the node that it shares is closed elsewhere."""
        self._stream.close()

    def send(self, commands: PortValues) -> None:
        """See `Link`."""
        self._stream.send(
            commands["arm.position_commanded"],
            self._joints.stamp,
            stopped=bool(commands["gripper.hold"][0]),
        )

    def _receive(self, message: Any) -> None:
        read = self._joints.read(message)
        if read is None:
            return
        stamp, state, effort = read
        values = {"arm.state_measured": state, STAMP: np.array([stamp])}
        if effort is not None:
            values["arm.torque_measured"] = effort
        self._mail.put(values)

    def _receive_external(self, message: Any) -> None:
        torque = numbers(message.data, self.outputs[EXTERNAL_TORQUE])
        self._mail.put({EXTERNAL_TORQUE: torque})


@dc.dataclass(kw_only=True)
class RosGripper(HardwareDriver):
    """The SRG behind the topics of its thesis."""

    version: ClassVar[int]

    # Topic of the gripper's sensor_msgs/JointState; it may be the arm's.
    state: str = "/joint_states"
    # Names of its joints in messages, in the order of the model's; empty: the model's.
    joints: list[str] = dc.field(default_factory=list)
    # Topics of the finger sensors, std_msgs/Float64MultiArray: distances [m] and normal
    # forces [N]. Empty: the gripper has no such sensors.
    proximity: str = "/gripper/proximity"
    contact_force: str = "/gripper/contact_force"
    # Topic of the commands, std_msgs/Int32: 0 open .. 100 closed.
    command: str = "/grasp"
    # Topic that halts the gripper while the arm is stopped, std_msgs/Bool: false to
    # stay where it is and keep its grip, true to obey. Empty: it only gets no new
    # commands.
    hold: str = "/startgrasp"

    def names(self, robot: Robot) -> Sequence[str]:
        """Return the names of the joints in messages, in the order of the model's.

        Raises:
            ScenarioError: If there are more or fewer than in the model, or equal ones.
        """
        return _names("gripper", self.joints, robot.gripper_joints)

    def connect(self, robot: Robot) -> Link:
        """See `HardwareDriver`."""
        return _GripperLink(self, robot, robot.nodes.of(self.version))


class Ros1Gripper(RosGripper):
    """The SRG behind ROS 1."""

    version = 1


class Ros2Gripper(RosGripper):
    """The SRG behind ROS 2."""

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
        self._topic = percent(config.command)
        self._obeys = obeys(config.hold) if config.hold else None
        self._sent, self._ticks = (math.nan, 0.0), 0
        node.subscribe(config.state, _JOINT_STATE, self._receive_state)
        node.subscribe(config.proximity, _ARRAY, self._receive_proximity)
        if config.contact_force:
            self.outputs["gripper.contact_force"] = m
            node.subscribe(config.contact_force, _ARRAY, self._receive_force)
        node.publish(self._topic)
        if self._obeys is not None:
            node.publish(self._obeys)

    def take(self) -> PortValues:
        """See `Link`."""
        return self._mail.take()

    def close(self) -> None:
        """See `Link`; the node that it shares is closed elsewhere."""

    def send(self, commands: PortValues) -> None:
        """See `Link`."""
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


def _names(part: str, given: Sequence[str], model: Sequence[str]) -> Sequence[str]:
    """Return the given names of a part's joints, or the model's."""
    if given and len(given) != len(model):
        raise ScenarioError(
            f"{part}.joints: needs one name for each of {', '.join(model)}, "
            f"got {len(given)}"
        )
    if len(set(given)) < len(given):
        raise ScenarioError(f"{part}.joints: names must differ, got {', '.join(given)}")
    return given or model
