"""Experiments that talk to a served station: all but the simulation."""

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.drive.arm import Ros1Arm, Ros2Arm
from drake_srg.robot.drive.config import parse_hardware
from drake_srg.robot.drive.dynamixel.drivers import DynamixelArm, DynamixelGripper
from drake_srg.robot.drive.gripper import Ros2Gripper
from drake_srg.scenario import load_scenario
from experiments.bridge_load import Change, find_delays
from experiments.hardware_loop import (
    WAYS,
    Way,
    cases,
    check_speed,
    hardware_loop,
    robot_file,
)
from experiments.runner.claims import Trials
from experiments.stands.bridge_client import ServedProcess, open_wire
from experiments.thesis_messages import demonstrate, messages

CLEAN, FAULTY = "kitchen, ROS 2", "5 % lost"
GOOD = {
    "placed": True,
    "claimed": True,
    "told": "",
    "error": 1.0,
    "rounding": 0.0,
    "held_up": 0.1,
    "inside": 0.6,
}
TOLD = GOOD | {"placed": False, "claimed": False, "told": "stale", "error": 200.0}


def parsed(way, arguments=("--ros2", "--domain", "9"), rate=1.0):
    scenario = load_scenario(way.scenario, seed=3, overrides=way.settings)
    text = robot_file(way, scenario, arguments, 4001, rate)
    return parse_hardware(text, "robot.yaml")


def failed(way, *outcomes):
    rows = hardware_loop.judge(Trials([{"way": way} | each for each in outcomes]))
    return {row.quantity for row in rows if not row.passed}


def test_a_delay_ends_when_the_joint_leaves_its_rest():
    positions = [(0.0, 0.0), (0.0, 0.0), (1e-7, 0.0), (0.01, 0.0), (0.01, 0.5)]
    published = [(10.0 + 0.1 * i, np.array(q)) for i, q in enumerate(positions)]
    changes = [
        Change(time=10.15, joint=0, rest=0.0),
        Change(time=10.25, joint=1, rest=0.0),
        Change(time=10.35, joint=0, rest=0.01),  # never leaves it
    ]
    delays = find_delays(published, changes)
    np.testing.assert_allclose(delays, [0.05, 0.15, np.nan])


def test_a_missing_roscore_is_told_with_the_command_that_installs_it(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("PATH", str(tmp_path))
    message = "^thesis_messages: needs a roscore: sudo apt-get"
    with (
        pytest.raises(ScenarioError, match=message),
        open_wire("ROS 1", "thesis_messages"),
    ):
        pass


@pytest.mark.slow
def test_a_station_that_cannot_be_served_reports_why():
    with pytest.raises(ScenarioError, match="!SrgTendonDriver"):
        ServedProcess("kitchen", "--no-record", "--servo", "pty")


def test_the_messages_are_those_of_the_thesis():
    sent = list(messages(load_scenario("thesis_kitchen")))
    assert len(sent) == 5752
    topics = [next(iter(message)) for message in sent]
    assert topics.count("/kuka") == 5752 - 2002
    grip = [m["/grasp"] for m in sent if "/grasp" in m]
    assert grip == [i // 10 for i in [*range(1001), *range(1000, -1, -1)]]
    np.testing.assert_allclose(
        np.rad2deg(sent[500]["/kuka"]), [5, -71, 0, 110, 0, 90, 0]
    )


@pytest.mark.slow
def test_a_short_demonstration_leaves_the_can_in_place():
    overrides = ["planner.messages.rate=500", "planner.messages.rest=0.3"]
    overrides += ["planner.messages.sequence=[{routine: closehalf, mode: close}]"]
    one = demonstrate("thesis_kitchen", "ROS 2", overrides)
    assert one["sent"] == one["messages received []"] == 501
    assert one["distance from its original place [mm]"] < 1.0
    assert one["tilt at the end [degrees]"] < 1.0


def test_the_hardware_file_says_what_is_served():
    way = Way("kitchen_fast", wire="ROS 1", lead=0.1, latency=0.02)
    config = parsed(way, ("--ros1", "--master", "http://x:1"))
    assert isinstance(config.arm, Ros1Arm)
    assert config.arm.lead == 0.1
    assert config.ros1.master == "http://x:1"
    assert config.faults.latency == pytest.approx(0.02)
    assert config.faults.seed == 3
    config = parsed(Way("kitchen_fast"), rate=0.5)
    assert isinstance(config.gripper, Ros2Gripper)
    assert (config.ros2.domain, config.rate) == (9, 0.5)
    assert list(config.cameras) == ["ceiling"]
    assert parsed(WAYS["kitchen_fast, action"]).arm.stream == "action"


def test_servos_may_be_on_a_bus():
    config = parsed(WAYS["kitchen_tendon, gripper by servo"])
    assert isinstance(config.arm, Ros2Arm)
    assert isinstance(config.gripper, DynamixelGripper)
    assert (config.gripper.open, config.gripper.stretch) == (3298, 1354)
    config = parsed(WAYS["assistive_arm, servo bus"])
    assert isinstance(config.arm, DynamixelArm)
    assert config.arm.port == config.gripper.port == "tcp:127.0.0.1:4001"
    found = config.gripper.id, config.gripper.open, config.gripper.closed
    assert found == (6, 2048, 2498)


def test_the_camera_of_a_visual_servo_has_topics_of_its_own():
    cameras = parsed(WAYS["moving tray"]).cameras
    assert cameras["ceiling"].color == "/camera/color/image_raw"
    assert cameras["hand"].color == "/camera_hand/color/image_raw"
    assert cameras["hand"].info == "/camera_hand/color/camera_info"


def test_a_clean_wire_places_every_object_and_a_faulty_one_may_say_why_not():
    assert not failed(CLEAN, GOOD, GOOD)
    assert failed(CLEAN, GOOD, TOLD) == {"placed, of 2"}
    assert not failed(FAULTY, GOOD, TOLD)
    silent = TOLD | {"told": ""}
    assert failed(FAULTY, silent) == {"neither placed nor told why"}


@pytest.mark.parametrize("way", [CLEAN, FAULTY])
def test_nothing_may_be_claimed_that_is_not_so(way):
    assert "claimed, but not placed" in failed(way, TOLD | {"claimed": True})


def test_errors_are_judged_by_those_in_one_process():
    good = GOOD | {"inside": 0.4}
    assert failed(CLEAN, good) == {"largest placement error in x or y"}
    assert not failed(CLEAN, good | {"rounding": 0.3})


def test_a_machine_that_is_too_slow_is_told_before_the_runs():
    check_speed(WAYS[CLEAN], 1.0, 1.0)
    check_speed(WAYS[CLEAN], 0.5, 0.5)
    message = r"^kitchen: runs at 0.79 x real time .* a rate of 0.5, .* `rate`$"
    with pytest.raises(ScenarioError, match=message):
        check_speed(WAYS[CLEAN], 0.79, 1.0)


def test_an_unknown_case_is_named():
    with pytest.raises(ScenarioError, match="cases: unknown 'kitchen, ROS 3'"):
        cases(cases=["kitchen, ROS 3"])
