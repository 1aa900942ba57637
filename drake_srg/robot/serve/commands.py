"""Commands from clients: checked by topic, and kept until the station takes them."""

from __future__ import annotations

import dataclasses as dc
import itertools
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, OutputPort

from drake_srg.arm.reference import CAPACITY, trajectory_piece
from drake_srg.common.safety_states import SafetyState, safety_state
from drake_srg.common.systems import moving_joints
from drake_srg.scenario.schema import RobotArm
from drake_srg.types import Vector

# Values of a station's ports, by name.
PortValues = Mapping[str, Vector]
# The arm of a scenario that has only one.
ONE_ARM = RobotArm()
COMMAND_LIMIT = 2**20  # Largest command [bytes]; most are a thousand times smaller.


class CommandError(ValueError):
    """Raised if a command is refused.

    Attributes:
        kind: Kind of fault, such as "length". Each kind is reported once per topic.
    """

    def __init__(self, kind: str, message: str):
        super().__init__(message)
        self.kind = kind


@dc.dataclass(frozen=True)
class CommandTopic:
    """A topic that commands a station.

    Attributes:
        name: Name of the ROS topic.
        type: Message type in ROS 2's notation, such as "std_msgs/msg/Int32".
        convert: Returns values of input ports for the message's field `data`; raises a
            CommandError if the command is invalid.
        latched: Whether a value is kept until the station has seen it, even if a lower
            one follows at once: a button may be pressed for less than a period.
        whole: Whether `convert` takes the whole message instead of its `data`.
        largest: Size of the largest message [bytes].
    """

    name: str
    type: str
    convert: Callable[[Any], PortValues]
    latched: bool = False
    whole: bool = False
    largest: int = COMMAND_LIMIT


class Warnings:
    """Reports each kind of trouble to the user once. It is thread-safe."""

    def __init__(self, tell: Callable[[str], None]):
        self._tell = tell
        self._told: set[str] = set()
        self._lock = threading.Lock()

    def warn(self, kind: str, message: str) -> None:
        """Report `message`, unless this kind has been reported before."""
        with self._lock:
            if kind in self._told:
                return
            self._told.add(kind)
        self._tell(message)

    def forget(self, kind: str) -> None:
        """Report this kind again the next time: the trouble is over."""
        with self._lock:
            self._told.discard(kind)


class CommandInbox:
    """Collects commands from any thread until the station takes them.

    The last valid message of each topic counts. If several sources command the same
    port, the most recent one wins.

    Attributes:
        received: Number of messages so far, valid or not.
    """

    def __init__(self, topics: Iterable[CommandTopic], warnings: Warnings):
        self.topics = {topic.name: topic for topic in topics}
        self.warnings = warnings
        self.received = 0
        self._lock = threading.Lock()
        self._values: dict[str, Vector] = {}
        self._next: dict[str, Vector] = {}  # values to follow latched ones
        self._sources: dict[str, str] = {}  # last source of each port

    def receive(self, topic: str, data: Any) -> None:
        """Check a message's `data`, and keep its command or report the fault."""
        try:
            values = self.topics[topic].convert(data)
        except CommandError as error:
            self.refuse(topic, error.kind, str(error))
            return
        self.put(values, topic)
        self.count()

    def receive_message(self, topic: str, message: Any) -> None:
        """Check a whole message, and keep its command or report the fault."""
        self.receive(topic, message if self.topics[topic].whole else message.data)

    def put(self, values: PortValues, source: str) -> None:
        """Keep a command that its source has checked."""
        with self._lock:
            self._put(values, source)

    def amend(self, values: PortValues, source: str) -> None:
        """Keep a command if `source` was the last to command each of its ports."""
        with self._lock:
            if all(self._sources.get(port) == source for port in values):
                self._put(values, source)

    def source(self, port: str) -> str | None:
        """Return the last source to command a port, if there is one."""
        with self._lock:
            return self._sources.get(port)

    def _put(self, values: PortValues, source: str) -> None:
        topic = self.topics.get(source)
        if topic is not None and topic.latched:
            seen = {k: np.maximum(v, self._values.get(k, v)) for k, v in values.items()}
            lower = [port for port in values if np.any(seen[port] > values[port])]
            self._next = {k: v for k, v in self._next.items() if k not in values}
            self._next |= {port: values[port] for port in lower}
            values = seen
        self._values.update(values)
        self._sources.update(dict.fromkeys(values, source))

    def count(self, messages: int = 1) -> None:
        """Count messages, valid or not."""
        with self._lock:
            self.received += messages

    def refuse(self, topic: str, kind: str, reason: str) -> None:
        """Count a refused message, and report why."""
        self.count()
        self.warnings.warn(
            f"{topic} {kind}", f"{topic}: {reason}; the last good command holds"
        )

    def take(self) -> dict[str, Vector]:
        """Return the commands since the last call, by input port."""
        with self._lock:
            values, self._values, self._next = self._values, self._next, {}
        return values


def port_of(robot: RobotArm, port: str) -> str:
    """Return a named arm's name for a port of `arm`, `gripper` or `safety`."""
    part, dot, name = port.partition(".")
    named = {
        "arm": robot.arm_model,
        "gripper": robot.gripper_model,
        "safety": f"{robot.prefix}safety",
    }
    return f"{named.get(part, part)}{dot}{name}"


def topic_of(robot: RobotArm, topic: str) -> str:
    """Return an arm's topic: /left/grasp of the arm `left`, /grasp of a single arm."""
    return f"/{robot.name}{topic}" if robot.name else topic


def _of_arm(robot: RobotArm, topics: Iterable[CommandTopic]) -> list[CommandTopic]:
    """Return topics of a named arm, given those that command `arm` and `gripper`."""

    def named(convert: Callable[[Any], PortValues], data: Any) -> PortValues:
        return {port_of(robot, port): value for port, value in convert(data).items()}

    return [
        dc.replace(
            topic,
            name=topic_of(robot, topic.name),
            convert=partial(named, topic.convert),
        )
        for topic in topics
    ]


_CLOSURE = "gripper.closure_commanded"
_MESSAGES = "gripper.closure_messages"
_SINGLE_JOINTS = "gripper.joint_position_commanded"
_ARM = "arm.position_desired"
TRAJECTORY = "arm.trajectory_desired"
_ARM_PORTS = (_ARM, TRAJECTORY)
# Ports that override the closure, or limit the force, while their values are finite.
_GRIPPER_PORTS = (
    _SINGLE_JOINTS,
    "gripper.motor_position_commanded",
    "gripper.motor_torque_commanded",
    "gripper.force_limit",
)
_PORTS = (_CLOSURE, _MESSAGES, *_ARM_PORTS, "gripper.hold", *_GRIPPER_PORTS)
_BOOL, _ARRAY = "std_msgs/msg/Bool", "std_msgs/msg/Float64MultiArray"


def gripper_command(
    inputs: Iterable[str], values: PortValues, joints: int = 1
) -> dict[str, Vector]:
    """Return a command of the whole gripper, which overrides every other source.

    NaN cancels commands of other sources at ports that `values` does not name.

    Args:
        inputs: Names of the station's input ports.
        values: The command, by input port.
        joints: Number of the gripper's commanded joints.
    """
    return {
        port: np.full(joints if port == _SINGLE_JOINTS else 1, np.nan)
        for port in _GRIPPER_PORTS
        if port in inputs
    } | dict(values)


def station_topics(
    plant: MultibodyPlant,
    inputs: Iterable[str],
    gripper_joints: Iterable[str] = (),
    robot: RobotArm = ONE_ARM,
    period: float = 0.0,
) -> list[CommandTopic]:
    """Return the topics that an arm and its gripper can obey.

    Those of the SRG thesis are `/grasp` (Int32, 0 open .. 100 closed),
    `/position_grasp` (Float64MultiArray, rad, one number per finger joint),
    `/startgrasp` (Bool, false holds the gripper where it is) and `/kuka`
    (Float64MultiArray, rad, one number per joint of the arm). The most recent of
    `/grasp`, `/position_grasp` and servo commands wins, see `gripper_command`. If the
    station has `gripper.closure_messages`, this port counts the `/grasp` messages.

    An arm that follows trajectories reaches the positions of `/kuka` one period later.
    It also has `/joint_trajectory` (JointTrajectory), with the joints in any order, and
    moves at constant velocity from point to point.

    Args:
        plant: A plant with the model instances of arm and gripper, if the station has
            them.
        inputs: Names of the station's input ports.
        gripper_joints: Names of the gripper's commanded joints, in their order.
        robot: The arm. If it has a name, topics begin with `/NAME`.
        period: Period of the arm's driver [s].
    """
    given, joints = set(inputs), list(gripper_joints)
    # The topics below command `arm` and `gripper`; `_of_arm` renames them.
    inputs = {port for port in _PORTS if port_of(robot, port) in given}
    topics = []
    received = itertools.count(1)  # numbers of the /grasp messages

    def gripper(port: str, value: Vector) -> PortValues:
        return gripper_command(inputs, {port: value}, len(joints))

    def arm(q: Vector) -> PortValues:
        if TRAJECTORY not in inputs:
            return {_ARM: q}
        return {TRAJECTORY: trajectory_piece(np.array([period]), q[np.newaxis])}

    def grasp(data: Any) -> PortValues:
        percent = int(data)
        if not 0 <= percent <= 100:
            raise CommandError(
                "range", f"must be 0 (open) to 100 (closed), got {percent}"
            )
        values = dict(gripper(_CLOSURE, np.array([percent / 100.0])))
        if _MESSAGES in inputs:
            values[_MESSAGES] = np.array([next(received)], dtype=float)
        return values

    def hold(data: Any) -> PortValues:
        return {"gripper.hold": np.array([0.0 if data else 1.0])}

    if _CLOSURE in inputs:
        topics.append(CommandTopic("/grasp", "std_msgs/msg/Int32", grasp))
    if "gripper.hold" in inputs:
        topics.append(CommandTopic("/startgrasp", _BOOL, hold))
    if joints:
        fingers = joint_limits(plant, robot.gripper_model, joints)

        def position_grasp(data: Any) -> PortValues:
            if _SINGLE_JOINTS not in inputs:
                why = "this gripper has one motor, which moves all joints at once"
                raise CommandError("port", why)
            return gripper(_SINGLE_JOINTS, checked_positions(fingers, data))

        topics.append(CommandTopic("/position_grasp", _ARRAY, position_grasp))
    if TRAJECTORY in inputs:
        command = trajectory_command(plant, robot)
        kind = "trajectory_msgs/msg/JointTrajectory"
        topics.append(CommandTopic("/joint_trajectory", kind, command, whole=True))
    if inputs & {*_ARM_PORTS}:
        limits = joint_limits(plant, robot.arm_model)
        convert = partial(checked_positions, limits)
        topics.append(CommandTopic("/kuka", _ARRAY, lambda data: arm(convert(data))))
    return _of_arm(robot, topics)


def arm_joint_names(plant: MultibodyPlant, robot: RobotArm = ONE_ARM) -> list[str]:
    """Return the names of an arm's joints in messages, in the order of its positions.

    Names of the arm `left` begin with `left_`.
    """
    moving = moving_joints(plant, plant.GetModelInstanceByName(robot.arm_model))
    return [robot.system(joint.name()) for joint in moving]


def joint_limits(
    plant: MultibodyPlant, instance: str, joints: list[str] | None = None
) -> tuple[Vector, Vector]:
    """Return the lower and upper position limits of a model's joints [rad or m]."""
    model = plant.GetModelInstanceByName(instance)
    if joints is None:
        moving = moving_joints(plant, model)
    else:
        moving = [plant.GetJointByName(name, model) for name in joints]
    return (
        np.array([joint.position_lower_limit() for joint in moving]),
        np.array([joint.position_upper_limit() for joint in moving]),
    )


def numbers(data: Any, size: int) -> Vector:
    """Return the finite numbers of a message, shape (size,).

    Raises:
        CommandError: If their number differs from `size`, or one is not finite.
    """
    values = np.array(data, dtype=np.float64)
    if values.shape != (size,):
        raise CommandError("length", f"needs {size} numbers, got {values.size}")
    if not np.isfinite(values).all():
        raise CommandError("finite", "needs finite numbers, got NaN or infinity")
    return values


def checked_positions(limits: tuple[Vector, Vector], data: Any) -> Vector:
    """Return a message's joint positions, shape (N,) [rad or m].

    Raises:
        CommandError: If one is outside the limits, or their number is wrong.
    """
    lower, upper = limits
    values = numbers(data, lower.size)
    for i in np.flatnonzero((values < lower) | (values > upper)):
        raise CommandError(
            "range",
            f"number {i + 1} must be {lower[i]:g} to {upper[i]:g}, got {values[i]:g}",
        )
    return values


def trajectory_command(
    plant: MultibodyPlant, robot: RobotArm = ONE_ARM
) -> Callable[[Any], PortValues]:
    """Return a function that turns a JointTrajectory into a command at `TRAJECTORY`.

    It raises a CommandError if the trajectory is invalid.

    Args:
        plant: A plant with the arm's model instance.
        robot: The arm.
    """
    names = arm_joint_names(plant, robot)
    limits = joint_limits(plant, robot.arm_model)

    def command(message: Any) -> PortValues:
        given, points = list(message.joint_names), message.points
        if sorted(given) != sorted(names):
            raise CommandError("joints", f"needs the joints {', '.join(names)}")
        if not 0 < len(points) <= CAPACITY:
            raise CommandError(
                "points", f"needs 1 to {CAPACITY} points, got {len(points)}"
            )
        order = [given.index(name) for name in names]
        positions = []
        for point in points:
            if len(point.positions) != len(names):
                raise CommandError("length", f"needs {len(names)} positions per point")
            q = np.array(point.positions)[order]
            positions.append(checked_positions(limits, q))
        times = np.array([seconds(point.time_from_start) for point in points])
        if np.any(np.diff(times, prepend=-1e-9) <= 0.0):
            raise CommandError("times", "needs points in the order of their times")
        start = seconds(message.header.stamp)
        return {TRAJECTORY: trajectory_piece(times, np.array(positions), start)}

    return command


def seconds(time: Any) -> float:
    """Return a builtin_interfaces/Time or Duration in seconds."""
    return float(time.sec) + 1e-9 * float(time.nanosec)


_SWITCHES = ("estop", "release", "heartbeat")


def safety_topics(
    inputs: Iterable[str], switches: Sequence[str] = _SWITCHES
) -> list[CommandTopic]:
    """Return the topics that command a station's safety monitor, if it has one.

    They are `/estop` (Bool, true while the button is pressed), `/release` (Bool, true
    acknowledges a stop), `/speed_override` (Int32, 0 .. 100 %) and `/heartbeat` (Bool:
    after the first true, the arm stops unless more arrive; false ends the watch).

    Args:
        inputs: Names of the station's input ports.
        switches: Names of the Bool topics to return.
    """
    if "safety.estop" not in inputs:
        return []

    def override(data: Any) -> PortValues:
        percent = int(data)
        if not 0 <= percent <= 100:
            raise CommandError("range", f"must be 0 to 100 percent, got {percent}")
        return {"safety.speed_override": np.array([percent / 100.0])}

    def switch(name: str) -> CommandTopic:
        def convert(data: Any) -> PortValues:
            return {f"safety.{name}": np.array([1.0 if data else 0.0])}

        return CommandTopic(f"/{name}", _BOOL, convert, latched=name == "estop")

    return [
        *(switch(name) for name in switches),
        CommandTopic("/speed_override", "std_msgs/msg/Int32", override),
    ]


class SafetyGate:
    """Blocks commands to a stopped arm, so that no old one moves it after a release.

    An arm without a safety monitor gets its commands unchanged.
    """

    def __init__(
        self,
        station: Diagram,
        warnings: Warnings,
        robots: Sequence[RobotArm] = (ONE_ARM,),
    ) -> None:
        self._warnings = warnings
        # Arm, state of its monitor, port of its commands, and a command of NaN.
        self._watched: list[tuple[RobotArm, OutputPort, str, Vector]] = []
        for robot in robots:
            state = port_of(robot, "safety.state")
            if station.HasOutputPort(state):
                ports = [port_of(robot, port) for port in _ARM_PORTS]
                (arm,) = filter(station.HasInputPort, ports)
                nowhere = np.full(station.GetInputPort(arm).size(), np.nan)
                output = station.GetOutputPort(state)
                self._watched.append((robot, output, arm, nowhere))

    def admit(self, values: PortValues, context: Context) -> PortValues:
        """Return the values of input ports to set.

        Args:
            values: Commands since the last call, by input port.
            context: The station's context.
        """
        if not self._watched:
            return values
        # A release lasts for one call.
        values = {"safety.release": np.zeros(1), **values}
        if "safety.heartbeat" in values:
            beats = values["safety.heartbeat"][0] > 0.0
            time = context.get_time() if beats else np.inf
            values["safety.heartbeat"] = np.array([time])
        for robot, output, arm, nowhere in self._watched:
            state, reason = safety_state(output.Eval(context))
            kind = topic_of(robot, "stop")
            if state is SafetyState.RUNNING:
                self._warnings.forget(kind)
                continue
            who = f"the arm {robot.name}".rstrip()
            kuka = topic_of(robot, "/kuka")
            text = f"{who} is stopped ({reason.value}); {kuka} waits for a /release"
            self._warnings.warn(kind, text)
            values[arm] = nowhere
        return values
