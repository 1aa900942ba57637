"""The action server of a served arm: FollowJointTrajectory over ROS 2.

An action is three services and two topics below its name (design.ros2.org, "Actions").
A service is a pair of DDS topics, one for requests and one for replies. A request
begins with a number of the client and one of the request, and the reply repeats both,
as in rmw_cyclonedds_cpp (`cdds_request_header_t` in its serdata.hpp, `rmw_init_cs` and
`rmw_take_response_request` in its rmw_node.cpp). rmw_fastrtps_cpp puts them into RTPS's
own header instead. So a client of one middleware cannot reach a server of the other.

Definitions follow ros-controls/control_msgs, `action/FollowJointTrajectory.action`, and
ros2/rcl_interfaces, action_msgs. Goals and results are flat here, because a nested
message has the same bytes as its members.
"""

from __future__ import annotations

import dataclasses as dc
import enum
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.arm.reference import trajectory_piece
from drake_srg.recording.rosbag import MakeMessage, Topic, header, stamp
from drake_srg.robot.serve.bridge import Outlet
from drake_srg.robot.serve.commands import (
    ONE_ARM,
    TRAJECTORY,
    CommandError,
    CommandInbox,
    CommandTopic,
    arm_joint_names,
    port_of,
    seconds,
    topic_of,
    trajectory_command,
)
from drake_srg.scenario import RobotArm
from drake_srg.types import Vector

_FOLLOW = "control_msgs/action/FollowJointTrajectory"
_CANCEL = "action_msgs/srv/CancelGoal"
STATUS = "action_msgs/msg/GoalStatusArray"
_HEADER = """
uint64 client
int64 number
"""
_DEFINITIONS = {
    "control_msgs/msg/JointTolerance": """
        string name
        float64 position
        float64 velocity
        float64 acceleration""",
    "control_msgs/msg/JointComponentTolerance": """
        string joint_name
        uint16 component
        float64 position
        float64 velocity
        float64 acceleration""",
    f"{_FOLLOW}_SendGoal_Request": f"""{_HEADER}
        unique_identifier_msgs/UUID goal_id
        trajectory_msgs/JointTrajectory trajectory
        trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory
        control_msgs/JointTolerance[] path_tolerance
        control_msgs/JointComponentTolerance[] component_path_tolerance
        control_msgs/JointTolerance[] goal_tolerance
        control_msgs/JointComponentTolerance[] component_goal_tolerance
        builtin_interfaces/Duration goal_time_tolerance""",
    f"{_FOLLOW}_SendGoal_Response": f"""{_HEADER}
        bool accepted
        builtin_interfaces/Time stamp""",
    f"{_FOLLOW}_GetResult_Request": f"""{_HEADER}
        unique_identifier_msgs/UUID goal_id""",
    f"{_FOLLOW}_GetResult_Response": f"""{_HEADER}
        int8 status
        int32 error_code
        string error_string""",
    f"{_CANCEL}_Request": f"""{_HEADER}
        action_msgs/GoalInfo goal_info""",
    f"{_CANCEL}_Response": f"""{_HEADER}
        int8 return_code
        action_msgs/GoalInfo[] goals_canceling""",
}


class GoalStatus(enum.IntEnum):
    """Status of a goal, as in action_msgs/GoalStatus."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


class ErrorCode(enum.IntEnum):
    """Why a goal ended, as in control_msgs/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class CancelCode(enum.IntEnum):
    """The answer to a request to cancel, as in action_msgs/CancelGoal."""

    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL_ID = 2
    GOAL_TERMINATED = 3


class Service(NamedTuple):
    """The topics of a service on DDS, and their types."""

    request: str
    reply: str
    request_type: str
    reply_type: str


class FollowJointTrajectory:
    """The services and topics of an action.

    Args:
        name: The action's name, with a leading slash.

    Attributes:
        send_goal: Accepts or rejects a goal.
        get_result: Replies once a goal has ended.
        cancel_goal: Stops following goals.
        status: Topic with the status of all goals.
    """

    def __init__(self, name: str) -> None:
        self.name, self.status = name, f"{name}/_action/status"
        self.send_goal, self.get_result, self.cancel_goal = (
            Service(
                f"rq{name}/_action/{part}Request",
                f"rr{name}/_action/{part}Reply",
                f"{kind}_Request",
                f"{kind}_Response",
            )
            for part, kind in (
                ("send_goal", f"{_FOLLOW}_SendGoal"),
                ("get_result", f"{_FOLLOW}_GetResult"),
                ("cancel_goal", _CANCEL),
            )
        )


def goal_id(make: MakeMessage, id: bytes) -> Any:
    """Return the 16 bytes of a goal's ID as a message."""
    return make("unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(id, np.uint8))


def goal_info(make: MakeMessage, id: bytes, time: float) -> Any:
    """Return a goal's ID and time [s] as a message."""
    return make(
        "action_msgs/msg/GoalInfo",
        goal_id=goal_id(make, id),
        stamp=stamp(make, time),
    )


def goal_fields(make: MakeMessage, id: bytes, trajectory: Any) -> dict[str, Any]:
    """Return the fields of a request to follow a trajectory, without tolerances."""
    nothing = make(
        "trajectory_msgs/msg/MultiDOFJointTrajectory",
        header=header(make, 0.0),
        joint_names=[],
        points=[],
    )
    return {
        "goal_id": goal_id(make, id),
        "trajectory": trajectory,
        "multi_dof_trajectory": nothing,
        "path_tolerance": [],
        "component_path_tolerance": [],
        "goal_tolerance": [],
        "component_goal_tolerance": [],
        "goal_time_tolerance": make("builtin_interfaces/msg/Duration", 0, 0),
    }


def with_actions(store: Any) -> Any:
    """Add the action's types to rosbags' store of message types, and return it."""
    from rosbags.typesys import get_types_from_msg

    for name, text in _DEFINITIONS.items():
        lines = "\n".join(line.strip() for line in text.splitlines())
        # rosbags puts a "msg" into the name; register the type under ours.
        (fields,) = get_types_from_msg(lines, name).values()
        store.register({name: fields})
    return store


# The action of a joint_trajectory_controller with its usual name.
ACTION = FollowJointTrajectory("/joint_trajectory_controller/follow_joint_trajectory")
# Goals whose results clients can still request.
_MOST_GOALS = 100
# How long a request waits until its client has subscribed to the reply [s], as in
# rmw_cyclonedds_cpp.
_DISCOVERY = 0.1
_EVERY = bytes(16)  # ID that means every goal, in a request to cancel

# Returns the fields of a reply.
Fill = Callable[[MakeMessage], Mapping[str, Any]]


@dc.dataclass
class _Goal:
    id: bytes
    time: float  # when it was accepted [s]
    end: float  # of the trajectory [s]
    target: Vector  # positions at the end (N,)
    path: Vector  # tolerances before the end (N,); infinite: none
    final: Vector  # tolerances at the target (N,)
    patience: float  # longest time from `end` to the target [s]; 0: no limit
    status: GoalStatus = GoalStatus.EXECUTING
    code: ErrorCode = ErrorCode.SUCCESSFUL
    text: str = ""
    asked: list[Any] = dc.field(default_factory=list)  # requests for the result

    def result(self, make: MakeMessage) -> Mapping[str, Any]:
        """Return the fields of the reply to a request for the result."""
        return {
            "status": int(self.status),
            "error_code": int(self.code),
            "error_string": self.text,
        }


class ActionServer:
    """Moves a served arm by goals of the action FollowJointTrajectory, over ROS 2.

    It behaves like joint_trajectory_controller (ros-controls/ros2_controllers,
    joint_trajectory_controller.cpp). A goal is rejected if its trajectory would be
    refused as a `/joint_trajectory`, or if it ends in the past. A new goal replaces the
    active one, which ends as canceled with INVALID_GOAL. A goal succeeds once its time
    is over and the joints are within its goal tolerances, if it has any. It is aborted
    if they exceed a path tolerance before its end, or a goal tolerance for longer than
    its time tolerance. After an aborted or canceled goal, the arm stays where it is.
    Only positions have tolerances. There is no feedback.

    Requests arrive in threads of bridges; `advance` answers them.

    Args:
        plant: A plant with the arm's model instance.
        period: Period of the arm's driver [s].
        robot: The arm. If it has a name, the action's name begins with `/NAME`.

    Attributes:
        topics: The topics of the requests, for the inbox, and those of replies and
            status, for the bridges.
    """

    def __init__(
        self, plant: MultibodyPlant, period: float, robot: RobotArm = ONE_ARM
    ) -> None:
        self._joints, self._period = arm_joint_names(plant, robot), period
        self._command, self.robot = trajectory_command(plant, robot), robot
        self._action = action = FollowJointTrajectory(topic_of(robot, ACTION.name))
        self._handlers = {
            action.send_goal: self._send_goal,
            action.cancel_goal: self._cancel_goal,
            action.get_result: self._get_result,
        }
        requests = [self._requests(service) for service in self._handlers]
        self._replies = {service: _replies(service) for service in self._handlers}
        self._status = Topic(action.status, STATUS, {}, _status, latched=True)
        self.topics = requests, [*self._replies.values(), self._status]
        self._arrived: deque[tuple[float, Service, Any]] = deque()
        self._goals: dict[bytes, _Goal] = {}
        self._active: _Goal | None = None
        self._time, self._commanded = 0.0, np.zeros(len(self._joints))

    def connect(self, inbox: CommandInbox, outlet: Outlet) -> None:
        """Set the inbox for commands, and the outlet for replies."""
        self._inbox, self._outlet = inbox, outlet

    def advance(self, time: float, state: Vector, commanded: Vector) -> None:
        """Answer requests, and end the active goal if it has succeeded or failed.

        Args:
            time: Now [s].
            state: State of the arm, [q; v], shape (2N,).
            commanded: Positions commanded to the arm's driver, shape (N,) [rad or m].
        """
        self._time, self._commanded = time, commanded
        early = []
        while self._arrived:
            arrived, service, request = self._arrived.popleft()
            if self._outlet.has_subscribers(service.reply):
                fill = self._handlers[service](request)
                if fill is not None:
                    self._reply(service, request, fill)
            elif time - arrived < _DISCOVERY:
                early.append((arrived, service, request))
        self._arrived.extendleft(reversed(early))
        if self._active is not None:
            self._follow(self._active, state[: len(commanded)])

    def _requests(self, service: Service) -> CommandTopic:
        def convert(message: Any) -> Mapping[str, Vector]:
            self._arrived.append((self._time, service, message))
            return {}

        return CommandTopic(service.request, service.request_type, convert, whole=True)

    def _send_goal(self, request: Any) -> Fill:
        try:
            values = self._command(request.trajectory)
            goal = self._goal(request)
            if goal.end < self._time:
                ended = f"ended at {goal.end:.3f} s, and now it is {self._time:.3f} s"
                raise CommandError("past", ended)
        except CommandError as error:
            self._inbox.refuse(self._action.name, error.kind, str(error))
            return self._accepted(False)
        if self._active is not None:
            self._end(
                GoalStatus.CANCELED, ErrorCode.INVALID_GOAL, "replaced by a newer goal"
            )
        self._put(values)
        self._goals[goal.id] = self._active = goal
        while len(self._goals) > _MOST_GOALS:
            del self._goals[next(iter(self._goals))]
        self._tell()
        return self._accepted(True)

    def _accepted(self, accepted: bool) -> Fill:
        time = self._time
        return lambda make: {"accepted": accepted, "stamp": stamp(make, time)}

    def _goal(self, request: Any) -> _Goal:
        trajectory = request.trajectory
        given, last = list(trajectory.joint_names), trajectory.points[-1]
        start = seconds(trajectory.header.stamp) or self._time
        return _Goal(
            bytes(request.goal_id.uuid),
            self._time,
            start + seconds(last.time_from_start),
            np.array([last.positions[given.index(name)] for name in self._joints]),
            self._tolerances(request.path_tolerance),
            self._tolerances(request.goal_tolerance),
            seconds(request.goal_time_tolerance),
        )

    def _tolerances(self, given: Iterable[Any]) -> Vector:
        """Return tolerances by joint (N,) [rad or m]; infinite where none is given."""
        told = {entry.name: entry.position for entry in given}
        values = np.array([told.get(name, 0.0) for name in self._joints])
        return np.where(values > 0.0, values, np.inf)

    def _cancel_goal(self, request: Any) -> Fill:
        id = bytes(request.goal_info.goal_id.uuid)
        before, goal = seconds(request.goal_info.stamp), self._active
        code, canceled = CancelCode.NONE, []
        # No ID and no stamp: every goal. A stamp: all goals up to then, too.
        every = id == _EVERY and not before
        if goal is not None and (
            every or id == goal.id or (before and goal.time <= before)
        ):
            self._hold()
            self._end(GoalStatus.CANCELED, ErrorCode.SUCCESSFUL, "canceled")
            canceled = [(goal.id, goal.time)]
        elif id in self._goals:
            code = CancelCode.GOAL_TERMINATED
        elif id != _EVERY:
            code = CancelCode.UNKNOWN_GOAL_ID
        return lambda make: {
            "return_code": int(code),
            "goals_canceling": [goal_info(make, *each) for each in canceled],
        }

    def _get_result(self, request: Any) -> Fill | None:
        goal = self._goals.get(bytes(request.goal_id.uuid))
        if goal is None:
            return lambda make: {
                "status": int(GoalStatus.UNKNOWN),
                "error_code": int(ErrorCode.INVALID_GOAL),
                "error_string": "no such goal",
            }
        if goal is self._active:
            goal.asked.append(request)
            return None
        return goal.result

    def _follow(self, goal: _Goal, q: Vector) -> None:
        """End the goal if it has succeeded, or if the joints exceed a tolerance."""
        if self._time < goal.end:
            away, allowed = np.abs(q - self._commanded), goal.path
            code, late = ErrorCode.PATH_TOLERANCE_VIOLATED, True
        else:
            away, allowed = np.abs(q - goal.target), goal.final
            code = ErrorCode.GOAL_TOLERANCE_VIOLATED
            late = 0.0 < goal.patience < self._time - goal.end
        if np.any(away > allowed):
            if late:
                joint = int(np.argmax(away / allowed))
                text = f"{self._joints[joint]} is {away[joint]:.3g} away"
                self._hold()
                self._end(GoalStatus.ABORTED, code, text)
        elif self._time >= goal.end:
            self._end(GoalStatus.SUCCEEDED, ErrorCode.SUCCESSFUL, "")

    def _hold(self) -> None:
        """Let the arm rest at its commanded position."""
        times, q = np.array([self._period]), self._commanded[np.newaxis]
        self._put({TRAJECTORY: trajectory_piece(times, q)})

    def _put(self, values: Mapping[str, Vector]) -> None:
        """Command the arm."""
        named = {port_of(self.robot, port): value for port, value in values.items()}
        self._inbox.put(named, self._action.name)

    def _end(self, status: GoalStatus, code: ErrorCode, text: str) -> None:
        """End the active goal."""
        goal, self._active = self._active, None
        assert goal is not None
        goal.status, goal.code, goal.text = status, code, text
        for request in goal.asked:
            self._reply(self._action.get_result, request, goal.result)
        self._tell()

    def _reply(self, service: Service, request: Any, fill: Fill) -> None:
        self._outlet.send(self._replies[service], self._time, [request, fill])

    def _tell(self) -> None:
        self._outlet.send(self._status, self._time, [list(self._goals.values())])


def _replies(service: Service) -> Topic:
    """Return the topic of a service's replies, made from a request and a `Fill`."""

    def convert(make: MakeMessage, time: float, request: Any, fill: Fill) -> Any:
        client, number = request.client, request.number
        return make(service.reply_type, client=client, number=number, **fill(make))

    return Topic(service.reply, service.reply_type, {}, convert)


def _status(make: MakeMessage, time: float, goals: Sequence[_Goal]) -> Any:
    entries = [
        make(
            "action_msgs/msg/GoalStatus",
            goal_info=goal_info(make, goal.id, goal.time),
            status=int(goal.status),
        )
        for goal in goals
    ]
    return make(STATUS, status_list=entries)
