import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper import SrgPositionDriver, SrgTendonDriver
from drake_srg.robot.drive.config import parse_hardware
from drake_srg.robot.drive.dynamixel.bus import ServoBus
from drake_srg.robot.drive.dynamixel.drivers import (
    BusCycle,
    DynamixelArm,
    DynamixelConfig,
    DynamixelGripper,
)
from drake_srg.robot.drive.link import Robot
from drake_srg.robot.serve.commands import Warnings
from drake_srg.scenario import load_scenario
from robot.drive.dynamixel.emulated_line import TRAVEL, EmulatedLine

JOINTS = ("one", "two", "three")
SCENARIO = load_scenario("assistive_arm")
CLOSED = 2048 + round(TRAVEL / (2 * np.pi) * 4096)
GRIPPER = {"id": 4, "open": 2048, "closed": CLOSED, "effort": 0.5}
FAR = SCENARIO.gripper.proximity.range


class Bench:
    """An arm of three joints and a gripper, connected to emulated servos."""

    def __init__(self, arm, gripper):
        self.line = EmulatedLine(arm.protocol)
        self.told = []
        ends = np.full(3, 3.0)
        warnings = Warnings(self.told.append)
        self.robot = Robot(SCENARIO, JOINTS, (-ends, ends), warnings, None)
        self.opened = []
        self.arm, self.gripper = arm.connect(self.robot), gripper.connect(self.robot)

    def cycle(self, q=(0.0, 0.0, 0.0), closure=0.0, hold=0.0):
        """Command, exchange twice and return the measurements."""
        commands = {
            "arm.position_commanded": np.array(q),
            "gripper.closure_commanded": np.array([closure]),
            "gripper.hold": np.array([hold]),
        }
        (_, bus) = next(iter(self.robot.shared.values()))
        for _ in range(3):
            self.arm.send(commands)
            self.gripper.send(commands)
            bus.cycle()
            self.line.step()
        return self.arm.take() | self.gripper.take()


@pytest.fixture
def bench(monkeypatch):
    """A function that connects drivers with these options to emulated servos."""
    benches = []

    def make_bus(config, robot):  # without a thread
        line = benches[-1].line
        return BusCycle(lambda: ServoBus(line, config.protocol), robot.warnings)

    def connect(arm=None, gripper=None):
        benches.append(Bench.__new__(Bench))
        benches[-1].__init__(
            DynamixelArm(**(arm or {})), DynamixelGripper(**GRIPPER | (gripper or {}))
        )
        return benches[-1]

    monkeypatch.setattr(DynamixelConfig, "make_bus", make_bus)
    return connect


@pytest.mark.parametrize("protocol", [1, 2])
def test_joints_go_where_they_are_sent(bench, protocol):
    both = {"protocol": protocol}
    robot = bench({"full_torque": [1.0, 2.0, 3.0], **both}, both)
    q = [0.5, -1.0, 2.0]
    measured = robot.cycle(q)
    assert robot.line.q == pytest.approx(q, abs=1e-3)
    state = measured["arm.state_measured"]
    assert state == pytest.approx([*q, 0.0, 0.0, 0.0], abs=1e-3)
    assert measured["arm.torque_measured"].tolist() == [0.0, 0.0, 0.0]
    assert measured.keys() == robot.arm.outputs.keys() | robot.gripper.outputs.keys()
    assert all(len(measured[k]) == n for k, n in robot.arm.outputs.items())
    assert all(len(measured[k]) == n for k, n in robot.gripper.outputs.items())


def test_zero_and_direction_of_a_joint_are_configured(bench):
    robot = bench({"zero": [2048, 1048, 3048], "direction": [1, -1, 1]})
    measured = robot.cycle([0.1, 0.2, -0.3])["arm.state_measured"]
    assert measured[:3] == pytest.approx([0.1, 0.2, -0.3], abs=1e-3)
    turned = 1000 / 4096 * 2 * np.pi
    expected = [0.1, -turned - 0.2, turned - 0.3]
    assert robot.line.q == pytest.approx(expected, abs=1e-3)


def test_an_arm_may_follow_as_late_as_its_servos_do(bench):
    # The emulated servos of the five-axis arm follow 0.11 s late at 2.7 rad/s.
    assert bench().arm.lag > 0.11
    assert bench({"lag": 0.3}).arm.lag == 0.3


def test_a_command_that_is_not_finite_is_ignored(bench):
    robot = bench()
    robot.cycle([0.5, 0.5, 0.5], 0.5)
    robot.cycle([np.nan, 0.5, 0.5], np.nan)
    assert robot.line.q == pytest.approx([0.5, 0.5, 0.5], abs=1e-3)
    assert robot.line.closure == pytest.approx(0.5, abs=2e-3)


@pytest.mark.parametrize("protocol", [1, 2])
def test_the_gripper_tells_of_contact_by_its_load(bench, protocol):
    both = {"protocol": protocol}
    robot = bench(both, both)
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
def test_a_held_gripper_stays_where_it_is_and_keeps_its_grip(bench, load):
    robot = bench()
    robot.cycle(closure=0.6)
    robot.line.load = load
    robot.cycle(closure=0.6)
    for closure in (0.0, 1.0):
        robot.cycle(closure=closure, hold=1.0)
        assert robot.line.closure == pytest.approx(0.6, abs=2e-3)
    robot.cycle(closure=0.3)
    assert robot.line.closure == pytest.approx(0.3, abs=2e-3)


def test_a_servo_that_stretches_wires_moves_no_finger(bench):
    robot = bench({}, {"stretch": 100.0})
    robot.line.load = 0.3
    q = robot.cycle(closure=0.6)["gripper.state_measured"][0]
    stretched = 0.3 * 100.0 / 4096 * 2 * np.pi
    assert q == pytest.approx(0.6 * TRAVEL - stretched, abs=2e-3)


@pytest.mark.parametrize("gripper", [SrgPositionDriver(), SrgTendonDriver()])
@given(closure=st.floats(0.0, 1.0))
def test_joints_of_an_empty_srg_add_up_to_its_closure(gripper, closure):
    way, joints = gripper.empty_hand(closure)
    farther, _ = gripper.empty_hand(1.0)
    assert 0.0 <= way <= farther
    for finger in (joints[0::2], joints[1::2]):
        assert sum(finger) == pytest.approx(SRG.full_scale * closure)


def test_the_bus_closes_with_its_last_part(bench):
    robot = bench()
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
def test_bad_settings_are_told(bench, arm, gripper, words):
    with pytest.raises(ScenarioError, match=words):
        bench(arm, gripper)


def test_a_bad_port_is_told():
    robot = Robot(SCENARIO, JOINTS, (None, None), Warnings(print), None)
    with pytest.raises(ScenarioError, match="port: must be tcp:HOST:PORT or a device"):
        DynamixelArm(port="COM3").connect(robot)


def test_hardware_files_choose_them_by_tag():
    text = """
    arm: !DynamixelArm {port: "tcp:127.0.0.1:4001", protocol: 2}
    gripper: !DynamixelGripper {id: 6, open: 2048, closed: 2498}
    """
    config = parse_hardware(text, "robot.yaml")
    assert config.arm == DynamixelArm(port="tcp:127.0.0.1:4001", protocol=2)
    assert config.gripper == DynamixelGripper(id=6, open=2048, closed=2498)
