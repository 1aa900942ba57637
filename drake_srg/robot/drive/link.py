"""The interface between a hardware station and drivers: links and shared ROS nodes."""

import abc
import dataclasses as dc
import math
import threading
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any, ClassVar, TypeVar

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.config import Config
from drake_srg.recording.rosbag import Topic
from drake_srg.robot.serve.bridge import Bridge
from drake_srg.robot.serve.commands import (
    COMMAND_LIMIT,
    ONE_ARM,
    CommandError,
    CommandInbox,
    CommandTopic,
    PortValues,
    Warnings,
    numbers,
    port_of,
    seconds,
    topic_of,
)
from drake_srg.robot.serve.connecting import Ros1Config, Ros2Config
from drake_srg.scenario import RobotArm, Scenario
from drake_srg.types import Vector

# The time by the robot's clock of the newest measurement, shape (1,) [s].
STAMP = "hardware.stamp"
# External joint torques, shape (N,) [N m]; only some arms publish them.
EXTERNAL_TORQUE = "arm.external_torque"
JOINT_STATE = "sensor_msgs/msg/JointState"
ARRAY = "std_msgs/msg/Float64MultiArray"
# A stamp that is this far ahead [s] must be confirmed by the next one. The safety
# monitor has long stopped a robot that was silent for this time.
_LONGEST_GAP = 5.0

_T = TypeVar("_T")
# Takes a message; raises a CommandError if it is refused.
Receive = Callable[[Any], None]


class Node:
    """A ROS node: first collects topics, then opens."""

    def __init__(self, config: Ros1Config | Ros2Config, warnings: Warnings) -> None:
        self._config, self._warnings = config, warnings
        self._receivers: dict[str, list[Receive]] = {}
        self._subscribed: dict[str, CommandTopic] = {}
        self._published: list[Topic] = []
        self._bridge: Bridge | None = None

    def subscribe(
        self, topic: str, type: str, receive: Receive, largest: int = COMMAND_LIMIT
    ) -> None:
        """Have messages of a topic received. Several receivers may share a topic.

        Args:
            topic: Name of the topic.
            type: Type of its messages, such as "sensor_msgs/msg/JointState".
            receive: Called with each message, in a thread of the node.
            largest: Size of the largest message [bytes].
        """
        receivers = self._receivers.setdefault(topic, [])
        receivers.append(receive)

        def convert(message: Any) -> PortValues:
            for each in receivers:
                each(message)
            return {}

        self._subscribed[topic] = CommandTopic(
            topic, type, convert, whole=True, largest=largest
        )

    def publish(self, topic: Topic) -> None:
        """Announce a topic that `send` publishes."""
        self._published.append(topic)

    def open(self) -> None:
        """Join the network, if there are any topics.

        Raises:
            ScenarioError: If an address is in use or invalid.
            ImportError: If a package is missing.
        """
        if self._subscribed or self._published:
            inbox = CommandInbox(self._subscribed.values(), self._warnings)
            try:
                self._bridge = self._config.open(inbox, self._published)
            except (OSError, ValueError) as error:
                raise ScenarioError(f"hardware: {error}") from error

    def send(self, topic: Topic, time: float, *values: Any) -> None:
        """Publish a message, stamped with a time [s], if the node is open."""
        if self._bridge is not None:
            self._bridge.publish(topic, time, values)

    def has_subscribers(self, topic: str) -> bool:
        """Return whether anybody subscribes to a topic that this node publishes."""
        return self._bridge is not None and self._bridge.has_subscribers(topic)

    def close(self) -> None:
        """Leave the network. A second call does nothing."""
        if self._bridge is not None:
            self._bridge.close()
            self._bridge = None


class Nodes:
    """A ROS 1 node and a ROS 2 node, which drivers share.

    Args:
        suffix: Added to the nodes' names, which must differ between processes.
    """

    def __init__(
        self, ros1: Ros1Config, ros2: Ros2Config, warnings: Warnings, suffix: str = ""
    ) -> None:
        self._nodes = {
            version: Node(dc.replace(config, name=f"{config.name}{suffix}"), warnings)
            for version, config in ((1, ros1), (2, ros2))
        }

    def of(self, version: int) -> Node:
        """Return the node that speaks ROS 1 or ROS 2."""
        return self._nodes[version]

    def open(self) -> None:
        """Open the nodes that have topics; see `Node.open`."""
        for node in self._nodes.values():
            node.open()

    def close(self) -> None:
        """Close all nodes."""
        for node in self._nodes.values():
            node.close()


class Link(abc.ABC):
    """A live connection to a part of a robot.

    Threads of the link talk to the hardware. `take` and `send` are called by the thread
    that runs the control loop, every control period, and return at once.

    Attributes:
        outputs: Sizes of the station's output ports that the link measures, by name.
        lag: Time within which the hardware must reach a commanded position [s].
    """

    outputs: Mapping[str, int] = {}
    lag: float = 0.0

    @abc.abstractmethod
    def take(self) -> PortValues:
        """Return what has been measured since the last call, by output port.

        An empty mapping means that nothing has arrived. Values are finite and have the
        ports' sizes; a link refuses all others, and warns. A message that arrives out
        of order or twice does not count as new. `STAMP` may be among the keys.
        """

    @abc.abstractmethod
    def send(self, commands: PortValues) -> None:
        """Command the hardware; a failure to do so must not raise.

        Args:
            commands: By the station's input port, in its units:
                `arm.position_commanded` (N) [rad or m], already within the limits of
                the safety monitor; `gripper.closure_commanded` (1), 0 open .. 1
                closed; and `gripper.hold` (1), nonzero while the gripper must stay
                where it is and keep its grip. A link ignores the ports of other parts.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Disconnect, leaving the hardware where it is. A second call does nothing."""


# Commands to an arm and its gripper.
COMMANDS = ("arm.position_commanded", "gripper.closure_commanded", "gripper.hold")


class NamedLink(Link):
    """A link to an arm or its gripper whose port names begin with the arm's name.

    Args:
        link: The same link without the arm's name in its ports.
    """

    def __init__(self, link: Link, own: RobotArm) -> None:
        self._link, self._own, self.lag = link, own, link.lag
        self.outputs = self._named(link.outputs)

    def take(self) -> PortValues:
        """Return what has been measured since the last call, by output port."""
        return self._named(self._link.take())

    def send(self, commands: PortValues) -> None:
        """Command the hardware; a failure to do so must not raise."""
        own = {name: commands[port_of(self._own, name)] for name in COMMANDS}
        self._link.send(own)

    def close(self) -> None:
        """Disconnect, leaving the hardware where it is. A second call does nothing."""
        self._link.close()

    def _named(self, values: Mapping[str, _T]) -> Mapping[str, _T]:
        return {port_of(self._own, name): value for name, value in values.items()}


class Mailbox:
    """Keeps the newest values that threads put in until the control loop takes them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._values: dict[str, Vector] = {}

    def put(self, values: PortValues) -> None:
        """Add values; a newer one replaces an older one of the same name."""
        with self._lock:
            self._values.update(values)

    def take(self, needed: Set[str] = frozenset()) -> dict[str, Vector]:
        """Return what has come since the last call; {} until all of `needed` has."""
        with self._lock:
            if needed - self._values.keys():
                return {}
            values, self._values = self._values, {}
        return values


@dc.dataclass(frozen=True)
class Robot:
    """The view of a robot that the drivers of one arm and its gripper get.

    Attributes:
        scenario: The scenario that runs on the hardware, with this arm alone.
        arm_joints: Names of the arm's joints in messages, in the order of its ports.
        nodes: ROS nodes, which drivers share.
        shared: Anything else that drivers share, such as a bus; empty at first.
        own: The arm; its name is empty if the scenario has only one.
    """

    scenario: Scenario
    arm_joints: tuple[str, ...]
    warnings: Warnings
    nodes: Nodes
    shared: dict[Any, Any] = dc.field(default_factory=dict)
    own: RobotArm = ONE_ARM

    @property
    def gripper_joints(self) -> tuple[str, ...]:
        """Names of the gripper's measured joints, in the order of its ports."""
        gripper = self.scenario.gripper
        names = () if gripper is None else gripper.joint_names
        return tuple(self.own.system(name) for name in names)

    def topic(self, name: str) -> str:
        """Return a topic's full name. A name without a leading slash is the arm's own.

        For example, `grasp` is /left/grasp for the arm `left`, and /grasp for a single
        arm.
        """
        return name if name[:1] in ("", "/") else topic_of(self.own, f"/{name}")


class HardwareDriver(abc.ABC):
    """Configuration of a driver, which a YAML tag chooses in a hardware file.

    An arm's link measures `arm.state_measured` (2N), [q; v], and perhaps
    `arm.torque_measured` (N) and `arm.external_torque` (N) [N m]. A gripper's link
    measures `gripper.state_measured` (2n), [q; v]; `gripper.triggered` (m), nonzero
    where a finger sensor fires, from which the station computes `gripper.grasped`;
    `gripper.proximity` (m) [m]; and perhaps `gripper.contact_force` (m) [N] and
    `gripper.pwm`. A gripper without finger sensors detects contact by other means, such
    as currents, and reports a distance of 0 or `proximity.range`.
    """

    @abc.abstractmethod
    def connect(self, robot: Robot) -> Link:
        """Return a link to the hardware.

        It need not wait for measurements: the station does so afterwards.

        Raises:
            ScenarioError: If the configuration does not fit the robot.
            OSError: If the hardware cannot be reached.
            ImportError: If a package is missing.
        """


@dc.dataclass(kw_only=True)
class RosDriver(Config, HardwareDriver):
    """Configuration of an arm or a gripper that publishes its joints' states."""

    version: ClassVar[int]  # of ROS
    part: ClassVar[str]
    # Keys of the topics that no other driver may have.
    own_topics: ClassVar[tuple[str, ...]] = ()

    # Topic of the sensor_msgs/JointState; all arms and grippers may share it. A name
    # without a leading slash, here and below, is the arm's own: `grasp` is /left/grasp
    # for the arm `left`, and /grasp for a single arm.
    state: str = "/joint_states"
    # Names of the joints in messages, in the order of the model's joints; empty: as in
    # the model.
    joints: list[str] = dc.field(default_factory=list)

    def names(self, robot: Robot) -> Sequence[str]:
        """Return the joints' names in messages, in the order of the model's joints.

        Raises:
            ScenarioError: If their number is not the model's, or two are equal.
        """
        model = robot.arm_joints if self.part == "arm" else robot.gripper_joints
        given = self.joints
        if given and len(given) != len(model):
            raise ScenarioError(
                f"{self.part}.joints: needs one name for each of {', '.join(model)}, "
                f"got {len(given)}"
            )
        if len(set(given)) < len(given):
            raise ScenarioError(
                f"{self.part}.joints: names must differ, got {', '.join(given)}"
            )
        return given or model


class JointStates:
    """Reads the states of some joints from sensor_msgs/JointState messages.

    Args:
        names: Names of the joints, in the wanted order.

    Attributes:
        stamp: Time of the newest message [s]; -inf: none has arrived.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names, self.stamp = tuple(names), -math.inf
        self._jumped = math.inf

    def read(self, message: Any) -> tuple[float, Vector, Vector | None] | None:
        """Return stamp [s], state [q; v] and efforts; None if the message has no joint.

        Efforts are None if the message lacks them or they are not finite.

        Raises:
            CommandError: If the message is not newer than the last one, if its stamp
                jumps ahead and does not confirm an earlier jump, or if some joints lack
                finite positions and velocities.
        """
        given = list(message.name)
        if not set(self._names) & set(given):
            return None
        missing = sorted(set(self._names) - set(given))
        if missing:
            raise CommandError("joints", f"lacks the joints {', '.join(missing)}")
        count, stamp = len(given), seconds(message.header.stamp)
        q, v = numbers(message.position, count), numbers(message.velocity, count)
        self._check(stamp)
        self.stamp = stamp
        order = [given.index(name) for name in self._names]
        effort = np.array(message.effort, dtype=np.float64)
        told = effort.shape == (count,) and bool(np.isfinite(effort[order]).all())
        return (
            stamp,
            np.concatenate([q[order], v[order]]),
            effort[order] if told else None,
        )

    def _check(self, stamp: float) -> None:
        if stamp <= self.stamp:
            raise CommandError(
                "stamp",
                f"needs a newer time than {self.stamp:.3f} s, got {stamp:.3f} s",
            )
        # One wrong stamp far ahead must not make all later messages look old. A second
        # one means that the robot was silent for a while.
        jumps = math.isfinite(self.stamp) and stamp > self.stamp + _LONGEST_GAP
        if jumps and not 0.0 < stamp - self._jumped <= _LONGEST_GAP:
            self._jumped = stamp
            raise CommandError(
                "stamp", f"jumps ahead from {self.stamp:.3f} s to {stamp:.3f} s"
            )
