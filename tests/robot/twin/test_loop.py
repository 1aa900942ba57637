"""A twin beside a robot that the test plays: no sockets, no second simulation."""

import dataclasses as dc
import functools

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.drive.config import parse_hardware
from drake_srg.robot.drive.opening import MakeRobots
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.twin.comparison import Sighting
from drake_srg.robot.twin.loop import Listener, Told, ToldArm, TwinLoop
from drake_srg.robot.twin.run import run_twin, status_text, twin_topics
from drake_srg.robot.twin.station import AddTwin, LagCompensation, MakeTwin
from drake_srg.scenario import load_scenario
from drake_srg.simulation.flat import MakeRoot
from experiments.stands.direct_node import DirectNode, make_message
from robot.drive.stand import HOME, joint_state

REST = np.append(HOME, np.zeros(7))
CAN = "soup_can"
FILE = "arm: !Ros2Arm {}\ngripper: !Ros2Gripper {}\n"


@functools.cache
def scenario():
    return load_scenario("kitchen_fast", seed=0, overrides=["twin.settle=0.3"])


QUIET = ToldArm(REST, np.full(7, np.nan), np.full(8, np.nan), 0.0)


def told(stamp, sightings=(), **changes):
    return Told(stamp, (dc.replace(QUIET, **changes),), sightings)


def make_loop(scenario, first):
    builder, twin = MakeRoot("twin", MakeTwin, AddTwin, scenario, "test")
    return TwinLoop("test", scenario, builder.Build(), twin, first)


@pytest.fixture
def loop():
    return make_loop(scenario(), told(100.0))


def follow(loop, begin, end, told=told, **changes):
    """Tell the same until a time; return the reports."""
    reports = []
    for stamp in np.arange(begin + 0.05, end + 1e-9, 0.05):
        reports += loop.follow(told(stamp, **changes))
    return reports


def seen(time, p_WO, clear=True):
    return (Sighting(CAN, time, RigidTransform(p_WO), clear),)


def test_its_clock_is_the_robots(loop):
    assert follow(loop, 100.0, 101.0) == []
    assert loop.time == pytest.approx(1.0, abs=scenario().twin.period)
    np.testing.assert_allclose(loop.value("arm.state_measured")[:7], HOME, atol=2e-3)


def test_an_arm_that_goes_where_the_table_is_differs(loop):
    down = REST.copy()
    down[:7] = [0.0, 1.95, 0.0, -0.2, 0.0, 0.3, 0.0]
    reports = []
    for share in np.linspace(0.0, 1.0, 40):
        state = (1.0 - share) * REST + share * down
        state[7:] = 0.5 * (down - REST)[:7]
        reports += loop.follow(told(100.0 + 2.0 * share + 0.05, state=state))
    reports += follow(loop, 102.05, 103.5, state=down)
    assert [report.kind for report in reports] == ["joint"]
    assert "joint" in reports[0].text


def test_a_gantry_differs_in_meters_and_newtons():
    gantry = load_scenario("gripper_bench", overrides=["twin.settle=0.1"])
    home = np.array(gantry.arm.home)
    own = functools.partial(
        told, state=np.append(home, np.zeros(3)), torque=np.array([500.0, 0.0, 0.0])
    )
    loop = make_loop(gantry, own(100.0))
    reports = follow(loop, 100.0, 101.0, told=own)
    assert [report.kind for report in reports] == ["torque"]
    assert " N more or less" in reports[0].text
    assert "joints 0.000 m, fingers" in status_text(loop)


def test_fingers_that_do_not_close_differ(loop):
    still = np.zeros(8)
    assert follow(loop, 100.0, 100.5, fingers=still) == []
    closed = {"fingers": still, "closure": 1.0}
    reports = follow(loop, 100.5, 101.7, **closed)
    assert [report.kind for report in reports] == ["finger"]
    assert "less closed" in reports[0].text
    assert follow(loop, 101.7, 102.0, **closed) == []  # once
    # Once it is over, the next one is reported anew.
    assert follow(loop, 102.0, 103.5, fingers=still, closure=0.0) == []
    reports = follow(loop, 103.5, 104.7, **closed)
    assert [report.kind for report in reports] == ["finger"]


def test_objects_are_put_where_they_are_first_seen_at_rest(loop):
    place = np.array([0.6, -0.1, 0.051])
    loop.follow(told(100.1, sightings=seen(100.1, place)))
    before = loop.value("object_poses_cheat")[CAN].translation()
    assert np.linalg.norm(before - place) > 0.05
    loop.follow(told(100.2, sightings=seen(100.2, place, clear=False)))
    loop.follow(told(100.3, sightings=seen(100.3, place + 0.1)))
    loop.follow(told(100.4, sightings=seen(100.4, place + 0.001)))
    follow(loop, 100.4, 101.0)
    after = loop.value("object_poses_cheat")[CAN].translation()
    assert np.linalg.norm(after - place) > 0.05  # not yet: it seems to move
    loop.follow(told(101.1, sightings=seen(101.1, place)))
    loop.follow(told(101.2, sightings=seen(101.2, place)))
    after = loop.value("object_poses_cheat")[CAN].translation()
    assert np.linalg.norm(after - place) < 0.005


def test_an_object_that_is_seen_elsewhere_differs_once(loop):
    place, other = np.array([0.7, 0.2, 0.051]), np.array([0.7, 0.0, 0.051])
    reports = []
    for i, p_WO in enumerate([place] * 5 + [other] * 15):
        stamp = 100.1 + 0.1 * i
        reports += loop.follow(told(stamp, sightings=seen(stamp - 0.02, p_WO)))
    assert [report.kind for report in reports] == ["object"]
    assert reports[0].difference == pytest.approx(0.2, abs=0.01)
    assert CAN in reports[0].text
    now = loop.value("object_poses_cheat")[CAN].translation()
    assert np.linalg.norm(now - other) < 0.005  # the camera was right


def test_torques_that_the_twin_does_not_expect_are_reported(loop):
    torque = np.zeros(7)
    for _ in range(3):  # what the motors hold the arm with, by the twin itself
        reports = follow(loop, 100.0 + loop.time, 100.5 + loop.time, torque=torque)
        torque = torque - loop.value("twin.torque_residual")
    begin = 100.0 + loop.time
    follow(loop, begin, begin + 0.5, torque=torque)
    assert np.abs(loop.value("twin.torque_residual")).max() < 0.1
    begin = 100.0 + loop.time
    heavier = torque + np.array([0.0, 8.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    reports = follow(loop, begin, begin + 0.5, torque=heavier)
    assert [report.kind for report in reports] == ["torque"]
    assert "joint 2 has 8.0 N m" in reports[0].text


def test_nothing_is_reported_for_a_while_after_lost_messages(loop):
    still = np.zeros(8)
    follow(loop, 100.0, 100.5, fingers=still)
    # For 0.6 s nothing arrives, then the gripper is commanded to be closed.
    assert loop.follow(told(101.1, fingers=still, closure=1.0)) == []
    assert loop.skipped == 0.0
    assert loop.time == pytest.approx(1.1, abs=0.02)


def test_a_clock_that_is_set_is_not_followed(loop):
    follow(loop, 100.0, 100.5)
    loop.follow(told(5000.0))
    assert loop.time < 0.6
    assert loop.skipped == pytest.approx(4899.5, abs=0.1)
    follow(loop, 5000.0, 5000.5)
    assert loop.time < 1.1


class Talk:
    """A listener and the messages that it gets."""

    def __init__(self, text=FILE, scenario=scenario):
        self.node = node = DirectNode()
        config = parse_hardware(text, "robot.yaml")
        robots = MakeRobots(scenario(), config, Warnings(print))
        object.__setattr__(robots[0].nodes, "_nodes", {1: node, 2: node})
        self.listener = Listener(config, scenario().twin, *robots)
        self.names = {robot.own.arm_model: robot.arm_joints for robot in robots}
        self.names |= {r.own.gripper_model: r.gripper_joints for r in robots}

    def joints(self, stamp, topic="/joint_states", **positions):
        """Tell positions by model, such as `arm` or `left_gripper`."""
        positions = positions or {"arm": HOME, "gripper": np.zeros(4)}
        names = [n for part in positions for n in self.names[part.replace("_", ".")]]
        q = np.concatenate([*positions.values()])
        message = joint_state(stamp, names, q, np.full(len(q), 0.5), np.arange(len(q)))
        return self.node.deliver(topic, message)

    def say(self, topic, kind, data):
        message = make_message(f"std_msgs/msg/{kind}", data=data)
        return self.node.deliver(topic, message)


def test_a_listener_tells_what_it_has_heard():
    talk = Talk()
    assert talk.listener.take() is None
    assert talk.say("/grasp", "Int32", 40) == []
    assert talk.listener.take() is None  # nothing about the arm
    talk.joints(1.0)
    heard = talk.listener.take()
    assert (heard.stamp, heard.arms[0].closure) == (1.0, 0.4)
    np.testing.assert_array_equal(heard.arms[0].torque, np.arange(7.0))
    talk.say("/gripper/closure_commanded", "Float64", 0.7)
    talk.joints(1.1)
    assert talk.listener.take().arms[0].closure == 0.7
    assert talk.listener.take() is None


@pytest.mark.parametrize(
    ("topic", "kind", "data", "why"),
    [
        ("/grasp", "Int32", 150, "must be 0 (open) to 100 (closed), got 150"),
        ("/grasp", "Int32", -1, "must be 0 (open) to 100 (closed), got -1"),
        (
            "/gripper/closure_commanded",
            "Float64",
            np.nan,
            "must be 0 (open) to 1 (closed), got nan",
        ),
        ("/blobs", "String", "{", ""),
    ],
)
def test_bad_messages_change_nothing(topic, kind, data, why):
    talk = Talk()
    (refusal,) = talk.say(topic, kind, data)
    assert why in refusal
    assert talk.joints(1.0, arm=HOME * np.nan) != []
    assert talk.listener.take() is None
    talk.joints(1.0)
    heard = talk.listener.take()
    assert heard.arms[0].closure is None
    assert heard.sightings == ()


def test_a_bus_has_one_master():
    with pytest.raises(ScenarioError, match="arm: a twin cannot listen"):
        Talk("arm: !DynamixelArm {}\ngripper: !Ros2Gripper {}\n")


PERIOD = 0.01


@pytest.mark.parametrize("lag", [0.0, 0.03, 0.1])
def test_it_makes_up_for_the_lag_of_the_driver(lag):
    system = LagCompensation(2, PERIOD)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    speed, commands, q = np.array([1.0, -0.5]), [], np.zeros(2)
    delay = round(lag / PERIOD)
    for k in range(300):
        target = k * PERIOD * speed
        system.GetInputPort("state_measured").FixValue(
            context, np.concatenate([target, speed])
        )
        system.GetInputPort("state").FixValue(context, np.concatenate([q, speed]))
        commands.append(system.get_output_port().Eval(context).copy())
        simulator.AdvanceTo((k + 1) * PERIOD)
        # The commanded arm is where it was sent a while ago.
        q = commands[max(k + 1 - delay, 0)] if delay else target + PERIOD * speed
        q = q if not delay else commands[max(len(commands) - delay, 0)]
    error = q - (target + PERIOD * speed)
    np.testing.assert_allclose(error, 0.0, atol=0.015)


def test_an_arm_at_rest_teaches_nothing():
    system = LagCompensation(1, PERIOD)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("state_measured").FixValue(context, [0.5, 0.0])
    system.GetInputPort("state").FixValue(context, [0.0, 0.0])  # something blocks it
    simulator.AdvanceTo(5.0)
    assert system.lag(context) == 0.0
    assert system.get_output_port().Eval(context)[0] == 0.5


# Two arms: whose messages are whose, and whose joint differs.

TWO = """
arms:
  left: {arm: !Ros2Arm {}, gripper: !Ros2Gripper {}}
  right: {arm: !Ros2Arm {state: joint_states}, gripper: !Ros2Gripper {}}
"""


@functools.cache
def two():
    return load_scenario("handover", overrides=["twin.settle=0.3"])


def both(stamp, **right):
    """Messages of two arms; `right` are those of the right one."""
    return Told(stamp, (QUIET, dc.replace(QUIET, **right)))


@pytest.fixture
def pair():
    return make_loop(two(), both(100.0))


def test_both_arms_follow_their_own_joints(pair):
    state = REST.copy()
    state[0] += 0.05
    assert follow(pair, 100.0, 101.5, told=both, state=state) == []
    for arm, own in (("left", HOME), ("right", state[:7])):
        reached = pair.value(f"{arm}.state_measured")[:7]
        np.testing.assert_allclose(reached, own, atol=3e-3)
    assert pair.value("twin.joint_error").shape == (14,)
    assert status_text(pair).startswith("twin: 1.5 s, joints 0.00")


def test_a_report_names_the_arm(pair):
    stuck = {"fingers": np.zeros(8), "closure": 1.0}
    reports = follow(pair, 100.0, 102.0, told=both, **stuck)
    (report,) = reports
    assert report.kind == "finger"
    assert "finger joint" in report.text and " of right is " in report.text


def test_only_the_arm_that_tells_its_torques_is_compared(pair):
    reports = follow(pair, 100.0, 103.0, told=both, torque=np.zeros(7))
    assert {report.kind for report in reports} == {"torque"}
    assert all(" of right has " in report.text for report in reports)


def test_topics_have_the_joints_of_all_arms():
    (error,) = [t for t in twin_topics(two()) if t.name == "/twin/joint_error"]
    assert [*error.ports.values()] == [14]


def test_a_listener_tells_once_it_has_heard_all_arms():
    talk = Talk(TWO, two)
    talk.say("/right/grasp", "Int32", 40)
    talk.joints(1.0, left=HOME, right_gripper=np.full(4, 0.2))
    assert talk.listener.take() is None
    talk.joints(1.1, "/right/joint_states", right=HOME + 1.0)
    heard = talk.listener.take()
    left, right = heard.arms
    assert (heard.stamp, left.closure, right.closure) == (1.1, None, 0.4)
    np.testing.assert_array_equal(left.state, [*HOME, *np.full(7, 0.5)])
    np.testing.assert_array_equal(right.state, [*(HOME + 1.0), *np.full(7, 0.5)])
    assert np.all(np.isnan(left.fingers))
    np.testing.assert_array_equal(right.fingers[:4], np.full(4, 0.2))
    assert talk.listener.take() is None


def test_arms_that_do_not_fit_are_told():
    config = parse_hardware(FILE, "f")
    with pytest.raises(ScenarioError, match=r"two: hardware: arms\.left\.arm: missing"):
        run_twin(two(), config, name="two")
    bus = TWO.replace("!Ros2Gripper", "!DynamixelGripper", 1)
    with pytest.raises(ScenarioError, match=r"^arms\.left\.gripper: a twin cannot"):
        Talk(bus.replace("Gripper {}", "Gripper {open: 9}", 1), two)
