"""A robot of two arms: drivers and commands by arm, and one stop for both."""

import functools

import numpy as np
import pytest
from station.two_arm_station import two_arms

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.safety_states import SafetyState, StopReason, safety_state
from drake_srg.lifetime import my_context
from drake_srg.robot.drive.arm import Ros2Arm
from drake_srg.robot.drive.config import ArmHardware, HardwareConfig, parse_hardware
from drake_srg.robot.drive.gripper import Ros2Gripper
from drake_srg.robot.drive.link import STAMP, NamedLink, Nodes
from drake_srg.robot.drive.opening import Hardware, open_hardware
from drake_srg.robot.drive.remote_planner import Answer
from drake_srg.robot.drive.run import run_on_hardware
from drake_srg.robot.drive.station import HardwareReader, MakeHardwareStation
from drake_srg.robot.serve.commands import Warnings
from drake_srg.scenario import load_scenario, robot_arms
from drake_srg.scenario.typed_yaml import read_typed
from drake_srg.types import PlannerStatus
from robot.drive.stand import (
    HOME,
    MOVING,
    PERIOD,
    FakeArm,
    FakeGripper,
    FakeNode,
    Stand,
    array,
    joint_state,
    motion_to,
)

ARMS = ("left", "right")
GOAL = HOME + 0.5


@functools.cache
def scenario():
    return two_arms(base="kitchen")


class StuckArm(FakeArm):
    """An arm that no command moves."""

    def take(self):
        return {"arm.state_measured": np.concatenate([HOME, np.zeros(7)])}


class TwoArmStand(Stand):
    """A loop around two arms with their grippers, and a planner."""

    def __init__(self, **arms):
        self.arms = {name: arms.get(name, FakeArm()) for name in ARMS}
        self.grippers = {name: FakeGripper() for name in ARMS}
        links = [
            NamedLink(part, own)
            for own in robot_arms(scenario())
            for part in (self.arms[own.name], self.grippers[own.name])
        ]
        start = {
            f"{name}.state_measured": np.append(HOME, np.zeros(7)) for name in ARMS
        }
        self.build(scenario(), Hardware(links, {}, start))

    def say(self, arm, motion=None, closure=0.0, joints=slice(None)):
        status = PlannerStatus(mode=MOVING)
        answer = Answer(0.0, motion, closure, status, arm=arm, joints=joints)
        self.planner.answers.append(answer)

    def stops(self):
        """State and reason of each arm's monitor."""
        context = my_context(self.cell, self.loop._root)
        ports = [self.cell.GetOutputPort(f"{name}.safety.state") for name in ARMS]
        return [safety_state(port.Eval(context)) for port in ports]


def test_each_arm_follows_its_own_motion_and_closure():
    stand = TwoArmStand()
    stand.say("left", motion_to(GOAL), closure=0.2)
    stand.say("right", closure=0.7)
    assert stand.run(3.0)
    np.testing.assert_allclose(stand.arms["left"].sent[-1], GOAL)
    np.testing.assert_allclose(stand.arms["right"].sent[-1], HOME)
    assert [stand.grippers[name].closures[-1] for name in ARMS] == [0.2, 0.7]
    values = stand.planner.ticks[-1].values
    assert values["left.state_measured"][0] == pytest.approx(GOAL[0])
    assert values["right.gripper.proximity"].shape == (4,)
    assert not [name for name in values if "safety" in name or ".position_" in name]


def test_a_motion_of_all_joints_is_split():
    stand = TwoArmStand()
    both = motion_to(np.append(GOAL, HOME - 0.1), start=np.append(HOME, HOME))
    stand.say("left", both, joints=slice(0, 7))
    stand.say("right", both, joints=slice(7, 14))
    assert stand.run(3.0)
    np.testing.assert_allclose(stand.arms["left"].sent[-1], GOAL)
    np.testing.assert_allclose(stand.arms["right"].sent[-1], HOME - 0.1)


def moving(stand):
    for name in ARMS:
        stand.say(name, motion_to(GOAL, 8.0), closure=0.5)
    return stand


def test_a_stop_of_one_arm_stops_both_and_ends_the_run():
    stand = moving(TwoArmStand(left=StuckArm()))
    assert not stand.run(9.0)
    (left, why), (right, stopped) = stand.stops()
    assert (left, why) == (SafetyState.PROTECTIVE_STOP, StopReason.FOLLOWING_ERROR)
    assert (right, stopped) == (SafetyState.EMERGENCY_STOP, StopReason.EMERGENCY_STOP)
    for arm in stand.arms.values():
        np.testing.assert_array_equal(arm.sent[-1], arm.sent[-20])
        assert np.all(arm.sent[-1] > HOME) and np.all(arm.sent[-1] < GOAL)
    for gripper in stand.grippers.values():
        assert (gripper.closures[-1], gripper.holds[-1]) == (0.5, 1.0)
    assert stand.loop.status.message.startswith(
        "the arm left was stopped (following_error)"
    )


def test_one_button_stops_both_for_good():
    stand = moving(TwoArmStand())
    assert stand.run(1.0)
    assert stand.run(0.1, {"safety.estop": np.ones(1)})
    released = {"safety.estop": np.zeros(1), "safety.release": np.ones(1)}
    assert not stand.run(1.0, released)
    assert [state for state, _ in stand.stops()] == [SafetyState.EMERGENCY_STOP] * 2
    assert "stopped by the user" in stand.loop.status.message


def test_one_override_slows_both():
    stand = moving(TwoArmStand())
    assert stand.run(1.0, {"safety.speed_override": np.full(1, 0.4)})
    unhurried = moving(TwoArmStand())
    assert unhurried.run(1.0)
    for name in ARMS:
        gone, usual = (s.arms[name].sent[-1] - HOME for s in (stand, unhurried))
        assert np.all(gone < 0.6 * usual)


def test_the_robots_time_is_the_newest_that_any_link_tells():
    left, right = FakeArm(), FakeArm()
    left.take = lambda: {STAMP: np.array([2.0])}
    right.take = lambda: {STAMP: np.array([1.9])}
    left.outputs = right.outputs = {}
    reader = HardwareReader([left, right], PERIOD)
    context = reader.CreateDefaultContext()
    context.SetDiscreteState(reader.EvalUniquePeriodicDiscreteUpdate(context))
    assert reader.GetOutputPort(STAMP).Eval(context) == [2.0]


FILE = """
arms:
  left: {arm: !Ros2Arm {external_torque: felt}, gripper: !Ros2Gripper {}}
  right: {arm: !Ros2Arm {}, gripper: !Ros2Gripper {command: /hand}}
"""


def test_topics_of_drivers_begin_with_the_arms_name(monkeypatch):
    node, published = FakeNode(), []
    node.publish = lambda topic: published.append(topic.name)
    monkeypatch.setattr(Nodes, "of", lambda _, version: node)

    def deliver(self):
        names = [f"{arm}_joint_{i}" for arm in ARMS for i in range(1, 8)]
        for own in robot_arms(scenario()):
            names += [own.system(joint) for joint in own.gripper.joint_names]
        q = [*HOME, *(HOME + 1.0), *np.full(len(names) - 14, 0.3)]
        node.deliver("/joint_states", joint_state(1.0, names, q, np.zeros(len(names))))
        node.deliver("/left/felt", array(np.arange(7.0)))

    monkeypatch.setattr(Nodes, "open", deliver)
    config = parse_hardware(FILE, "f")
    with open_hardware(scenario(), config, Warnings(print)) as hardware:
        assert hardware.start["left.state_measured"][0] == HOME[0]
        assert hardware.start["right.state_measured"][0] == HOME[0] + 1.0
        assert hardware.start["left.external_torque"][6] == 6.0
        assert hardware.start["right.gripper.state_measured"][0] == 0.3
    assert published == [
        *("/left/joint_trajectory", "/left/grasp", "/left/startgrasp"),
        *("/right/joint_trajectory", "/hand", "/right/startgrasp"),
    ]
    assert node.hears("/right/gripper/proximity")


def test_drivers_of_the_only_arm_have_topics_without_a_name():
    node = FakeNode()
    robot, published = node.robot(), []
    node.publish = lambda topic: published.append(topic.name)
    for driver in (Ros2Arm(), Ros2Gripper()):
        driver.connect(robot)
    assert published == ["/joint_trajectory", "/grasp", "/startgrasp"]


def arms(**kinds):
    return HardwareConfig(
        arms={name: ArmHardware(**kind) for name, kind in kinds.items()}
    )


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (HardwareConfig(), "hardware: arms.left.arm: missing, but the scenario has"),
        (arms(left={}), "hardware: arms.right.arm: missing, but the scenario has this"),
        (
            arms(left={}, right={}, middle={}),
            r"hardware: arms.middle: .* no such arm \(allowed: left, right\)",
        ),
        (
            arms(left={}, right={"arm": Ros2Arm(command="/left/joint_trajectory")}),
            "hardware: arms.right.arm.command: arms.left.arm.command has "
            "/left/joint_trajectory, too",
        ),
        (
            arms(
                left={"gripper": Ros2Gripper(proximity="/near")},
                right={"gripper": Ros2Gripper(proximity="/near")},
            ),
            "hardware: arms.right.gripper.proximity: arms.left.gripper.proximity has",
        ),
        (
            arms(
                left={},
                right={"arm": Ros2Arm(joints=[f"left_joint_{i}" for i in range(1, 8)])},
            ),
            "hardware: arms.right.arm.state: arms.left.arm.state has left_joint_1 in "
            "/joint_states, too",
        ),
        (
            arms(left={}, right={"arm": Ros2Arm(joints=["a"])}),
            "arms.right.arm.joints: needs one name for each of right_joint_1",
        ),
    ],
)
def test_what_does_not_fit_the_scenario_is_told_with_the_arms_name(config, words):
    with (
        pytest.raises(ScenarioError, match=f"^{words}") as error,
        open_hardware(scenario(), config, Warnings(print)),
    ):
        pass
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "arms: {left: {arm: !Ros2Arm {}}}",
            "arms.left.gripper: missing (allowed: !Ros",
        ),
        ("arms: {left: 3}", "arms.left.arm: missing"),
        (f"{FILE}arm: !Ros2Arm {{}}", "arm: must be absent with arms"),
        ("arms: {}", "arm: missing (allowed: !Ros1Arm"),
        (FILE.replace("felt", "[1]"), "arms.left.arm.external_torque: "),
        (FILE.replace("command", "comand"), "arms.right.gripper"),
    ],
)
def test_mistakes_in_a_file_are_told_with_the_arms_name(text, words):
    with pytest.raises(ScenarioError, match=r"^f: ") as error:
        parse_hardware(text, "f")
    assert words in str(error.value)


def test_the_planners_process_reads_the_same_drivers():
    from pydrake.common.yaml import yaml_dump_typed

    config = parse_hardware(FILE, "f")
    again = read_typed(HardwareConfig, yaml_dump_typed(config))
    assert again.arms["left"].arm.external_torque == "felt"
    assert again.arms["right"].gripper.command == "/hand"


def test_a_planner_that_feels_needs_arms_that_tell_torques():
    links = [
        NamedLink(part, own)
        for own in robot_arms(load_scenario("handover"))
        for part in (FakeArm(), FakeGripper())
    ]
    words = "^hardware: arms.left.arm: does not tell external torques, which"
    with pytest.raises(ScenarioError, match=words):
        MakeHardwareStation(load_scenario("handover"), Hardware(links, {}, {}))


def test_an_arm_must_start_at_its_home_and_a_stop_is_final(monkeypatch):
    import contextlib

    from drake_srg.robot.drive import run

    away = {"left": HOME, "right": HOME + 0.1}
    states = {f"{n}.state_measured": np.append(q, q) for n, q in away.items()}

    @contextlib.contextmanager
    def opened(*arguments, **options):
        yield Hardware([], {}, states)

    monkeypatch.setattr(run, "open_hardware", opened)
    with pytest.raises(ScenarioError, match=r"two: arms\.right\.arm\.home: the arm"):
        run_on_hardware(scenario(), arms(left={}, right={}), name="two")
    states["right.state_measured"] = states["left.state_measured"]
    config = arms(left={}, right={})
    config.release = 5.0
    with pytest.raises(ScenarioError, match="two: release: must be 0 with several"):
        run_on_hardware(scenario(), config, name="two")
