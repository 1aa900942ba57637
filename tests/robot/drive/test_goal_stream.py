"""An arm that is driven by an action, with a server that the test answers for."""

import itertools

import numpy as np
import pytest

from drake_srg.robot.drive.arm import Ros2Arm
from drake_srg.robot.serve.action_server import (
    ErrorCode,
    FollowJointTrajectory,
    GoalStatus,
)
from robot.drive.stand import HOME, PERIOD, FakeNode, joint_state, make

ACTION = FollowJointTrajectory("/arm/follow")
ARM = [f"iiwa_joint_{i}" for i in range(1, 8)]
LEAD = 0.1
# By the robot's clock, how long a reply may be missing.
PATIENCE = 1.0


class FakeServer:
    """A node with an action server that does to each goal what the test says."""

    def __init__(self, **link):
        self.node = FakeNode()
        config = Ros2Arm(stream="action", action=ACTION.name, lead=LEAD, **link)
        self.link = config.connect(self.node.robot())
        self.time, self.goals, self.canceled = 10.0, [], []
        self.accepts, self.answers = True, True
        self._asked = {}  # request for the result by goal
        self._read = 0

    def step(self, q, stopped=False):
        """Publish the joints' state, and pass the link a command a period later."""
        self.time += PERIOD
        state = joint_state(self.time, ARM, HOME, np.zeros(7))
        assert self.node.deliver("/joint_states", state) == []
        commands = {
            "arm.position_commanded": q,
            "gripper.hold": np.array([float(stopped)]),
        }
        self.link.send(commands)
        self.serve()

    def serve(self):
        """Read what was sent, and answer it."""
        while self._read < len(self.node.sent):
            topic, message = self.node.sent[self._read]
            self._read += 1
            if topic.name == ACTION.send_goal.request:
                self.goals.append(message)
                if self.answers:
                    self.answer(message)
            elif topic.name == ACTION.get_result.request:
                self._asked[bytes(message.goal_id.uuid)] = message
            elif topic.name == ACTION.cancel_goal.request:
                self.canceled.append(bytes(message.goal_info.goal_id.uuid))

    def answer(self, request):
        stamp = make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
        self._reply(ACTION.send_goal, request, accepted=self.accepts, stamp=stamp)

    def end(self, goal, status, code=ErrorCode.SUCCESSFUL, text=""):
        self._reply(
            ACTION.get_result,
            self._asked[bytes(goal.goal_id.uuid)],
            status=int(status),
            error_code=int(code),
            error_string=text,
        )

    def _reply(self, service, request, client=None, **fields):
        client = request.client if client is None else client
        reply = make(service.reply_type, client=client, number=request.number, **fields)
        assert self.node.deliver(service.reply, reply) == []

    def move(self, seconds):
        """Move at a constant speed."""
        for i in range(round(seconds / PERIOD)):
            self.step(HOME + 0.001 * (i + 1))

    def rest(self, seconds, q=HOME, **stopped):
        for _ in range(round(seconds / PERIOD)):
            self.step(q, **stopped)

    @property
    def obeys(self):
        """Whether the link still delivers."""
        return bool(self.link.take())


def ids(goals):
    return [bytes(goal.goal_id.uuid) for goal in goals]


def span(goal):
    """First and last time of a goal's trajectory."""
    stamp = goal.trajectory.header.stamp
    begin = stamp.sec + 1e-9 * stamp.nanosec
    last = goal.trajectory.points[-1].time_from_start
    return begin, begin + last.sec + 1e-9 * last.nanosec


def test_a_motion_becomes_two_goals_per_lead_that_overlap():
    server = FakeServer()
    server.move(1.0)
    assert len(server.goals) == 20
    spans = [span(goal) for goal in server.goals[1:]]
    for (_, end), (begin, next_end) in itertools.pairwise(spans):
        assert begin < end - 0.5 * LEAD + 1e-6
        assert next_end > end
    goal = server.goals[-1]
    assert goal.trajectory.joint_names == ARM
    assert server.obeys and server.node.told == []


def test_goals_are_pieces_of_one_path():
    server = FakeServer()
    server.move(0.5)
    known = {}
    for goal in server.goals:
        begin, _ = span(goal)
        for point in goal.trajectory.points:
            since = point.time_from_start
            time = round(begin + since.sec + 1e-9 * since.nanosec, 6)
            q = known.setdefault(time, np.array(point.positions))
            np.testing.assert_array_equal(q, point.positions)
    path = np.array([known[time][0] for time in sorted(known)])
    assert np.all(np.diff(path) > 0.0)


def test_a_resting_arm_gets_no_goals():
    server = FakeServer()
    server.move(0.2)
    server.rest(0.2, HOME + 0.04)
    count = len(server.goals)
    np.testing.assert_allclose(
        server.goals[-1].trajectory.points[-1].positions, HOME + 0.04
    )
    server.end(server.goals[-1], GoalStatus.SUCCEEDED)
    server.rest(5.0, HOME + 0.04)
    assert len(server.goals) == count
    assert server.obeys and server.canceled == []


def test_goals_that_others_replace_may_end_as_they_like_or_not_at_all():
    # joint_trajectory_controller cancels them with INVALID_GOAL.
    server = FakeServer()
    server.move(0.3)
    for goal in server.goals[:-1]:
        server.end(goal, GoalStatus.CANCELED, ErrorCode.INVALID_GOAL)
    server.move(3.0 * PATIENCE)
    assert server.obeys and server.node.told == []


def fail(server, reason):
    """Check that the arm obeys no more, and why; return the number of goals."""
    (told,) = server.node.told
    assert told == f"/arm/follow: {reason}; the arm is stopped"
    assert not server.obeys
    server.serve()
    count = len(server.goals)
    server.move(0.5)
    assert len(server.goals) == count
    assert not server.obeys
    return count


def test_a_rejected_goal_stops_the_arm_and_cancels_the_one_before():
    server = FakeServer()
    server.move(0.1)
    before = ids(server.goals)
    server.accepts = False
    server.move(0.1)
    fail(server, "a goal was rejected")
    assert server.canceled == before


def test_a_goal_that_comes_too_late_is_followed_by_another():
    server = FakeServer()
    server.move(0.1)
    server.answers = False
    server.step(HOME + 0.5)
    server.rest(2.0 * LEAD, HOME + 0.5)
    late = server.goals[-1]
    server.answers, server.accepts = True, False
    server.answer(late)
    server.accepts = True
    server.rest(0.1, HOME + 0.5)
    (told,) = server.node.told
    assert told.startswith("/arm/follow: a goal came too late")
    assert span(server.goals[-1])[1] > span(late)[1]
    assert server.obeys


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        (
            (GoalStatus.ABORTED, ErrorCode.PATH_TOLERANCE_VIOLATED, "joint 3"),
            "a goal was aborted (PATH_TOLERANCE_VIOLATED): joint 3",
        ),
        (
            (GoalStatus.ABORTED, ErrorCode.INVALID_GOAL, "joint 3"),
            "a goal was aborted (INVALID_GOAL): joint 3",
        ),
        (
            (GoalStatus.CANCELED, ErrorCode.SUCCESSFUL, "by hand"),
            "a goal was canceled (SUCCESSFUL): by hand",
        ),
    ],
)
def test_a_goal_that_does_not_succeed_stops_the_arm(end, reason):
    server = FakeServer()
    server.move(0.2)
    server.end(server.goals[-1], *end)
    fail(server, reason)
    assert ids(server.goals)[-1] not in server.canceled


def test_a_violation_counts_even_if_a_newer_goal_is_on_its_way():
    server = FakeServer()
    server.move(0.2)
    code = ErrorCode.PATH_TOLERANCE_VIOLATED
    server.end(server.goals[-2], GoalStatus.ABORTED, code)
    fail(server, "a goal was aborted (PATH_TOLERANCE_VIOLATED): no reason given")
    assert ids(server.goals)[-1] in server.canceled


def test_a_server_that_is_silent_stops_a_moving_arm():
    server = FakeServer()
    server.move(0.2)
    server.answers = False
    server.move(LEAD + PATIENCE - 0.05)
    assert server.obeys
    server.move(0.2)
    fail(server, "a goal was not answered")


def test_a_result_that_never_comes_stops_a_resting_arm():
    server = FakeServer()
    server.move(0.2)
    server.rest(PATIENCE, HOME + 0.04)
    assert server.obeys
    server.rest(LEAD + 0.05, HOME + 0.04)
    fail(server, "a goal has ended without a result")


def test_a_server_that_goes_away_stops_the_arm():
    server = FakeServer()
    server.move(0.2)
    server.node.heard = False
    server.move(PERIOD)
    fail(server, "the action server has gone")


def test_the_server_is_waited_for_at_the_start():
    server = FakeServer()
    server.node.heard = False
    server.rest(0.5)
    assert server.obeys and server.goals == []
    server.node.heard = True
    server.rest(0.1)
    assert len(server.goals) == 1


def test_a_server_that_is_not_there_is_told():
    server = FakeServer()
    server.node.heard = False
    server.rest(PATIENCE + 0.1)
    fail(server, "no action server found")


def test_what_a_stop_leaves_of_the_goals_is_canceled():
    server = FakeServer()
    server.move(0.2)
    server.rest(LEAD + 0.02, HOME + 0.04, stopped=True)
    assert server.canceled == ids(server.goals)
    server.end(server.goals[-1], GoalStatus.CANCELED)
    server.rest(3.0 * PATIENCE, HOME + 0.04, stopped=True)
    assert server.obeys and server.node.told == []
    count = len(server.goals)
    server.move(0.2)  # released
    assert len(server.goals) > count and server.obeys


def test_goals_are_canceled_when_the_link_closes():
    server = FakeServer()
    server.move(0.2)
    server.end(server.goals[0], GoalStatus.CANCELED)
    server.link.close()
    server.link.close()
    server.serve()
    assert server.canceled == ids(server.goals[1:])


def test_replies_to_others_are_none_of_ours():
    server = FakeServer()
    server.answers, server.accepts = False, False
    server.move(0.05)
    (request,) = server.goals
    other = (request.client + 1) % 2**64
    stamp = make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
    server._reply(ACTION.send_goal, request, client=other, accepted=False, stamp=stamp)
    assert server.obeys and server.node.told == []
