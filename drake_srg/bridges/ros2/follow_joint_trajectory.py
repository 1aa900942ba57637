"""The action control_msgs/FollowJointTrajectory on ROS 2's wire.

An action is three services and two topics below its name (design.ros2.org, "Actions").
A service is a pair of DDS topics, one for requests and one for replies. Each message
begins with a number of the client's and one of the request, and a reply repeats both:
this is how rmw_cyclonedds_cpp does it (`cdds_request_header_t` in its serdata.hpp,
`rmw_init_cs` and `rmw_take_response_request` in its rmw_node.cpp). rmw_fastrtps_cpp
puts them into RTPS's own header instead, so that neither's services reach the other.

Definitions follow ros-controls/control_msgs, `action/FollowJointTrajectory.action`, and
ros2/rcl_interfaces, action_msgs. A nested message and its members are the same bytes,
so goals and results are written out flat.
"""

from __future__ import annotations

import dataclasses as dc
import enum
from typing import Any

import numpy as np

from drake_srg.recording.ros_topics import MakeMessage, stamp

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
    """What becomes of a goal, as in action_msgs/GoalStatus."""

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


@dc.dataclass(frozen=True)
class Service:
    """A service of ROS 2.

    Attributes:
        name: Its name, with the slash.
        type: Its type, such as "action_msgs/srv/CancelGoal".
    """

    name: str
    type: str

    @property
    def request(self) -> str:
        """The DDS topic of the requests."""
        return f"rq{self.name}Request"

    @property
    def reply(self) -> str:
        """The DDS topic of the replies."""
        return f"rr{self.name}Reply"

    @property
    def request_type(self) -> str:
        """The type of the requests."""
        return f"{self.type}_Request"

    @property
    def reply_type(self) -> str:
        """The type of the replies."""
        return f"{self.type}_Response"


@dc.dataclass(frozen=True)
class FollowJointTrajectory:
    """The services and topics of an action.

    Attributes:
        name: Of the action, with the slash.
    """

    name: str

    @property
    def send_goal(self) -> Service:
        """Accepts or rejects a goal."""
        return Service(f"{self.name}/_action/send_goal", f"{_FOLLOW}_SendGoal")

    @property
    def get_result(self) -> Service:
        """Replies once a goal has ended."""
        return Service(f"{self.name}/_action/get_result", f"{_FOLLOW}_GetResult")

    @property
    def cancel_goal(self) -> Service:
        """Stops following goals."""
        return Service(f"{self.name}/_action/cancel_goal", _CANCEL)

    @property
    def status(self) -> str:
        """The topic that tells the status of all goals."""
        return f"{self.name}/_action/status"


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


def with_actions(store: Any) -> Any:
    """Add the action's types to rosbags' store of message types, and return it."""
    from rosbags.typesys import get_types_from_msg

    for name, text in _DEFINITIONS.items():
        lines = "\n".join(line.strip() for line in text.splitlines())
        # Its name for a type of a service has a "msg" in it.
        (fields,) = get_types_from_msg(lines, name).values()
        store.register({name: fields})
    return store
