"""Goals over DDS, with a server that does not use the package."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from helpers import LACKS_DDS, NO_DDS

from drake_srg.robot.drive.arm import GoalStream
from drake_srg.robot.drive.link import Nodes
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.connecting import Ros1Config, Ros2Config
from robot.serve.ros2.peers import free_domain
from robot.serve.waiting import wait_until

pytestmark = pytest.mark.skipif(LACKS_DDS, reason=NO_DDS)
TESTS = Path(__file__).parents[2]
ACTION = "/arm/follow"
LEAD, PERIOD = 0.1, 0.005


class Wire:
    """A stream of goals of two joints, and the process that serves them."""

    def __init__(self, domain, joints):
        self.told = []
        warnings = Warnings(self.told.append)
        self.nodes = Nodes(Ros1Config(), Ros2Config(domain=domain), warnings)
        self.stream = GoalStream(
            self.nodes.of(2), ACTION, joints, LEAD, PERIOD, warnings
        )
        self.nodes.open()
        program = TESTS / "robot" / "serve" / "ros2" / "action_peer.py"
        self.process = subprocess.Popen(
            [sys.executable, program, str(domain), ACTION],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(TESTS)},
        )
        self.line()
        assert wait_until(lambda: self.stream._send.there)
        time.sleep(0.2)  # until its writers know our readers, too

    def line(self):
        line = self.process.stdout.readline()
        assert line, "the peer has ended"
        return json.loads(line)

    def step(self, stamp, q):
        self.stream.send(np.array(q), stamp, stopped=False)

    def close(self):
        self.stream.close()
        self.nodes.close()
        with self.process:
            self.process.stdin.close()


@pytest.fixture
def wire(request):
    wire = Wire(free_domain(), request.param)
    yield wire
    wire.close()


@pytest.mark.parametrize("wire", [["a", "b"]], indirect=True)
def test_goals_arrive_and_results_come_back(wire):
    for i in range(3):
        wire.step(100.0 + i * PERIOD, [0.1 * i, 1.0])  # the first is a goal by itself
    kind, goal = wire.line()
    assert kind == "goal"
    assert goal["joint_names"] == ["a", "b"]
    assert goal["header"]["stamp"] == {"sec": 100, "nanosec": 100_000_000}
    assert goal["points"][0]["positions"] == [0.0, 1.0]
    # Such a goal of one point is aborted.
    assert wait_until(lambda: wire.stream.fails)
    (told,) = wire.told
    assert told.startswith(f"{ACTION}: a goal was aborted (PATH_TOLERANCE_VIOLATED)")
    assert "joint a" in told


@pytest.mark.parametrize("wire", [["x", "b"]], indirect=True)
def test_a_rejection_arrives(wire):
    wire.step(100.0, [0.0, 1.0])
    assert wait_until(lambda: wire.stream.fails)
    assert wire.told == [f"{ACTION}: a goal was rejected; the arm is stopped"]


@pytest.mark.parametrize("wire", [["a", "b"]], indirect=True)
def test_a_server_that_leaves_is_noticed(wire):
    wire.process.stdin.close()
    wire.process.wait(10.0)

    def step():
        wire.step(100.0, [0.0, 1.0])
        return wire.stream.fails

    assert wait_until(step)
    assert f"{ACTION}: the action server has gone; the arm is stopped" in wire.told
