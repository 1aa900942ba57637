"""Profiles of an MX-64 with Protocol 2.0 that have no way to go, or no acceleration."""

import pytest

from robot.serve.dynamixel.servo_with_master import ServoWithMaster2

OPEN = 3298  # position of the open gripper
LASTING, NEVER_FASTER = {"drive_mode": 4}, {"acceleration_limit": 0}


def engaged(**registers):
    servo = ServoWithMaster2()
    servo.move()
    for name, value in {
        **registers,
        "profile_velocity": 100,
        "profile_acceleration": 20,
        "torque_enable": 1,
    }.items():
        assert servo.write(name, value) == 0
    return servo


@pytest.mark.parametrize("registers", [LASTING, NEVER_FASTER])
def test_a_goal_where_the_target_is_ends_the_motion(registers):
    servo = engaged(**registers)
    for _ in range(2):
        servo.write("goal_position", OPEN)
        servo.move(lasting=0.5)
        assert servo.read("moving") == 0
        assert servo.command().position == 0.0
    # Switching on moves the goal, and makes no new profile.
    servo.write("torque_enable", 0)
    servo.move(angle=0.7)
    servo.write("torque_enable", 1)
    servo.move(angle=0.7, lasting=0.5)
    assert servo.read("moving") == 0


def test_without_acceleration_the_target_stays():
    servo = engaged(**NEVER_FASTER)
    servo.write("goal_position", OPEN - 2048)
    servo.move(lasting=0.5)
    assert servo.command().position == 0.0
