import contextlib
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper import SrgPositionDriver, SrgTendonDriver
from drake_srg.robot.drive.dynamixel.bus import ServoBus, open_line
from drake_srg.robot.drive.dynamixel.drivers import (
    BusCycle,
    BusThread,
    DynamixelArm,
    DynamixelGripper,
    ServoGroup,
)
from drake_srg.robot.drive.link import Robot
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import Arm, ServoBridge
from drake_srg.robot.serve.dynamixel.servo import JOINT
from drake_srg.scenario import load_scenario
from robot.drive.dynamixel.emulated_line import TRAVEL, EmulatedLine
from robot.serve.waiting import wait_until

JOINTS = ("one", "two", "three")
SCENARIO = load_scenario("assistive_arm")
CLOSED = 2048 + round(TRAVEL / (2 * np.pi) * 4096)
GRIPPER = {"id": 4, "open": 2048, "closed": CLOSED, "effort": 0.5}
FAR = SCENARIO.gripper.proximity.range


PROTOCOLS = pytest.mark.parametrize("protocol", [1, 2])
COUNT = 2 * np.pi / 4096  # rad


class Bench:
    """An arm of three joints and a gripper, connected to emulated servos.

    Each exchange with them is a call.
    """

    def __init__(self, arm=None, gripper=None, protocol=1):
        arm = DynamixelArm(**{"protocol": protocol} | (arm or {}))
        gripper = DynamixelGripper(**{"protocol": protocol} | GRIPPER | (gripper or {}))
        self.line, self.protocol, self.told = EmulatedLine(protocol), protocol, []
        warnings = Warnings(self.told.append)
        robot = Robot(SCENARIO, JOINTS, warnings, None)
        self.bus = BusCycle(self.open, warnings)
        arm.share(robot, self.bus)
        self.arm, self.gripper = arm.connect(robot), gripper.connect(robot)

    def open(self):
        self.line.closed = False
        return ServoBus(self.line, self.protocol, retries=1)

    def cycle(self, q=0.0, closure=0.0, hold=0.0):
        """Command, exchange three times and return the measurements."""
        commands = {
            "arm.position_commanded": np.broadcast_to(q, 3),
            "gripper.closure_commanded": np.array([closure]),
            "gripper.hold": np.array([hold]),
        }
        for _ in range(3):
            self.arm.send(commands)
            self.gripper.send(commands)
            self.bus.cycle()
            self.line.step()
        return self.arm.take() | self.gripper.take()

    @property
    def servos(self):
        return self.line.bus.servos

    @property
    def counts(self):
        return [round(JOINT.to_counts(-q)) for q in self.line.q]


@PROTOCOLS
def test_joints_go_where_they_are_sent(protocol):
    robot = Bench({"full_torque": [1.0, 2.0, 3.0]}, protocol=protocol)
    q = [0.5, -1.0, 2.0]
    measured = robot.cycle(q)
    assert robot.line.q == pytest.approx(q, abs=1e-3)
    state = measured["arm.state_measured"]
    assert state == pytest.approx([*q, 0.0, 0.0, 0.0], abs=1e-3)
    assert measured["arm.torque_measured"].tolist() == [0.0, 0.0, 0.0]
    assert measured.keys() == robot.arm.outputs.keys() | robot.gripper.outputs.keys()
    assert all(len(measured[k]) == n for k, n in robot.arm.outputs.items())
    assert all(len(measured[k]) == n for k, n in robot.gripper.outputs.items())


def test_zero_and_direction_of_a_joint_are_configured():
    robot = Bench({"zero": [2048, 1048, 3048], "direction": [1, -1, 1]})
    measured = robot.cycle([0.1, 0.2, -0.3])["arm.state_measured"]
    assert measured[:3] == pytest.approx([0.1, 0.2, -0.3], abs=1e-3)
    turned = 1000 * COUNT
    expected = [0.1, -turned - 0.2, turned - 0.3]
    assert robot.line.q == pytest.approx(expected, abs=1e-3)


def test_a_command_that_is_not_finite_is_ignored():
    robot = Bench()
    robot.cycle([0.5, 0.5, 0.5], 0.5)
    robot.cycle([np.nan, 0.5, 0.5], np.nan)
    assert robot.line.q == pytest.approx([0.5, 0.5, 0.5], abs=1e-3)
    assert robot.line.closure == pytest.approx(0.5, abs=2e-3)


def test_a_command_beyond_a_servo_s_turn_is_refused_and_names_the_joint():
    robot = Bench({"zero": [2048, 3900, 2048]})
    robot.cycle([0.1, 0.1, 0.1])
    for _ in range(2):
        robot.cycle([0.2, 0.4, 0.2])
    at = 0.1 + 1852 * COUNT
    assert robot.line.q == pytest.approx([0.1, at, 0.1], abs=2e-3)
    assert robot.told == [
        "arm: two: must be -5.983 to 0.299 rad, the turn of servo 2, got 0.4 (check "
        "arm.zero and arm.direction); the last good command holds"
    ]
    robot.cycle([0.2, 0.1, np.pi])  # half a turn, which rounds to one count too many
    assert robot.line.q == pytest.approx([0.2, at, 3.0], abs=2e-3)  # its own limit
    assert len(robot.told) == 1


@PROTOCOLS
def test_the_gripper_tells_of_contact_by_its_load(protocol):
    robot = Bench(protocol=protocol)
    free = robot.cycle(closure=0.6)
    assert robot.line.closure == pytest.approx(0.6, abs=2e-3)
    angles = free["gripper.state_measured"]
    assert angles == pytest.approx([0.6 * TRAVEL] * 2 + [0.0] * 2, abs=2e-3)
    assert free["gripper.proximity"].tolist() == [FAR] * 2
    assert free["gripper.triggered"].tolist() == [0.0] * 2
    robot.line.load = 0.3
    held = robot.cycle(closure=0.6)
    assert held["gripper.proximity"].tolist() == [0.0] * 2
    assert held["gripper.triggered"].tolist() == [1.0] * 2
    robot.line.load = -0.3  # opening, against something
    assert robot.cycle(closure=0.6)["gripper.triggered"].tolist() == [0.0] * 2


@pytest.mark.parametrize("load", [0.0, 0.3])
def test_a_held_gripper_stays_where_it_is_and_keeps_its_grip(load):
    robot = Bench()
    robot.cycle(closure=0.6)
    robot.line.load = load
    robot.cycle(closure=0.6)
    for closure in (0.0, 1.0):
        robot.cycle(closure=closure, hold=1.0)
        assert robot.line.closure == pytest.approx(0.6, abs=2e-3)
    robot.cycle(closure=0.3)
    assert robot.line.closure == pytest.approx(0.3, abs=2e-3)


def test_a_servo_that_stretches_wires_moves_no_finger():
    robot = Bench({}, {"stretch": 100.0})
    robot.line.load = 0.3
    q = robot.cycle(closure=0.6)["gripper.state_measured"][0]
    stretched = 0.3 * 100.0 * COUNT
    assert q == pytest.approx(0.6 * TRAVEL - stretched, abs=2e-3)


@pytest.mark.parametrize("gripper", [SrgPositionDriver(), SrgTendonDriver()])
@given(closure=st.floats(0.0, 1.0))
def test_joints_of_an_empty_srg_add_up_to_its_closure(gripper, closure):
    way, joints = gripper.empty_hand(closure)
    farther, _ = gripper.empty_hand(1.0)
    assert 0.0 <= way <= farther
    for finger in (joints[0::2], joints[1::2]):
        assert sum(finger) == pytest.approx(SRG.full_scale * closure)


def test_the_bus_closes_with_its_last_part():
    robot = Bench()
    robot.arm.close()
    assert not robot.line.closed
    robot.gripper.close()
    robot.gripper.close()
    assert robot.line.closed


@pytest.mark.parametrize(
    ("arm", "gripper", "words"),
    [
        ({"ids": [1, 2]}, {}, "arm.ids: needs 0 or 3 entries, got 2"),
        ({"zero": [1, 2]}, {}, "arm.zero: needs 1 or 3 entries, got 2"),
        ({"direction": [2]}, {}, "arm.direction: entries must be 1 or -1"),
        ({"baud": 57600}, {}, "arm and gripper need the same baud, protocol"),
        ({}, {"closed": 2048}, "gripper.closed: must differ from open"),
        ({}, {"contact_load": 0.5}, "gripper.contact_load: must be below effort"),
    ],
)
def test_bad_settings_are_told(arm, gripper, words):
    with pytest.raises(ScenarioError, match=words):
        Bench(arm, gripper)


def test_a_bad_port_is_told():
    robot = Robot(SCENARIO, JOINTS, Warnings(print), None)
    with pytest.raises(ScenarioError, match="port: must be tcp:HOST:PORT or a device"):
        DynamixelArm(port="COM3").connect(robot)


GOAL = 100 * COUNT  # rad
NEAR = {"resume_within": 30 * COUNT}


@pytest.fixture(params=[1, 2])
def robot(request):
    """Servos that have been sent to a goal."""
    robot = Bench(NEAR, protocol=request.param)
    assert robot.cycle(GOAL)
    return robot


def test_servos_are_set_up_where_they_are(robot):
    new = Bench(protocol=robot.protocol)
    new.bus.cycle()
    assert new.counts == [2048] * 3
    for servo in new.servos.values():
        assert servo.table["torque_enable"] == servo.table["led"] == 1
    effort = {1: ("torque_limit", 1023, 512), 2: ("goal_pwm", 885, 442)}
    name, joint, gripper = effort[robot.protocol]
    assert (new.servos[1].table[name], new.servos[4].table[name]) == (joint, gripper)
    assert new.told == []


def test_a_servo_that_reboots_near_its_goal_goes_on(robot):
    robot.servos[2].reboot()
    robot.line.step()
    assert "arm.state_measured" in robot.cycle(GOAL + 10 * COUNT)
    assert robot.counts == [2158] * 3
    assert robot.servos[2].table["torque_enable"] == 1
    (text,) = robot.told
    assert text == "servo 2 has rebooted, 10 counts from its goal; it goes on"


def test_a_servo_that_reboots_far_from_its_goal_stops_all(robot):
    robot.servos[2].reboot()
    robot.line.step()
    for _ in range(2):
        assert "arm.state_measured" not in robot.cycle(GOAL + 252 * COUNT)
    assert robot.counts == [2148] * 3
    (text,) = robot.told
    assert "servo 2 has rebooted and is 252 counts from its goal (allowed: 30)" in text


def test_a_servo_that_shuts_down_stops_all(robot):
    for number in (1, 2, 3):
        robot.servos[number].table["temperature_limit"] = 20  # it has 25 degrees
    robot.line.step()
    assert "arm.state_measured" not in robot.cycle(2.0 * GOAL)
    assert robot.counts == [2148] * 3
    (text,) = robot.told
    assert "servo 1 has shut down (overheating)" in text


def test_silence_is_told_once_and_ends_in_a_new_line(robot):
    robot.line.silent = True
    assert robot.cycle(2.0 * GOAL) == {}
    assert robot.counts == [2148] * 3
    (text,) = robot.told
    assert text.startswith("servo bus: servo 1, 2, 3, 4: no intact reply within")
    robot.line.silent = False
    assert robot.cycle(2.0 * GOAL)
    assert robot.counts == [2248] * 3
    robot.line.silent = True
    robot.cycle()
    assert len(robot.told) == 2


@PROTOCOLS
@settings(max_examples=20)
@given(data=st.data())
def test_joints_move_to_goals_only_whatever_happens(protocol, data):
    robot, q, allowed = Bench(NEAR, protocol=protocol), 0.0, {2048}
    for _ in range(data.draw(st.integers(1, 12))):
        match data.draw(st.sampled_from(["goal", "reboot", "silence", "noise"])):
            case "goal":
                goal = data.draw(st.integers(1048, 3048))
                allowed.add(goal)
                q = (goal - 2048) * COUNT
            case "reboot":
                robot.servos[data.draw(st.integers(1, 3))].reboot()
                robot.line.step()
            case "silence":
                robot.line.silent = not robot.line.silent
            case "noise":
                end = data.draw(st.integers(0, 40))
                robot.line.spoil = lambda reply, end=end: reply[:end]
        robot.cycle(q)
        robot.line.spoil = None
        assert set(robot.counts) <= allowed


POSITION = "arm.position_desired"


class Served:
    """Two joints behind a socket, and a thread that drives them."""

    def __init__(self, stack):
        self.inbox = CommandInbox([], Warnings(print))
        ends = np.full(2, 3.0)
        self.bridge = ServoBridge(self.inbox, "tcp:0", [Arm(-ends, ends, ends)])
        stack.callback(self.bridge.close)
        self.told, self.reports = [], []
        warnings = Warnings(self.told.append)
        self.thread = BusThread(self.open, 0.001, warnings)
        self.group = ServoGroup([1, 2], self.reports.append, warnings)
        stack.callback(self.thread.remove, self.group)

    def open(self):
        # Patient, because the machine may be busy.
        return ServoBus(open_line(f"tcp:{self.bridge.address}", 57600), timeout=20.0)


@pytest.fixture
def served():
    with contextlib.ExitStack() as stack:
        yield Served(stack)


def test_a_thread_reads_and_commands_until_it_ends(served):
    before = threading.active_count()
    served.thread.add(served.group)
    assert wait_until(lambda: len(served.reports) > 3)
    served.group.goals = {1: 2148, 2: 1948}
    commanded = {}

    def arrived():
        commanded.update(served.inbox.take())
        q = commanded.get(POSITION, np.zeros(2))
        return np.allclose(q, GOAL * np.array([1, -1]))

    assert wait_until(arrived)
    served.thread.remove(served.group)
    assert served.thread.closed
    assert threading.active_count() == before
    assert served.told == []


def test_a_lost_bus_is_told_and_found_again(served):
    served.thread.add(served.group)
    assert wait_until(lambda: served.reports)
    address = served.bridge.address
    served.bridge.close()
    assert wait_until(lambda: served.told)
    ends = np.full(2, 3.0)
    with contextlib.closing(
        ServoBridge(served.inbox, f"tcp:{address}", [Arm(-ends, ends, ends)])
    ):
        known = len(served.reports)
        assert wait_until(lambda: len(served.reports) > known)
        served.thread.remove(served.group)
    assert "servo bus: " in served.told[0]
