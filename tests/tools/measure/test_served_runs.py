import pytest

from drake_srg.robot.drive.arm import Ros1Arm, Ros2Arm
from drake_srg.robot.drive.config import parse_hardware
from drake_srg.robot.drive.dynamixel.drivers import DynamixelArm, DynamixelGripper
from drake_srg.robot.drive.gripper import Ros2Gripper
from drake_srg.scenario import load_scenario
from measure.hardware_loop import CASES
from measure.served_runs import Case, robot_file

ROS_2 = ("--ros2", "--domain", "9")


def parsed(case, arguments=ROS_2, rate=1.0):
    scenario = load_scenario(case.scenario, seed=3, overrides=case.settings)
    text = robot_file(case, scenario, arguments, 4001, rate)
    return parse_hardware(text, "robot.yaml")


def test_the_hardware_file_says_what_is_served():
    case = Case("kitchen_fast", wire="ROS 1", lead=0.1, latency=0.02)
    config = parsed(case, ("--ros1", "--master", "http://x:1"))
    assert isinstance(config.arm, Ros1Arm)
    assert config.arm.lead == 0.1
    assert config.ros1.master == "http://x:1"
    assert config.faults.latency == pytest.approx(0.02)
    assert config.faults.seed == 3
    config = parsed(Case("kitchen_fast"), rate=0.5)
    assert isinstance(config.gripper, Ros2Gripper)
    assert (config.ros2.domain, config.rate) == (9, 0.5)
    assert list(config.cameras) == ["ceiling"]


def test_servos_may_be_on_a_bus():
    config = parsed(CASES["kitchen_tendon, gripper by servo"])
    assert isinstance(config.arm, Ros2Arm)
    assert isinstance(config.gripper, DynamixelGripper)
    assert (config.gripper.open, config.gripper.stretch) == (3298, 1354)
    config = parsed(CASES["assistive_arm, servo bus"])
    assert isinstance(config.arm, DynamixelArm)
    assert config.arm.port == config.gripper.port == "tcp:127.0.0.1:4001"
    assert (config.gripper.id, config.gripper.open, config.gripper.closed) == (
        6,
        2048,
        2498,
    )


def test_the_camera_of_a_visual_servo_has_topics_of_its_own():
    config = parsed(CASES["moving tray"])
    assert config.cameras["ceiling"].color == "/camera/color/image_raw"
    assert config.cameras["hand"].color == "/camera_hand/color/image_raw"


def test_commands_can_be_goals_of_an_action():
    assert parsed(CASES["kitchen_fast, action"]).arm.stream == "action"
