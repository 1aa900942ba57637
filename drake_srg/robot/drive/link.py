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
# A robot that was silent for this long has been given up. [s]
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
        """Have messages of a topic received; several may receive the same topic.

        Args:
            topic: Its name.
            type: Its type, such as "sensor_msgs/msg/JointState".
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
    """One node for each ROS.

    Args:
        suffix: Of the nodes' names, where several processes have nodes.
    """

    def __init__(
        self, ros1: Ros1Config, ros2: Ros2Config, warnings: Warnings, suffix: str = ""
    ) -> None:
        self._nodes = {
            version: Node(dc.replace(config, name=f"{config.name}{suffix}"), warnings)
            for version, config in ((1, ros1), (2, ros2))
        }

    def of(self, version: int) -> Node:
        """Return the node of ROS 1 or of ROS 2."""
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
        lag: How long after a command the hardware is to be there [s].
    """

    outputs: Mapping[str, int] = {}
    lag: float = 0.0

    @abc.abstractmethod
    def take(self) -> PortValues:
        """Return what has been measured since the last call, by output port.

        An empty mapping says that nothing has arrived. Values are finite and have the
        ports' sizes; a link refuses whatever is not, and warns. A message that arrives
        out of order or twice does not count as new. `STAMP` may be among the keys.
        """

    @abc.abstractmethod
    def send(self, commands: PortValues) -> None:
        """Command the hardware; a failure to do so must not raise.

        Args:
            commands: By the station's input port, in its units:
                `arm.position_commanded` (N) [rad or m], already within the limits of
                the safety monitor; `gripper.closure_commanded` (1), 0 open .. 1
                closed; or `gripper.hold` (1), nonzero while the gripper is to stay
                where it is and keep its grip. A link ignores ports that are not its
                own.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Disconnect, leaving the hardware where it is. A second call does nothing."""


# Commands to the parts of an arm.
COMMANDS = ("arm.position_commanded", "gripper.closure_commanded", "gripper.hold")


class NamedLink(Link):
    """A link to a part of an arm, whose ports have the arm's name.

    Args:
        link: Its ports are those of `arm` and `gripper`.
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
        """Return what has come since the last call; none until all needed is new."""
        with self._lock:
            if needed - self._values.keys():
                return {}
            values, self._values = self._values, {}
        return values


@dc.dataclass(frozen=True)
class Robot:
    """The robot as the drivers of an arm and its gripper know it.

    Attributes:
        scenario: The scenario that runs on the hardware, with this arm alone.
        arm_joints: Names of the arm's joints in messages, in the order of its ports.
        nodes: ROS nodes, which drivers share.
        shared: Whatever else drivers share, such as a bus; empty at first.
        own: The arm, by its name if the scenario has several.
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
        """Return the name of a topic; one without a slash in front is the arm's own.

        So is `grasp`: /grasp of the only arm, /left/grasp of the arm `left`.
        """
        return name if name[:1] in ("", "/") else topic_of(self.own, f"/{name}")


class HardwareDriver(abc.ABC):
    """Configuration of a driver, which a YAML tag chooses in a hardware file.

    An arm's link measures `arm.state_measured` (2N), [q; v], and perhaps
    `arm.torque_measured` (N) and `arm.external_torque` (N) [N m]. A gripper's link
    measures `gripper.state_measured` (2n), [q; v]; `gripper.triggered` (m), nonzero
    where a finger sensor fires, from which the station tells `gripper.grasped`;
    `gripper.proximity` (m) [m]; and perhaps `gripper.contact_force` (m) [N] and
    `gripper.pwm`. A gripper without finger sensors tells by other means, such as
    currents, and says 0 or `proximity.range` as the distance.
    """

    @abc.abstractmethod
    def connect(self, robot: Robot) -> Link:
        """Return a link to the hardware.

        The station waits for its first measurements afterwards, so this need not.

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
    # without a slash in front, here and below, is the arm's own: `grasp` is /left/grasp
    # for the arm `left`, and /grasp for the only arm.
    state: str = "/joint_states"
    # Names of the joints in messages, in the order of the model's; empty: the model's.
    joints: list[str] = dc.field(default_factory=list)

    def names(self, robot: Robot) -> Sequence[str]:
        """Return the names of the joints in messages, in the order of the model's.

        Raises:
            ScenarioError: If there are more or fewer than in the model, or equal ones.
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
        names: Of the joints, in the wanted order.

    Attributes:
        stamp: Time of the newest message [s].
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names, self.stamp = tuple(names), -math.inf
        self._jumped = math.inf

    def read(self, message: Any) -> tuple[float, Vector, Vector | None] | None:
        """Return stamp [s], state [q; v] and efforts; None if no joint is among it.

        Efforts are None where a message lacks them, or they are not finite.

        Raises:
            CommandError: If the message is not newer than the last one, jumps ahead
                and no second one confirms that, or lacks some of the joints or their
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
        # One wrong stamp far ahead must not make all that follow look old. A second one
        # means that the robot was silent.
        jumps = math.isfinite(self.stamp) and stamp > self.stamp + _LONGEST_GAP
        if jumps and not 0.0 < stamp - self._jumped <= _LONGEST_GAP:
            self._jumped = stamp
            raise CommandError(
                "stamp", f"jumps ahead from {self.stamp:.3f} s to {stamp:.3f} s"
            )
