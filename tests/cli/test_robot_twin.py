"""`drake-srg twin` as a command."""

import contextlib
import json
import subprocess
import sys
import threading
import time as wall

import numpy as np
import pytest
from helpers import NEEDS_DDS
from robot.serve.ros1.peers import Master
from robot.serve.ros2.peers import free_domain
from robot.serve.waiting import wait_until

from drake_srg.cli import main as cli
from drake_srg.cli.command import TASK_FAILED
from drake_srg.recording.rosbag import joint_states
from drake_srg.robot.serve.commands import CommandInbox, Warnings

pytestmark = pytest.mark.slow

HOME = [0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0]
BUS = "arm: !DynamixelArm {}\ngripper: !Ros2Gripper {}\n"
JOINTS = {
    "arm": [f"joint_{i}" for i in range(1, 8)],
    "gripper": [f"{side}_joint" for side in ("left_base", "right_base")]
    + [f"{side}_joint" for side in ("left_tip", "right_tip")],
}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["kitchen_fast"], "needs one of --ros1, --ros2 and --hardware"),
        (["kitchen_fast", "--ros1", "--ros2"], "needs one of --ros1, --ros2"),
        (["kitten", "--ros2"], "unknown scenario 'kitten'"),
        (["kitchen_fast", "--ros2", "--set", "twin.joint=0"], "twin.joint"),
        (["kitchen_fast", "--hardware", "missing.yaml"], "missing.yaml"),
        (["kitchen_fast", "--hardware", "bus.yaml"], "a bus has one master"),
    ],
)
def test_bad_input_is_reported_on_one_line(
    arguments, words, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bus.yaml").write_text(BUS)
    assert cli.main(["twin", *arguments, "--out", "out"]) == cli.BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith("drake-srg: ") and error.count("\n") == 1
    assert words in error
    assert not (tmp_path / "out").exists()


TOPIC = joint_states(JOINTS)


@contextlib.contextmanager
def ros1():
    """A robot that publishes its joints, and the twin's options."""
    from drake_srg.robot.serve.ros1.bridge import Ros1Bridge

    with contextlib.closing(Master()) as master:
        inbox = CommandInbox([], Warnings(print))
        bridge = Ros1Bridge(inbox, [TOPIC], master=master.uri, name="/robot")
        with contextlib.closing(bridge):
            assert wait_until(lambda: master.registered)
            master.publishers[TOPIC.name] = [master.node_uri]
            yield bridge, ["--ros1", "--master", master.uri]


@contextlib.contextmanager
def ros2():
    """The same by ROS 2."""
    from drake_srg.robot.serve.ros2.bridge import Ros2Bridge

    domain, inbox = free_domain(), CommandInbox([], Warnings(print))
    bridge = Ros2Bridge(inbox, [TOPIC], domain=domain, name="robot")
    with contextlib.closing(bridge):
        yield bridge, ["--ros2", "--domain", str(domain)]


@pytest.mark.parametrize("ros", [ros1, pytest.param(ros2, marks=NEEDS_DDS)])
def test_it_follows_a_robot_over_loopback_until_that_is_silent(ros, tmp_path):
    with ros() as (bridge, options):
        follow(bridge, options, tmp_path)


def follow(bridge, options, tmp_path):
    """Run a twin, and a robot whose fingers differ, until this is reported."""
    command = [sys.executable, "-m", "drake_srg", "twin", "kitchen_fast"]
    command += [*options, "--out", str(tmp_path)]
    # The twin's fingers stay open, the robot's do not.
    command += ["--set", "twin={silence: 2.0, settle: 0.2, patience: 0.2}"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    arm, fingers = np.append(HOME, np.zeros(7)), np.append(np.full(4, 0.5), np.zeros(4))
    lines, stamp, end = [], 5.0, wall.monotonic() + 100.0
    reader = threading.Thread(target=lambda: lines.extend(iter(process.stdout)))
    reader.start()
    try:
        # Until it has reported the fingers.
        while wall.monotonic() < end and "finger joint" not in "".join(lines):
            stamp += 0.02
            bridge.publish(TOPIC, stamp, [arm, None, fingers, None])
            wall.sleep(0.02)
        assert process.wait(100) == TASK_FAILED
    finally:
        process.kill()
        reader.join()
    output = "".join(lines)
    assert "the robot is silent after" in output
    assert "1 difference reported" in output
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["ended"] == "silent"
    assert [parting["kind"] for parting in metrics["partings"]] == ["finger"]
    assert metrics["sim_time_s"] > 0.2
    for file in ("recording.mcap", "log.npz", "timeline.png", "replay.html"):
        assert (tmp_path / file).stat().st_size > 0
