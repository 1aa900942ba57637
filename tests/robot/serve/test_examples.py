"""The clients in examples/."""

import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers import NEEDS_DDS

from drake_srg.recording import rosbag
from drake_srg.robot.serve.commands import CommandInbox, CommandTopic, Warnings
from drake_srg.robot.serve.ros1.bridge import Ros1Bridge
from drake_srg.scenario import load_scenario
from robot.serve.dynamixel.fake_station import FakeStation
from robot.serve.ros2.peers import command_topics, free_domain
from robot.serve.waiting import wait_until

SERVO, KITCHEN, ROS2, HANDS = (
    Path(__file__).parents[3] / "examples" / f"{name}_client.py"
    for name in ("servo", "ros1_kitchen", "ros2", "dex1")
)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [([], "usage: servo_client.py DEVICE"), (["none"], "none: No such file or dir")],
)
def test_a_missing_device_is_one_line(arguments, message):
    command = [sys.executable, str(SERVO), *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    (line,) = ended.stderr.splitlines()
    assert line.startswith(message)


@pytest.mark.slow
def test_the_example_finds_the_fingers_meeting():
    with FakeStation("pty", protocol=2) as station:
        command = [
            sys.executable,
            str(SERVO),
            station.bridge.address,
        ]
        ended = subprocess.run(
            command, capture_output=True, text=True, timeout=60, check=True
        )
    meeting, opened, closed, *samples = ended.stdout.splitlines()
    assert meeting == "the fingers meet at 1473 counts"
    assert opened == "asked for 50 %, stopped at 50 %"
    assert closed == "asked for -10 %, stopped at 0 %"
    # 15 % of the PWM of 4.1 A.
    assert samples == ["  -0.61 A, 30 degrees Celsius, errors 0"] * 3
    assert station.warnings == []


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("ros1_kitchen_client", KITCHEN)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_the_client_sends_the_messages_of_the_scenario(example):
    played = load_scenario("thesis_kitchen").planner.messages

    def entry(message):
        if message.grasp is not None:
            return {"grasp": message.grasp}
        return {"kuka": message.kuka, "count": message.count}

    routines = {name: [*map(entry, r)] for name, r in played.routines.items()}
    assert routines == example.ROUTINES
    assert [call.routine for call in played.sequence] == example.SEQUENCE
    sent = [m for routine in example.SEQUENCE for m in example.messages(routine)]
    assert len(sent) == played.number()


@pytest.mark.slow
@pytest.mark.ros
def test_every_message_arrives_in_order(example, own_roscore, told):
    own_roscore.start()  # one that knows no nodes of other tests
    received = []

    def keep(topic):
        def convert(data):
            received.append((topic, np.asarray(data).tolist()))
            return {}

        return convert

    inbox = CommandInbox(
        [
            CommandTopic("/kuka", "std_msgs/msg/Float64MultiArray", keep("/kuka")),
            CommandTopic("/grasp", "std_msgs/msg/Int32", keep("/grasp")),
        ],
        Warnings(told.append),
    )
    with contextlib.closing(Ros1Bridge(inbox, [], master=own_roscore.uri)):
        # A hundred times as fast as in the thesis.
        printed = own_roscore.run("/usr/bin/python3", KITCHEN, "--rate", "2500")
        sent = [m for routine in example.SEQUENCE for m in example.messages(routine)]
        assert wait_until(lambda: inbox.received == len(sent)), printed
    for topic in ("/kuka", "/grasp"):
        assert [d for t, d in received if t == topic] == [
            pytest.approx(d) for t, d in sent if t == topic
        ]
    assert told == []


@pytest.mark.slow
@NEEDS_DDS
def test_the_ros_2_client_closes_and_opens_the_gripper():
    from drake_srg.robot.serve.ros2.bridge import Ros2Bridge

    inbox = CommandInbox(command_topics(), Warnings(print))
    joints = ["joint_1", "left_base_joint", "right_base_joint"]
    topic = rosbag.joint_states({"gripper": joints})
    bridge = Ros2Bridge(inbox, [topic], domain=free_domain())
    client = subprocess.Popen(
        [sys.executable, "-u", ROS2],
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


@NEEDS_DDS
@pytest.mark.slow
def test_the_example_closes_and_opens_both_hands():
    domain = str(free_domain())
    serve = [sys.executable, "-m", "drake_srg", "serve", "gripper_bench_fast"]
    options = ["--dex1", "left,right", "--domain", domain, "--no-record", "--rate", "0"]
    # One step of the plant per control period: nothing is in the hands.
    longer = ["--set", "object.present=false", "--set", "plant_config.time_step=0.005"]
    served = subprocess.Popen(
        [*serve, *options, *longer],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    clients = []
    try:
        clients += [
            subprocess.Popen(
                [sys.executable, str(HANDS), side, domain],
                stdout=subprocess.PIPE,
                text=True,
            )
            for side in ("left", "right")
        ]

        def ended():
            return served.poll() is not None or None not in [c.poll() for c in clients]

        # The clients would wait on for a server that has ended.
        assert wait_until(ended, timeout=300.0), "the clients do not end"
        assert served.poll() is None, served.stderr.read()
        for client in clients:
            out, _ = client.communicate()
            assert client.returncode == 0
            closed, opened = out.splitlines()
            # An empty hand; the spool stops a little before 0 %.
            assert -1.0 < float(closed.partition("%")[0]) < 5.0, closed
            assert 47.0 < float(opened.partition("%")[0]) < 53.0, opened
    finally:
        for client in clients:
            client.kill()
        served.send_signal(signal.SIGINT)
        out, errors = served.communicate(timeout=60)
    assert served.returncode == 0, errors
    assert "Traceback" not in errors
    assert sum(line.startswith("served ") for line in out.splitlines()) == 2
