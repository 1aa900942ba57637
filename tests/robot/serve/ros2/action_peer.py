"""A server of the action that runs as a process: `action_peer.py DOMAIN ACTION`.

It does not use the package: its types are written by hand, and Cyclone DDS serialises
them. Each begins with the header of rmw_cyclonedds_cpp. It accepts a goal if its
first joint is called "a", aborts it if it has one point, and otherwise lets it succeed.
It prints what it gets as lines of JSON, until its input ends.
"""

import dataclasses as dc
import json
import sys
import threading
import time

from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import (
    array,
    float64,
    int8,
    int32,
    int64,
    sequence,
    uint8,
    uint16,
    uint32,
    uint64,
)
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from robot.serve.ros2.dds_peer import CONFIGURATION, Header, Time, qos

FOLLOW = "control_msgs::action::dds_::FollowJointTrajectory"


@dc.dataclass
class Duration(IdlStruct, typename="builtin_interfaces::msg::dds_::Duration_"):
    sec: int32
    nanosec: uint32


@dc.dataclass
class Uuid(IdlStruct, typename="unique_identifier_msgs::msg::dds_::UUID_"):
    uuid: array[uint8, 16]


@dc.dataclass
class Point(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectoryPoint_"):
    positions: sequence[float64]
    velocities: sequence[float64]
    accelerations: sequence[float64]
    effort: sequence[float64]
    time_from_start: Duration


@dc.dataclass
class Trajectory(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectory_"):
    header: Header
    joint_names: sequence[str]
    points: sequence[Point]


@dc.dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dc.dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dc.dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dc.dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dc.dataclass
class MultiPoint(
    IdlStruct, typename="trajectory_msgs::msg::dds_::MultiDOFJointTrajectoryPoint_"
):
    transforms: sequence[Transform]
    velocities: sequence[Twist]
    accelerations: sequence[Twist]
    time_from_start: Duration


@dc.dataclass
class Multi(IdlStruct, typename="trajectory_msgs::msg::dds_::MultiDOFJointTrajectory_"):
    header: Header
    joint_names: sequence[str]
    points: sequence[MultiPoint]


@dc.dataclass
class Tolerance(IdlStruct, typename="control_msgs::msg::dds_::JointTolerance_"):
    name: str
    position: float64
    velocity: float64
    acceleration: float64


@dc.dataclass
class Component(
    IdlStruct, typename="control_msgs::msg::dds_::JointComponentTolerance_"
):
    joint_name: str
    component: uint16
    position: float64
    velocity: float64
    acceleration: float64


@dc.dataclass
class SendGoalRequest(IdlStruct, typename=f"{FOLLOW}_SendGoal_Request_"):
    client: uint64
    number: int64
    goal_id: Uuid
    trajectory: Trajectory
    multi_dof_trajectory: Multi
    path_tolerance: sequence[Tolerance]
    component_path_tolerance: sequence[Component]
    goal_tolerance: sequence[Tolerance]
    component_goal_tolerance: sequence[Component]
    goal_time_tolerance: Duration


@dc.dataclass
class SendGoalResponse(IdlStruct, typename=f"{FOLLOW}_SendGoal_Response_"):
    client: uint64
    number: int64
    accepted: bool
    stamp: Time


@dc.dataclass
class GetResultRequest(IdlStruct, typename=f"{FOLLOW}_GetResult_Request_"):
    client: uint64
    number: int64
    goal_id: Uuid


@dc.dataclass
class GetResultResponse(IdlStruct, typename=f"{FOLLOW}_GetResult_Response_"):
    client: uint64
    number: int64
    status: int8
    error_code: int32
    error_string: str


@dc.dataclass
class GoalInfo(IdlStruct, typename="action_msgs::msg::dds_::GoalInfo_"):
    goal_id: Uuid
    stamp: Time


@dc.dataclass
class CancelRequest(IdlStruct, typename="action_msgs::srv::dds_::CancelGoal_Request_"):
    client: uint64
    number: int64
    goal_info: GoalInfo


@dc.dataclass
class CancelResponse(
    IdlStruct, typename="action_msgs::srv::dds_::CancelGoal_Response_"
):
    client: uint64
    number: int64
    return_code: int8
    goals_canceling: sequence[GoalInfo]


class Server:
    def __init__(self, domain, action):
        self.domain = Domain(domain, CONFIGURATION)
        self.participant = DomainParticipant(domain)
        self.services = [
            (handle, *self.open(f"{action}/_action/{name}", request, response))
            for name, request, response, handle in (
                ("send_goal", SendGoalRequest, SendGoalResponse, self.send_goal),
                ("get_result", GetResultRequest, GetResultResponse, self.get_result),
                ("cancel_goal", CancelRequest, CancelResponse, self.cancel_goal),
            )
        ]
        self.points = {}

    def open(self, name, request, response):
        asked = Topic(self.participant, f"rq{name}Request", request)
        told = Topic(self.participant, f"rr{name}Reply", response)
        return (
            DataReader(self.participant, asked, qos(True, 100)),
            DataWriter(self.participant, told, qos(True, 100)),
        )

    def serve(self):
        for handle, reader, writer in self.services:
            for request in reader.take(100):
                if dc.is_dataclass(request):
                    writer.write(handle(request))

    def send_goal(self, request):
        trajectory = request.trajectory
        accepted = trajectory.joint_names[0] == "a"
        self.points[bytes(request.goal_id.uuid)] = len(trajectory.points)
        told = dc.asdict(trajectory) | {"id": bytes(request.goal_id.uuid).hex()}
        print(json.dumps(["goal", told]), flush=True)
        return SendGoalResponse(request.client, request.number, accepted, Time(1, 2))

    def get_result(self, request):
        if self.points[bytes(request.goal_id.uuid)] == 1:
            result = 6, -4, "joint a"
        else:
            result = 4, 0, ""
        return GetResultResponse(request.client, request.number, *result)

    def cancel_goal(self, request):
        id = bytes(request.goal_info.goal_id.uuid).hex()
        print(json.dumps(["cancel", id]), flush=True)
        return CancelResponse(request.client, request.number, 0, [request.goal_info])


def main():
    server = Server(int(sys.argv[1]), sys.argv[2])
    print(json.dumps("ready"), flush=True)
    ended = threading.Event()
    threading.Thread(
        target=lambda: (sys.stdin.read(), ended.set()), daemon=True
    ).start()
    while not ended.is_set():
        server.serve()
        time.sleep(0.002)


if __name__ == "__main__":
    main()
