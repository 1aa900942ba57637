import pytest

from drake_srg.hardware.config import parse_hardware
from drake_srg.hardware.ros import Ros1Arm, Ros2Gripper
from measure.hardware_loop import robot_file

FAULTS = {"latency": 0.02, "loss": 0.05, "seed": 3}


def test_the_hardware_file_of_a_run_can_be_loaded():
    text = robot_file("ROS 1", ("--ros1", "--master", "http://x:1"), FAULTS, 1.0, 0.1)
    config = parse_hardware(text, "robot.yaml")
    assert isinstance(config.arm, Ros1Arm)
    assert config.arm.lead == 0.1
    assert config.ros1.master == "http://x:1"
    assert config.faults.latency == pytest.approx(0.02)
    text = robot_file("ROS 2", ("--ros2", "--domain", "9"), FAULTS, 0.5, 0.1)
    config = parse_hardware(text, "robot.yaml")
    assert isinstance(config.gripper, Ros2Gripper)
    assert (config.ros2.domain, config.rate) == (9, 0.5)
    assert list(config.cameras) == ["ceiling"]


def test_the_camera_of_a_visual_servo_has_topics_of_its_own():
    text = robot_file("ROS 2", ("--ros2", "--domain", "9"), FAULTS, 0.5, 0.1, "hand")
    config = parse_hardware(text, "robot.yaml")
    assert config.cameras["ceiling"].color == "/camera/color/image_raw"
    assert config.cameras["hand"].color == "/camera_hand/color/image_raw"


def test_commands_can_be_goals_of_an_action():
    serve = ("--ros2", "--domain", "9")
    text = robot_file("ROS 2", serve, FAULTS, 0.5, 0.1, stream="action")
    assert parse_hardware(text, "robot.yaml").arm.stream == "action"
