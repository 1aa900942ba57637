"""Goals over DDS, with a server that does not use the package."""

import time

import numpy as np
import pytest
from helpers import LACKS_DDS, NO_DDS

from drake_srg.robot.drive.arm import GoalStream
from drake_srg.robot.drive.link import Nodes
from drake_srg.robot.serve.action_server import FollowJointTrajectory
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.connecting import Ros1Config, Ros2Config
from robot.serve.ros2.peers import CyclonePeer, free_domain
from robot.serve.waiting import wait_until

pytestmark = pytest.mark.skipif(LACKS_DDS, reason=NO_DDS)

ACTION = FollowJointTrajectory("/arm/follow")
LEAD, PERIOD = 0.1, 0.005


class Wire:
    """A stream of goals of two joints, and the process that serves them."""

    def __init__(self, domain):
        self.told = []
        warnings = Warnings(self.told.append)
        self.nodes = Nodes(Ros1Config(), Ros2Config(domain=domain), warnings)
        self.stream = GoalStream(
            self.nodes.of(2), ACTION.name, ["a", "b"], LEAD, PERIOD, warnings
        )
        self.nodes.open()
        self.peer = CyclonePeer(domain)
        for service in (ACTION.send_goal, ACTION.get_result, ACTION.cancel_goal):
            self.peer.subscribe(service.request, service.request_type.split("/")[2])
            self.peer.advertise(service.reply, service.reply_type.split("/")[2])
        assert wait_until(lambda: self.stream._send.there)
        time.sleep(0.2)  # until its writers know our readers, too

    def asked(self, service):
        """Return the next request of a service."""
        (request,) = wait_until(lambda: self.peer.take(service.request))
        return request

    def reply(self, service, request, **fields):
        call = {name: request[name] for name in ("client", "number")}
        self.peer.publish(service.reply, call | fields)

    def step(self, stamp=100.0):
        self.stream.send(np.array([0.0, 1.0]), stamp, stopped=False)

    def goal(self, accepted):
        """Send a goal, and let the server accept or reject it."""
        self.step()
        goal = self.asked(ACTION.send_goal)
        stamp = {"sec": 1, "nanosec": 2}
        self.reply(ACTION.send_goal, goal, accepted=accepted, stamp=stamp)
        return goal

    def close(self):
        self.stream.close()
        self.nodes.close()
        self.peer.close()


@pytest.fixture
def wire():
    wire = Wire(free_domain())
    yield wire
    wire.close()


def test_goals_arrive_and_results_come_back(wire):
    goal = wire.goal(accepted=True)
    trajectory = goal["trajectory"]
    assert trajectory["joint_names"] == ["a", "b"]
    assert trajectory["header"]["stamp"] == {"sec": 100, "nanosec": 100_000_000}
    assert trajectory["points"][0]["positions"] == [0.0, 1.0]
    asked = wire.asked(ACTION.get_result)
    assert asked["goal_id"] == goal["goal_id"]
    ended = {"status": 6, "error_code": -4, "error_string": "joint a"}
    wire.reply(ACTION.get_result, asked, **ended)
    assert wait_until(lambda: wire.stream.fails)
    assert wire.told == [
        f"{ACTION.name}: a goal was aborted (PATH_TOLERANCE_VIOLATED): joint a; "
        "the arm is stopped"
    ]


def test_a_goal_is_canceled_when_the_stream_closes(wire):
    goal = wire.goal(accepted=True)
    wire.asked(ACTION.get_result)
    wire.stream.close()
    assert wire.asked(ACTION.cancel_goal)["goal_info"]["goal_id"] == goal["goal_id"]
