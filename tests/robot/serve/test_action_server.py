"""A served arm and the driver of `!Ros2Arm {stream: action}`, with no wire between."""

import functools

import numpy as np
import pytest

from drake_srg.robot.drive.arm import duration, joint_trajectory
from drake_srg.robot.serve.action_server import (
    ACTION,
    ActionServer,
    CancelCode,
    ErrorCode,
    GoalStatus,
    goal_fields,
    goal_id,
    goal_info,
)
from drake_srg.robot.serve.bridge import Outlet
from drake_srg.robot.serve.commands import TRAJECTORY, CommandInbox, Warnings
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant
from experiments.stands.direct_node import DirectBridge, DirectNode
from experiments.stands.direct_node import make_message as make

PERIOD = 0.005
JOINTS = [f"joint_{i}" for i in range(1, 8)]
HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])


@functools.cache
def plant():
    return MakeModelsPlant(load_scenario("kitchen"))


def tolerance(joint, position):
    return make(
        "control_msgs/msg/JointTolerance",
        name=joint,
        position=position,
        velocity=0.0,
        acceleration=0.0,
    )


class Served:
    """A server whose arm is where the test says, and its client."""

    def __init__(self):
        self.told, self.time = [], 0.995
        self.node = DirectNode()
        self.replies, self.statuses = {}, []
        for service in (ACTION.send_goal, ACTION.cancel_goal, ACTION.get_result):
            self.node.subscribe(
                service.reply, "", functools.partial(self._keep, service)
            )
        self.node.subscribe(ACTION.status, "", self.statuses.append)
        self.server = ActionServer(plant(), PERIOD)
        requests, _ = self.server.topics
        warnings = Warnings(self.told.append)
        self.inbox = CommandInbox(requests, warnings)
        self.server.connect(self.inbox, Outlet([DirectBridge(self.node)], warnings))
        self._numbers = 0
        self.advance()

    def _keep(self, service, reply):
        self.replies[service, reply.number] = reply

    def advance(self, seconds=PERIOD, q=HOME, commanded=HOME):
        for _ in range(round(seconds / PERIOD)):
            self.time += PERIOD
            self.server.advance(self.time, np.append(q, np.zeros(7)), commanded)

    def call(self, service, **fields):
        """Send a request; return the function that reads its reply."""
        self._numbers += 1
        key = service, self._numbers
        request = make(service.request_type, client=7, number=key[1], **fields)
        self.inbox.receive_message(service.request, request)
        return lambda: self.replies.get(key)

    def goal(self, id, q=HOME, *, start=0.0, length=1.0, joints=JOINTS, **fields):
        trajectory = joint_trajectory("", joints).convert(
            make, 0.0, np.array([0.0, length]), np.stack([HOME, q])
        )
        trajectory.header.stamp.sec = int(start)
        given = goal_fields(make, id, trajectory) | fields
        accepted = self.call(ACTION.send_goal, **given)
        result = self.call(ACTION.get_result, goal_id=goal_id(make, id))
        self.advance()
        return accepted().accepted, result

    def cancel(self, id, time=0.0):
        reply = self.call(ACTION.cancel_goal, goal_info=goal_info(make, id, time))
        self.advance()
        return reply()


def end(result):
    reply = result()
    return GoalStatus(reply.status), ErrorCode(reply.error_code)


A, B = bytes([1] * 16), bytes([2] * 16)
SUCCEEDED = GoalStatus.SUCCEEDED, ErrorCode.SUCCESSFUL


def test_a_goal_moves_the_arm_and_succeeds_when_its_time_is_over():
    served = Served()
    accepted, result = served.goal(A)
    assert accepted
    assert TRAJECTORY in served.inbox.take()
    served.advance(0.9)
    assert result() is None
    served.advance(0.2)
    assert end(result) == SUCCEEDED
    statuses = [message.status_list[0].status for message in served.statuses]
    assert statuses == [GoalStatus.EXECUTING, GoalStatus.SUCCEEDED]


@pytest.mark.parametrize(
    "goal, reason",
    [
        ({"joints": ["x", *JOINTS[1:]]}, "needs the joints joint_1"),
        ({"q": HOME + 9.0}, "number 1 must be"),
        ({"q": np.full(7, np.nan)}, "needs finite numbers"),
        ({"length": 0.0}, "needs points in the order of their times"),
        ({"start": 1.0, "length": 0.001}, "ended at 1.001 s, and now it is 1.005 s"),
    ],
)
def test_what_is_rejected(goal, reason):
    served = Served()
    accepted, result = served.goal(A, **goal)
    assert not accepted
    (told,) = served.told
    assert reason in told and told.startswith(ACTION.name)
    assert end(result)[0] == GoalStatus.UNKNOWN
    assert TRAJECTORY not in served.inbox.take()


def test_a_new_goal_replaces_the_one_before():
    served = Served()
    _, first = served.goal(A)
    _, second = served.goal(B)
    assert end(first) == (GoalStatus.CANCELED, ErrorCode.INVALID_GOAL)
    served.advance(1.1)
    assert end(second) == SUCCEEDED


def test_joints_that_leave_the_path_abort_the_goal():
    served = Served()
    _, result = served.goal(A, path_tolerance=[tolerance(JOINTS[2], 0.1)])
    served.inbox.take()
    served.advance(0.1, q=HOME + 0.09)
    assert result() is None
    served.advance(q=HOME + 0.11)
    assert end(result) == (GoalStatus.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED)
    assert result().error_string == "joint_3 is 0.11 away"
    assert TRAJECTORY in served.inbox.take()  # it stays where it is


@pytest.mark.parametrize(
    ("patience", "late", "ended"),
    [
        (0.5, 0.6, (GoalStatus.ABORTED, ErrorCode.GOAL_TOLERANCE_VIOLATED)),
        (0.0, 4.0, None),  # for ever
    ],
)
def test_joints_may_arrive_late_by_the_goal_s_tolerance(patience, late, ended):
    served = Served()
    _, result = served.goal(
        A,
        goal_tolerance=[tolerance(JOINTS[0], 0.1)],
        goal_time_tolerance=duration(make, patience),
    )
    served.advance(1.4, q=HOME + 0.2)
    assert result() is None
    served.advance(late - 0.4, q=HOME + 0.2)
    if ended is None:
        assert result() is None
        served.advance()
    assert end(result) == (ended or SUCCEEDED)


@pytest.mark.parametrize("id, time", [(A, 0.0), (bytes(16), 0.0), (bytes(16), 50.0)])
def test_a_goal_can_be_canceled(id, time):
    served = Served()
    _, result = served.goal(A)
    served.inbox.take()
    reply = served.cancel(id, time)
    assert reply.return_code == CancelCode.NONE
    (info,) = reply.goals_canceling
    assert bytes(info.goal_id.uuid) == A
    assert end(result) == (GoalStatus.CANCELED, ErrorCode.SUCCESSFUL)
    assert TRAJECTORY in served.inbox.take()  # it stays where it is


def test_without_a_stamp_only_the_named_goal_is_canceled():
    served = Served()
    served.time = -PERIOD
    _, result = served.goal(A)  # accepted at t = 0
    assert served.cancel(B).return_code == CancelCode.UNKNOWN_GOAL_ID
    assert result() is None
    assert served.cancel(B, 0.1).goals_canceling  # A began before
    assert end(result) == (GoalStatus.CANCELED, ErrorCode.SUCCESSFUL)


def test_what_cannot_be_canceled():
    served = Served()
    served.goal(A)
    assert served.cancel(B).return_code == CancelCode.UNKNOWN_GOAL_ID
    served.advance(1.1)
    assert served.cancel(A).return_code == CancelCode.GOAL_TERMINATED
    assert served.cancel(bytes(16)).goals_canceling == []


def test_a_request_waits_until_its_client_can_hear_the_reply():
    served = Served()
    hears, served.node.hears = served.node.hears, lambda topic: False
    with pytest.raises(AttributeError):  # there is no reply yet
        served.goal(A)
    assert TRAJECTORY not in served.inbox.take()
    served.node.hears = hears
    served.advance()
    assert served.replies[ACTION.send_goal, 1].accepted
    assert TRAJECTORY in served.inbox.take()
    served.node.hears = lambda topic: False
    with pytest.raises(AttributeError):
        served.goal(B)
    served.advance(0.2)
    served.node.hears = hears
    served.inbox.take()
    served.advance()
    assert TRAJECTORY not in served.inbox.take()  # too late
