import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers import NEEDS_DDS

from drake_srg.recording import rosbag
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from robot.serve.ros2.peers import command_topics, free_domain
from robot.serve.waiting import wait_until

pytestmark = [pytest.mark.slow, NEEDS_DDS]

EXAMPLE = Path(__file__).parents[4] / "examples" / "ros2_client.py"


def test_the_example_closes_and_opens_the_gripper():
    from drake_srg.robot.serve.ros2.bridge import Ros2Bridge

    inbox = CommandInbox(command_topics(), Warnings(print))
    joints = ["joint_1", "left_base_joint", "right_base_joint"]
    topic = rosbag.joint_states({"gripper": joints})
    bridge = Ros2Bridge(inbox, [topic], domain=free_domain())
    client = subprocess.Popen(
        [sys.executable, "-u", EXAMPLE],
        env={**os.environ, "ROS_DOMAIN_ID": str(bridge.domain)},
        stdout=subprocess.PIPE,
        text=True,
    )
    closure = 0.0

    def serve():
        nonlocal closure
        closure = inbox.take().get("/grasp", [closure])[0]
        state = np.array([9.0, 0.01 * closure, 0.02 * closure, 0.0, 0.0, 0.0])
        bridge.publish(topic, 0.0, [state, None])
        return client.poll() is not None

    assert wait_until(serve, timeout=20.0) or client.kill()
    bridge.close()
    output, _ = client.communicate()
    assert client.returncode == 0
    assert inbox.received == 2
    closed, opened = output.split("grasp 0\n")
    assert closed.count("left_base_joint 1.00 rad, right_base_joint 2.00 rad") == 3
    assert opened.count("left_base_joint 0.00 rad, right_base_joint 0.00 rad") == 3
