"""Several servos on one line, as their masters see them."""

import contextlib
import dataclasses as dc
import functools
import math

import numpy as np
import pytest

from drake_srg.robot.drive.dynamixel.bus import RefusedByServoError
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import (
    Arm,
    ServoBridge,
    ServoGripper,
    WiredGripper,
    station_mechanisms,
)
from drake_srg.robot.serve.dynamixel.protocol import BROADCAST, Instruction
from drake_srg.robot.serve.dynamixel.servo import MotorCommand
from drake_srg.scenario import load_scenario
from robot.drive.dynamixel.emulated_line import POSITION, EmulatedLine
from robot.serve.dynamixel.fake_station import master_of

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


GOAL = 30  # address in Protocol 1.0


def emulated(protocol=1):
    """A line to two joints and a gripper, which a master's packets reach one by one."""
    line = EmulatedLine(protocol, joints=2)
    line.q = np.array([0.1, -0.2])
    line.sense()
    return line


@pytest.fixture
def line():
    return emulated()


def word(value):
    return value.to_bytes(2, "little", signed=value < 0)


def counts(q):
    return round(2048 + q * 4096 / math.tau)


@pytest.mark.parametrize("protocol", [1, 2])
def test_each_servo_has_its_id(protocol):
    line = emulated(protocol)
    for number in (1, 2, 3):
        (reply,) = line.ask(number, Instruction.PING)
        assert reply.id == number
    assert line.ask(4, Instruction.PING) == []
    replies = line.ask(BROADCAST, Instruction.PING)
    assert [reply.id for reply in replies] in ([], [1, 2, 3])


def test_a_joint_that_nobody_commands_stays(line):
    line.ask(2, Instruction.WRITE, [GOAL, *word(counts(1.0))])
    np.testing.assert_equal(np.isnan(line.inbox.take()[POSITION]), [True, False])


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_servo_that_reboots_leaves_its_joint_where_it_is(protocol):
    line = emulated(protocol)
    place = {1: b"\x18", 2: word(64)}[protocol]  # torque enable
    for number in (1, 2):
        line.ask(number, Instruction.WRITE, place + b"\1")
    line.inbox.take()
    line.bus.servos[1].reboot()
    line.sense()
    np.testing.assert_equal(np.isnan(line.inbox.take()[POSITION]), [True, False])
    assert line.bus.servos[1].table["torque_enable"] == 0
    assert line.bus.servos[1].table["present_position"] == counts(0.1)
    assert line.bus.servos[1].table["id"] == 1


def test_another_source_commands_a_part_and_leaves_the_other(line):
    line.ask(1, Instruction.WRITE, [GOAL, *word(counts(0.5))])
    line.ask(3, Instruction.WRITE, [GOAL, *word(2300)])
    line.inbox.put({POSITION: np.zeros(2)}, "/kuka")
    line.inbox.take()
    line.sense()
    line.ask(1, Instruction.WRITE, [32, *word(100)])  # moves nothing
    assert line.inbox.take() == {}
    line.ask(3, Instruction.WRITE, [GOAL, *word(2400)])
    assert "gripper.closure_commanded" in line.inbox.take()


def test_warnings_name_the_servo(line):
    line.ask(2, Instruction.WRITE, [0, 1])
    (text,) = line.warned
    assert text.startswith("servo 2: refused a packet")


# Other sources of commands.


def grasp(percent=50):
    """Return another source's command: a closure, and no motor command."""
    ports = ("motor_position_commanded", "motor_torque_commanded", "force_limit")
    free = {f"gripper.{port}": np.array([np.nan]) for port in ports}
    return {"gripper.closure_commanded": np.array([percent / 100.0]), **free}


@pytest.fixture
def quiet():
    """A bridge whose motor stands still: (bridge, inbox, write a register)."""
    inbox = CommandInbox([], Warnings(print))
    with (
        contextlib.closing(ServoBridge(inbox, "tcp:0")) as bridge,
        contextlib.closing(master_of(bridge)) as master,
    ):
        bridge.update(0.0, motor())
        yield bridge, inbox, functools.partial(master.write, 1)


def motor(angle=0.0):
    values = map(np.array, ([angle, 0.0], [0.0], [25.0]))
    return dict(zip(WiredGripper.ports, values, strict=True))


def test_a_repeated_write_wins_over_another_source(quiet):
    bridge, inbox, write = quiet
    write("goal_position", 2500)
    first = inbox.take()
    inbox.put(grasp(), "/grasp")
    bridge.update(0.005, motor())
    inbox.take()
    write("goal_position", 2500)
    np.testing.assert_equal(inbox.take(), first)
    assert np.isfinite(first["gripper.motor_position_commanded"]).all()


def test_another_source_interrupts_a_slow_motion(quiet):
    bridge, inbox, write = quiet
    write("moving_speed", 20)
    write("goal_position", 1000)
    inbox.put(grasp(), "/grasp")
    for k in range(100):
        bridge.update(0.005 * k, motor())
    write("torque_limit", 104)  # a register that moves nothing
    np.testing.assert_equal(inbox.take(), grasp())


def test_write_packets_are_counted_once_good_or_bad(quiet):
    bridge, inbox, write = quiet
    before = inbox.received
    write("moving_speed", 2)
    write("goal_position", 1000)
    for k in range(100):
        bridge.update(0.005 * k, motor())
    with pytest.raises(RefusedByServoError):
        write("model_number", 1)
    assert inbox.received == before + 3
