"""The thread, at emulated servos behind a socket."""

import contextlib
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.robot.drive.dynamixel.bus import ServoBus, open_line
from drake_srg.robot.drive.dynamixel.drivers import (
    BusCycle,
    BusThread,
    GroupConfig,
    ServoGroup,
)
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.dynamixel.bridge import Arm, ServoBridge
from drake_srg.robot.serve.dynamixel.servo import JOINT
from robot.drive.dynamixel.emulated_line import EmulatedLine
from robot.serve.waiting import wait_until

PROTOCOLS = pytest.mark.parametrize("protocol", [1, 2])


class Robot:
    """Exchanges, one by one, with the joints of an emulated arm."""

    def __init__(self, protocol, resume_within=30):
        self.line = EmulatedLine(protocol)
        self.opened, self.told, self.reports = 0, [], []
        self.protocol = protocol
        warnings = Warnings(self.told.append)
        self.cycles = BusCycle(self.open, warnings)
        config = GroupConfig(ids=[1, 2, 3], effort=0.8, resume_within=resume_within)
        self.group = ServoGroup(config, self.reports.append, warnings)
        self.cycles.add(self.group)

    def open(self):
        self.opened += 1
        self.line.closed = False
        return ServoBus(self.line, self.protocol, retries=1)

    def cycle(self, goal=None):
        if goal is not None:
            self.group.goals = dict.fromkeys((1, 2, 3), goal)
        before = len(self.reports)
        self.cycles.cycle()
        self.line.step()
        return len(self.reports) > before

    @property
    def counts(self):
        return [round(JOINT.to_counts(-q)) for q in self.line.q]


@pytest.fixture(params=[1, 2])
def robot(request):
    robot = Robot(request.param)
    assert robot.cycle()
    return robot


def test_servos_are_set_up_where_they_are(robot):
    assert robot.counts == [2048] * 3
    for number, servo in robot.line.bus.servos.items():
        assert servo.table["torque_enable"] == (number < 4)
        assert servo.table["led"] == (number < 4)
    effort = {1: ("torque_limit", 818), 2: ("goal_pwm", 708)}[robot.protocol]
    assert robot.line.bus.servos[1].table[effort[0]] == effort[1]
    assert robot.told == []


def test_goals_are_followed_and_states_reported(robot):
    assert robot.cycle(2148)
    assert robot.counts == [2148] * 3
    assert robot.cycle()
    assert [state.position for state in robot.reports[-1]] == [2148] * 3
    assert robot.opened == 1


def test_a_servo_that_reboots_near_its_goal_goes_on(robot):
    robot.cycle(2148)
    robot.line.bus.servos[2].reboot()
    robot.line.step()
    assert robot.cycle(2158)
    assert robot.cycle()
    assert robot.counts == [2158] * 3
    assert robot.line.bus.servos[2].table["torque_enable"] == 1
    (text,) = robot.told
    assert text == "servo 2 has rebooted, 10 counts from its goal; it goes on"


def test_a_servo_that_reboots_far_from_its_goal_stops_all(robot):
    robot.cycle(2148)
    robot.line.bus.servos[2].reboot()
    robot.line.step()
    assert not robot.cycle(2400)
    assert not robot.cycle(2400)
    assert robot.counts == [2148] * 3
    (text,) = robot.told
    assert "servo 2 has rebooted and is 252 counts from its goal (allowed: 30)" in text


def test_a_servo_that_shuts_down_stops_all(robot):
    robot.cycle(2148)
    for servo in robot.line.bus.servos.values():
        servo.table["temperature_limit"] = 20  # it has 25 degrees
    robot.line.step()
    assert not robot.cycle(2400)
    assert robot.counts == [2148] * 3
    (text,) = robot.told
    assert "servo 1 has shut down (overheating)" in text


def test_silence_is_told_once_and_ends_in_a_new_line(robot):
    robot.line.silent = True
    assert not robot.cycle(2148)
    assert not robot.cycle(2148)
    assert robot.counts == [2048] * 3
    (text,) = robot.told
    assert text.startswith("servo bus: servo 1, 2, 3: no intact reply within")
    robot.line.silent = False
    assert robot.cycle(2148)
    assert robot.counts == [2148] * 3
    robot.line.silent = True
    robot.cycle()
    assert len(robot.told) == 2


@PROTOCOLS
@settings(max_examples=20)
@given(data=st.data())
def test_joints_move_to_goals_only_whatever_happens(protocol, data):
    robot = Robot(protocol)
    allowed = {2048}
    for _ in range(data.draw(st.integers(1, 12))):
        match data.draw(st.sampled_from(["goal", "reboot", "silence", "noise"])):
            case "goal":
                goal = data.draw(st.integers(1048, 3048))
                allowed.add(goal)
                robot.cycle(goal)
            case "reboot":
                robot.line.bus.servos[data.draw(st.integers(1, 3))].reboot()
                robot.line.step()
                robot.cycle()
            case "silence":
                robot.line.silent = not robot.line.silent
                robot.cycle()
            case "noise":
                end = data.draw(st.integers(0, 40))
                robot.line.spoil = lambda reply, end=end: reply[:end]
                robot.cycle()
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
        config = GroupConfig(ids=[1, 2])
        self.group = ServoGroup(config, self.reports.append, warnings)
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
        return np.allclose(q, 100 / 4096 * 2 * np.pi * np.array([1, -1]))

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
