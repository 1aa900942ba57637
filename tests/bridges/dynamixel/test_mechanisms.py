import dataclasses as dc

import numpy as np
import pytest

from drake_srg.bridges.dynamixel.mechanisms import (
    Arm,
    ServoGripper,
    WiredGripper,
    station_mechanisms,
)
from drake_srg.bridges.dynamixel.motor import MotorCommand
from drake_srg.scenario import load_scenario

FIVE_AXES = load_scenario("assistive_arm")
TRAVEL = 0.69


def position(angle, limit=1.0):
    return MotorCommand(angle, np.nan, limit)


def torque(value, limit=1.0):
    return MotorCommand(np.nan, value, limit)


@pytest.fixture
def arm():
    return Arm(np.array([-1.0, -2.0]), np.array([1.0, 2.0]), np.array([2.0, 4.0]))


def test_the_five_axis_arm_has_a_servo_per_joint_and_one_for_the_gripper():
    arm, gripper = station_mechanisms(FIVE_AXES)
    assert (type(arm), len(arm.motors)) == (Arm, 5)
    assert (type(gripper), len(gripper.motors)) == (ServoGripper, 1)


def test_only_an_arm_of_servos_has_its_joints_on_the_bus():
    (wires,) = station_mechanisms(load_scenario("kitchen_tendon"))
    assert isinstance(wires, WiredGripper)


@pytest.mark.parametrize("changes", [{"bus_servos": False}, {"limits": None}])
def test_a_station_without_servos_is_refused(changes):
    plain = dc.replace(FIVE_AXES, arm=dc.replace(FIVE_AXES.arm, **changes))
    with pytest.raises(ValueError, match=r"--servo: (needs .* an arm of serv|arm.lim)"):
        station_mechanisms(plain)


def test_joints_turn_against_the_clock(arm):
    values = {
        "arm.state_measured": np.array([0.1, 0.2, 0.3, 0.4]),
        "arm.torque_measured": np.array([1.0, -8.0]),
    }
    first, second = arm.sense(values)
    assert first == (-0.1, -0.3, -0.5, 25.0)
    assert second == (-0.2, -0.4, 1.0, 25.0)  # no more than full PWM
    (angle,) = arm.command([position(-0.1), None]).values()
    np.testing.assert_equal(angle, [0.1, np.nan])


@pytest.mark.parametrize("silent", [None, torque(0.0)])
def test_a_joint_without_a_position_stays(arm, silent):
    (angle,) = arm.command([silent, position(9.0)]).values()
    np.testing.assert_equal(angle, [np.nan, -2.0])  # the other ends at its limit


def test_a_gripper_s_servo_commands_closure():
    gripper = ServoGripper(TRAVEL, joints=2)
    values = {
        "gripper.state_measured": np.array([0.3, 0.2, 0.01, 0.02]),
        "gripper.pwm": np.array([0.4, 0.1]),
    }
    assert gripper.sense(values) == [(-0.3, -0.01, -0.4, 25.0)]
    half = gripper.command([position(-TRAVEL / 2, 0.5)])
    assert half["gripper.closure_commanded"] == [0.5]
    assert half["gripper.force_limit"] == [0.5]
    assert np.isnan(half["gripper.joint_position_commanded"]).all()
    assert gripper.command([position(1.0)])["gripper.closure_commanded"] == [0.0]


def test_a_gripper_without_torque_is_free():
    free = ServoGripper(TRAVEL, joints=2).command([torque(0.0)])
    assert free["gripper.force_limit"] == [0.0]
    assert "gripper.closure_commanded" not in free
