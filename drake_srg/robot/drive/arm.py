"""Drivers of arms that speak ROS 1 or ROS 2, with three ways to send commands."""

import dataclasses as dc
import itertools
import math
import secrets
import threading
import uuid
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from drake_srg.arm.reference import CAPACITY
from drake_srg.recording.rosbag import MakeMessage, Topic, float64_array, header
from drake_srg.robot.drive.link import (
    ARRAY,
    EXTERNAL_TORQUE,
    JOINT_STATE,
    STAMP,
    JointStates,
    Link,
    Mailbox,
    Node,
    Robot,
    RosDriver,
)
from drake_srg.robot.serve.action_server import (
    ErrorCode,
    FollowJointTrajectory,
    GoalStatus,
    Service,
    goal_fields,
    goal_id,
    goal_info,
)
from drake_srg.robot.serve.commands import PortValues, Warnings, numbers
from drake_srg.types import Vector

# Longest delay of an answer or a result, and longest time to find the server, by the
# robot's clock [s].
_PATIENCE = 1.0
# A goal that ends with one of these stops the arm even if a newer goal replaced it.
_VIOLATIONS = (ErrorCode.PATH_TOLERANCE_VIOLATED, ErrorCode.GOAL_TOLERANCE_VIOLATED)
# Most calls that wait for a reply; beyond that, the oldest are forgotten.
_MOST_CALLS = 200

_T = TypeVar("_T")
# Returns the fields of a request from the values of a `call`.
Fill = Callable[..., Mapping[str, Any]]


def joint_trajectory(name: str, joints: Sequence[str]) -> Topic:
    """Return a topic of timed positions as trajectory_msgs/JointTrajectory.

    Its `convert` takes times (K,) [s], by the robot's clock, and positions (K, N).
    """
    kind = "trajectory_msgs/msg/JointTrajectory"

    def convert(make: MakeMessage, time: float, times: Vector, q: Vector) -> Any:
        points = [
            make(
                "trajectory_msgs/msg/JointTrajectoryPoint",
                positions=np.array(q_i, dtype=np.float64),
                velocities=np.zeros(0),
                accelerations=np.zeros(0),
                effort=np.zeros(0),
                time_from_start=duration(make, t_i - times[0]),
            )
            for t_i, q_i in zip(times, q, strict=True)
        ]
        return make(
            kind,
            header=header(make, float(times[0])),
            joint_names=list(joints),
            points=points,
        )

    return Topic(name, kind, {}, convert)


def duration(make: MakeMessage, seconds: float) -> Any:
    """Return a time [s] as a builtin_interfaces/msg/Duration."""
    sec, nanosec = divmod(round(seconds * 1e9), 10**9)
    return make("builtin_interfaces/msg/Duration", sec=sec, nanosec=nanosec)


class Window:
    """Gives each command a time that is `lead` ahead of the robot's clock.

    The times are `period` apart while both clocks keep pace. After a delay of our
    clock, the robot gets more time for a step, never less. After a delay of the robot's
    clock, the newest command is farther ahead than `lead`, until the arm rests.

    Args:
        lead: How far ahead of the robot's clock the newest command is [s].
        period: Time between commands [s].
    """

    def __init__(self, lead: float, period: float) -> None:
        self._lead, self._period = lead, period
        self._kept: deque[tuple[float, Vector]] = deque(maxlen=CAPACITY)

    def after(self, q: Vector, stamp: float) -> tuple[Vector, Vector]:
        """Return the times (K,) [s] and positions (K, N) to send.

        Args:
            q: The newest command, shape (N,) [rad or m].
            stamp: The newest known time of the robot's clock [s].
        """
        ahead = [old for t, old in self._kept if t > stamp]
        if ahead and all(np.array_equal(q, old) for old in ahead):
            self._kept.clear()  # the arm rests: the next step may start at `lead`
        time = stamp + self._lead
        if self._kept:
            time = max(time, self._kept[-1][0] + self._period)
        self._kept.append((time, np.array(q)))
        while self._kept[0][0] < stamp - self._lead:
            self._kept.popleft()
        times, positions = zip(*self._kept, strict=True)
        return np.array(times), np.array(positions)


class ArmStream:
    """Sends commands to an arm.

    Attributes:
        lag: Time within which the arm must reach a commanded position [s].
        fails: Whether the arm no longer obeys. The link then reports nothing, so that
            the safety monitor stops the arm.
    """

    lag: float = 0.0
    fails: bool = False

    def send(self, q: Vector, stamp: float, *, stopped: bool) -> None:
        """Send a command; called every control period.

        Args:
            q: Positions, shape (N,) [rad or m].
            stamp: The newest known time of the robot's clock [s]; -inf: unknown.
            stopped: Whether the safety monitor stops the arm, or has stopped it.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Leave the arm where it is. Called while the node is still open."""


class PositionStream(ArmStream):
    """Sends the newest positions, which the arm obeys at once.

    Args:
        node: The node; not yet open.
        topic: Name of the std_msgs/Float64MultiArray.
    """

    def __init__(self, node: Node, topic: str, size: int) -> None:
        self._node = node
        self._topic = float64_array(topic, "arm.position_commanded", size)
        node.publish(self._topic)

    def send(self, q: Vector, stamp: float, *, stopped: bool) -> None:
        """Send a command; called every control period."""
        self._node.send(self._topic, 0.0, q)


class TrajectoryStream(ArmStream):
    """Sends the positions of the last and next `lead` seconds, by the robot's clock.

    Args:
        node: The node; not yet open.
        topic: Name of the trajectory_msgs/JointTrajectory.
        lead: How far ahead of the robot's clock the newest command is [s].
        period: Time between commands [s].
    """

    def __init__(
        self, node: Node, topic: str, joints: Sequence[str], lead: float, period: float
    ) -> None:
        self.lag = lead
        self._node, self._window = node, Window(lead, period)
        self._topic = joint_trajectory(topic, joints)
        node.publish(self._topic)

    def send(self, q: Vector, stamp: float, *, stopped: bool) -> None:
        """Send a command; called every control period."""
        if math.isfinite(stamp):
            times, positions = self._window.after(q, stamp)
            self._node.send(self._topic, 0.0, times, positions)


class ServiceClient(Generic[_T]):
    """A client of a service, whose replies arrive in a thread of its node.

    Args:
        node: The node; not yet open.
        fill: Called as `fill(make, *values)`.
        receive: Called with the `about` of a call, and the reply.
    """

    def __init__(
        self,
        node: Node,
        service: Service,
        fill: Fill,
        receive: Callable[[_T, Any], None],
    ) -> None:
        self._id = secrets.randbits(64)
        self._numbers = itertools.count(1)
        self._node, self._receive = node, receive
        self._lock = threading.Lock()
        self._calls: dict[int, _T] = {}

        def convert(make: MakeMessage, time: float, number: int, *values: Any) -> Any:
            fields = fill(make, *values)
            return make(service.request_type, client=self._id, number=number, **fields)

        self._topic = Topic(service.request, service.request_type, {}, convert)
        node.publish(self._topic)
        node.subscribe(service.reply, service.reply_type, self._take)

    @property
    def there(self) -> bool:
        """Whether a server listens."""
        return self._node.has_subscribers(self._topic.name)

    def call(self, about: _T, *values: Any) -> None:
        """Send a request.

        Args:
            about: Passed to `receive` with the reply.
            values: Passed to `fill`.
        """
        with self._lock:
            number = next(self._numbers)
            self._calls[number] = about
            while len(self._calls) > _MOST_CALLS:
                del self._calls[next(iter(self._calls))]
        self._node.send(self._topic, 0.0, number, *values)

    def _take(self, reply: Any) -> None:
        if reply.client != self._id:
            return
        with self._lock:
            about = self._calls.pop(reply.number, None)
        if about is not None:
            self._receive(about, reply)


@dc.dataclass
class _Goal:
    id: bytes
    end: float  # of its trajectory, by the robot's clock [s]
    accepted: bool = False
    canceled: bool = False  # by us


class GoalStream(ArmStream):
    """Sends goals of an action, each of which replaces the one before.

    A goal has the same trajectory as a message of `TrajectoryStream`: positions of the
    last and next `lead` seconds, by the robot's clock. While the commands change, a new
    goal is sent every half `lead`. It begins on the path of the goal before, so that a
    joint_trajectory_controller continues along the same path
    (ros-controls/ros2_controllers, "Trajectory Replacement"). The last goal ends where
    the arm must rest.

    The stream fails if the server rejects a goal that came in time, aborts one, or
    disappears, if another client cancels one, or if an answer or a result is missing.
    It then cancels all goals, sends no more, and warns the user. When the safety
    monitor stops the arm, goals follow the braking path as usual. Goals that remain
    after that are canceled. Closing the stream cancels all goals.

    Args:
        node: The node; not yet open.
        lead: How far ahead of the robot's clock the newest command is [s].
        period: Time between commands [s].
    """

    def __init__(
        self,
        node: Node,
        name: str,
        joints: Sequence[str],
        lead: float,
        period: float,
        warnings: Warnings,
    ) -> None:
        self.lag = lead
        self._name, self._warnings = name, warnings
        self._window = Window(lead, period)
        self._interval = 0.5 * (lead - period)  # so that rounding costs no period
        trajectory = joint_trajectory(name, joints)

        def goal(make: MakeMessage, id: bytes, times: Vector, q: Vector) -> Any:
            return goal_fields(make, id, trajectory.convert(make, 0.0, times, q))

        action = FollowJointTrajectory(name)
        self._send = ServiceClient[_Goal](node, action.send_goal, goal, self._answered)
        self._result = ServiceClient[_Goal](
            node,
            action.get_result,
            lambda make, id: {"goal_id": goal_id(make, id)},
            self._ended,
        )
        self._cancel = ServiceClient[_Goal](
            node,
            action.cancel_goal,
            lambda make, id: {"goal_info": goal_info(make, id, 0.0)},
            lambda goal, reply: None,  # the goal's result says enough
        )
        # Commands come from the control loop, replies from the node's thread.
        self._lock = threading.RLock()
        self._goals: dict[bytes, _Goal] = {}  # sent and not known to have ended
        self._newest: _Goal | None = None
        self._last: Vector | None = None  # the last command
        self._changed = False  # whether a command has changed since the newest goal
        # By the robot's clock [s]: time of the first command, of the last one, and the
        # earliest time of the next goal.
        self._first, self._stamp, self._next = math.inf, -math.inf, -math.inf
        self._found = False  # whether the server was found

    def send(self, q: Vector, stamp: float, *, stopped: bool) -> None:
        """Send a command; called every control period."""
        with self._lock:
            if self.fails or not math.isfinite(stamp):
                return
            self._first, self._stamp = min(self._first, stamp), stamp
            times, positions = self._window.after(q, stamp)
            if self._last is None or not np.array_equal(q, self._last):
                self._changed, self._last = True, q.copy()
            if not self._works(stamp):
                return
            if self._changed and stamp >= self._next:
                goal = _Goal(uuid.uuid4().bytes, float(times[-1]))
                self._goals[goal.id] = self._newest = goal
                self._changed, self._next = False, stamp + self._interval
                self._send.call(goal, goal.id, times, positions)
            elif stopped and not self._changed:
                self._cancel_goals(before=stamp)

    def close(self) -> None:
        """Leave the arm where it is. Called while the node is still open."""
        with self._lock:
            if not self.fails:
                self._cancel_goals()
            self.fails = True

    def _works(self, stamp: float) -> bool:
        """Return whether the server is there and no reply is overdue."""
        if self._send.there:
            self._found = True
        elif self._found:
            self._fail("the action server has gone")
        elif stamp > self._first + _PATIENCE:
            self._fail("no action server found")
        for goal in list(self._goals.values()):
            if stamp <= goal.end + _PATIENCE:
                continue
            if not goal.accepted:
                self._fail("a goal was not answered")
            elif goal is self._newest:
                self._fail("a goal has ended without a result")
            else:  # replaced long ago; its result does not matter
                del self._goals[goal.id]
        return self._found and not self.fails

    def _answered(self, goal: _Goal, reply: Any) -> None:
        with self._lock:
            if not reply.accepted:
                self._goals.pop(goal.id, None)
                self._reject(goal)
                return
            goal.accepted = True
        self._result.call(goal, goal.id)

    def _reject(self, goal: _Goal) -> None:
        if self._stamp <= goal.end:
            self._fail("a goal was rejected")
            return
        # The network or the server caused a delay, and the arm has come to rest
        # meanwhile. If it is far behind, the safety monitor stops it.
        self._changed = True  # send another goal, even if the commands rest
        self._warnings.warn(
            f"{self._name} late",
            f"{self._name}: a goal came too late; does `lead` exceed twice "
            "the round-trip time of a message?",
        )

    def _ended(self, goal: _Goal, reply: Any) -> None:
        with self._lock:
            self._goals.pop(goal.id, None)
            if reply.status == GoalStatus.SUCCEEDED or goal.canceled:
                return
            if goal is self._newest or reply.error_code in _VIOLATIONS:
                self._fail(_describe(reply))

    def _fail(self, reason: str) -> None:
        if not self.fails:
            self.fails = True
            self._cancel_goals()
            self._warnings.warn(
                f"{self._name} failed", f"{self._name}: {reason}; the arm is stopped"
            )

    def _cancel_goals(self, before: float = math.inf) -> None:
        """Cancel the goals whose trajectories end before a time [s]."""
        for goal in self._goals.values():
            if goal.end < before and not goal.canceled:
                goal.canceled = True
                self._cancel.call(goal, goal.id)


def _describe(reply: Any) -> str:
    """Return in words how a goal has ended."""
    names = {int(status): status.name.lower() for status in GoalStatus}
    codes = {int(code): code.name for code in ErrorCode}
    status = names.get(reply.status, f"ended with status {reply.status}")
    code = codes.get(reply.error_code, str(reply.error_code))
    return f"a goal was {status} ({code}): {reply.error_string or 'no reason given'}"


@dc.dataclass(kw_only=True)
class RosArm(RosDriver):
    """An arm that publishes joint states and obeys a stream of positions."""

    part: ClassVar[str] = "arm"
    own_topics: ClassVar[tuple[str, ...]] = ("command", "external_torque")

    # Topic of the commands, one message each control period. `trajectory`: a
    # trajectory_msgs/JointTrajectory with the positions of the last and next `lead`
    # seconds by the robot's clock, for a joint_trajectory_controller. The arm follows
    # `lead` later, and tolerates messages that are late or missing for as long.
    # `positions`: a std_msgs/Float64MultiArray [rad or m], which the arm obeys at once.
    command: str = "joint_trajectory"
    stream: str = dc.field(
        default="trajectory", metadata={"among": ("trajectory", "positions")}
    )
    lead: float = dc.field(default=0.05, metadata={"gt": 0.0})
    # Topic of the torques that the joints feel from outside, as the arm's controller
    # estimates them: std_msgs/Float64MultiArray [N m], one number per joint, in the
    # order of `joints`, at least every `safety.watchdog`. Limits of external torque or
    # force need this topic. Empty: the arm does not publish them.
    external_torque: str = ""

    def connect(self, robot: Robot) -> Link:
        """Return a link to the hardware."""
        node = robot.nodes.of(self.version)
        return _ArmLink(self, robot, node, self._stream(robot, node))

    def _stream(self, robot: Robot, node: Node) -> ArmStream:
        """Return the stream that sends the commands."""
        joints, arm = self.names(robot), robot.scenario.arm
        assert arm is not None
        command = robot.topic(self.command)
        if self.stream == "positions":
            return PositionStream(node, command, len(joints))
        return TrajectoryStream(node, command, joints, self.lead, arm.period)


class Ros1Arm(RosArm):
    """An arm that speaks ROS 1."""

    version = 1


@dc.dataclass(kw_only=True)
class Ros2Arm(RosArm):
    """An arm that speaks ROS 2."""

    version: ClassVar[int] = 2
    own_topics = (*RosArm.own_topics, "action")

    # `action`: trajectories as goals of the control_msgs/FollowJointTrajectory named by
    # the key `action`, two per `lead`. Answers must arrive within half a `lead`. The
    # server must use rmw_cyclonedds_cpp.
    stream: str = dc.field(
        default="trajectory", metadata={"among": ("trajectory", "positions", "action")}
    )
    action: str = "joint_trajectory_controller/follow_joint_trajectory"

    def _stream(self, robot: Robot, node: Node) -> ArmStream:
        if self.stream != "action":
            return super()._stream(robot, node)
        arm = robot.scenario.arm
        assert arm is not None
        return GoalStream(
            node,
            robot.topic(self.action),
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
        node.subscribe(robot.topic(config.state), JOINT_STATE, self._receive)
        self._needed = {"arm.state_measured"}
        if config.external_torque:
            self._needed.add(EXTERNAL_TORQUE)
            self.outputs[EXTERNAL_TORQUE] = n
            torque = robot.topic(config.external_torque)
            node.subscribe(torque, ARRAY, self._receive_external)

    def take(self) -> PortValues:
        # An arm that stops publishing any required measurement counts as silent.
        return {} if self._stream.fails else self._mail.take(self._needed)

    def close(self) -> None:
        self._stream.close()  # `Nodes` closes the shared node

    def send(self, commands: PortValues) -> None:
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
