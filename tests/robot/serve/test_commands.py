import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.safety_states import SafetyState, StopReason, safety_state
from drake_srg.robot.serve.commands import (
    CommandError,
    CommandInbox,
    Warnings,
    safety_topics,
    station_topics,
)
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import AddPlant
from robot.serve.test_loop import series, serve

SINGLE = "gripper.joint_position_commanded"
INPUTS = (
    *("gripper.closure_commanded", "gripper.hold", SINGLE),
    "arm.position_desired",
)
SCENARIO = load_scenario("kitchen")
JOINT_NAMES = SCENARIO.gripper.joint_names


@pytest.fixture(scope="module")
def kitchen():
    plant, _ = AddPlant(DiagramBuilder(), SCENARIO)
    return plant


@pytest.fixture
def inbox(kitchen, told):
    topics = station_topics(kitchen, INPUTS, JOINT_NAMES)
    return CommandInbox(topics, Warnings(told.append))


def test_a_full_station_has_the_topics_of_the_thesis(inbox):
    assert {topic.name: topic.type for topic in inbox.topics.values()} == {
        "/grasp": "std_msgs/msg/Int32",
        "/position_grasp": "std_msgs/msg/Float64MultiArray",
        "/startgrasp": "std_msgs/msg/Bool",
        "/kuka": "std_msgs/msg/Float64MultiArray",
    }


def test_a_station_without_arm_or_gripper_lacks_their_topics(kitchen):
    def names(*inputs):
        return {topic.name for topic in station_topics(kitchen, inputs)}

    assert names() == set()
    assert names("arm.position_desired") == {"/kuka"}
    assert names("gripper.closure_commanded", "gripper.hold") == {
        "/grasp",
        "/startgrasp",
    }


def test_startgrasp_false_holds_and_true_releases(inbox):
    inbox.receive("/startgrasp", False)
    assert inbox.take() == {"gripper.hold": [1.0]}
    inbox.receive("/startgrasp", True)
    assert inbox.take() == {"gripper.hold": [0.0]}


@pytest.mark.parametrize(
    ("topic", "data", "port"),
    [
        ("/grasp", 50, "gripper.closure_commanded"),
        ("/position_grasp", [0.1] * 4, SINGLE),
    ],
)
def test_a_gripper_command_cancels_those_of_other_sources(kitchen, topic, data, port):
    others = {
        "gripper.force_limit": 1,
        "gripper.motor_position_commanded": 1,
        "gripper.motor_torque_commanded": 1,
        SINGLE: 4,
    }
    topics = station_topics(kitchen, [*INPUTS, *others], JOINT_NAMES)
    inbox = CommandInbox(topics, Warnings(print))
    inbox.put({name: np.ones(size) for name, size in others.items()}, "servo")
    inbox.receive(topic, data)
    values = inbox.take()
    assert np.isfinite(values.pop(port)).all()
    others.pop(port, None)
    assert {name: value.size for name, value in values.items()} == others
    assert all(np.isnan(value).all() for value in values.values())


def test_each_grasp_is_counted_where_the_station_counts_messages(kitchen, told):
    messages = "gripper.closure_messages"
    topics = station_topics(kitchen, [*INPUTS, messages], JOINT_NAMES)
    inbox = CommandInbox(topics, Warnings(told.append))
    for number, percent in ((1.0, 50), (2.0, 50), (3.0, 60)):
        inbox.receive("/grasp", percent)
        inbox.receive("/kuka", [0.0] * 7)
        assert inbox.take()[messages] == [number]
    inbox.receive("/grasp", 101)
    inbox.receive("/position_grasp", [0.1] * 4)
    assert messages not in inbox.take()


def test_a_source_amends_its_command_until_another_source_commands(inbox):
    port = "gripper.closure_commanded"
    inbox.amend({port: np.array([0.1])}, "servo")
    assert inbox.take() == {}
    inbox.put({port: np.array([0.2])}, "servo")
    inbox.amend({port: np.array([0.3])}, "servo")
    assert (inbox.take()[port], inbox.source(port)) == ([0.3], "servo")
    inbox.receive("/grasp", 40)
    inbox.amend({port: np.array([0.3])}, "servo")
    assert (inbox.take()[port], inbox.source(port)) == ([0.4], "/grasp")


@pytest.mark.parametrize(
    "topic, data, words",
    [
        ("/kuka", [0.0] * 6, "needs 7 numbers, got 6"),
        ("/kuka", [0.0] * 6 + [np.nan], "needs finite numbers"),
        ("/kuka", [0.0] * 6 + [np.inf], "needs finite numbers"),
        (
            "/kuka",
            [0.0, 0.0, 3.5, 0.0, 0.0, 0.0, 0.0],
            "number 3 must be -2.96706 to 2.96706, got 3.5",
        ),
        ("/grasp", 101, "must be 0 (open) to 100 (closed), got 101"),
        ("/grasp", -1, "must be 0 (open) to 100 (closed), got -1"),
        ("/position_grasp", [0.0] * 3, "needs 4 numbers, got 3"),
        ("/position_grasp", [0.0, 0.0, 0.0, 2.5], "number 4 must be"),
    ],
)
def test_an_invalid_command_is_refused_with_one_warning(
    inbox, told, topic, data, words
):
    for _ in range(3):
        inbox.receive(topic, data)
    assert inbox.take() == {}
    (text,) = told
    assert text.startswith(f"{topic}: ") and words in text
    assert inbox.received == 3


def test_a_gripper_with_one_motor_refuses_single_joints(kitchen, told):
    topics = station_topics(kitchen, ["gripper.closure_commanded"], JOINT_NAMES)
    inbox = CommandInbox(topics, Warnings(told.append))
    inbox.receive("/position_grasp", [0.0] * 4)
    assert inbox.take() == {}
    assert "one motor" in told[0] and "/position_grasp" in told[0]


@given(percents=st.lists(st.integers(-50, 150), min_size=1))
def test_the_last_good_command_is_never_lost(kitchen, percents):
    topics = station_topics(kitchen, ["gripper.closure_commanded"])
    inbox = CommandInbox(topics, Warnings(lambda _: None))
    for percent in percents:
        inbox.receive("/grasp", percent)
    good = [percent for percent in percents if 0 <= percent <= 100]
    assert inbox.take() == (
        {"gripper.closure_commanded": [good[-1] / 100]} if good else {}
    )
    assert inbox.take() == {}


def test_forgotten_trouble_is_reported_again(told):
    warnings = Warnings(told.append)
    for _ in range(2):
        warnings.warn("master", "gone")
        warnings.warn("master", "still gone")
    warnings.forget("master")
    warnings.forget("something else")
    warnings.warn("master", "gone again")
    assert told == ["gone", "gone again"]


HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
THERE, ELSEWHERE = HOME + 0.3, HOME - 0.1
PORTS = (
    "arm.position_commanded",
    "arm.position_allowed",
    "safety.state",
    "safety.speed_scale",
)
TOPICS = {topic.name: topic for topic in safety_topics(["safety.estop"])}


def run(script, until, told=None):
    """Serve a kitchen with a monitor; `script` has the messages by time."""
    left = dict(script)

    def act(bridge):
        for time in [time for time in left if bridge.time >= time]:
            for topic, data in left.pop(time).items():
                bridge.inbox.receive(topic, data)

    tell = (lambda text: None) if told is None else told.append
    bridge, _ = serve(
        act,
        until,
        overrides=["safety={}", "object.present=false"],
        ports=PORTS,
        tell=tell,
        wanted=lambda _: False,
    )
    return bridge


def test_a_button_pressed_for_less_than_a_period_is_seen():
    inbox = CommandInbox(TOPICS.values(), Warnings(print))
    taken = []
    for messages in ([True, False], [], [True], [False, True], [False], []):
        for message in messages:
            inbox.receive("/estop", message)
        taken.append({port: value[0] for port, value in inbox.take().items()})
    up, down = {"safety.estop": 0.0}, {"safety.estop": 1.0}
    assert taken == [down, up, down, down, up, {}]


def state_at(bridge, time):
    times, states = series(bridge, "safety.state")
    return safety_state(states[np.searchsorted(times, time)])


@pytest.fixture(scope="module")
def pressed():
    told = []
    script = {
        0.1: {"/kuka": THERE},
        0.8: {"/estop": True},
        1.2: {"/estop": False, "/kuka": ELSEWHERE},
        1.4: {"/release": True},
        1.7: {"/kuka": HOME},
    }
    return run(script, 3.2, told), told


def test_the_button_stops_the_arm_within_its_limits(pressed):
    times, allowed = series(pressed[0], "arm.position_allowed")
    assert state_at(pressed[0], 1.1) == (
        SafetyState.EMERGENCY_STOP,
        StopReason.EMERGENCY_STOP,
    )
    stopped = (times > 0.9) & (times < 1.4)
    assert np.ptp(allowed[stopped], axis=0).max() == 0.0
    acceleration = np.diff(allowed, 2, axis=0) / 0.005**2
    assert np.abs(acceleration).max() < 1.002 * 2.0 * 8.57


def test_no_command_from_before_the_release_moves_the_arm(pressed):
    times, allowed = series(pressed[0], "arm.position_allowed")
    assert state_at(pressed[0], 1.6) == (SafetyState.RUNNING, StopReason.NONE)
    still = (times > 0.9) & (times < 1.69)
    assert np.ptp(allowed[still], axis=0).max() == 0.0
    assert np.abs(allowed[-1] - HOME).max() < 0.02


def test_the_stop_is_told_once(pressed):
    assert pressed[1] == [
        "the arm is stopped (emergency_stop); /kuka waits for a /release"
    ]


def test_silence_stops_the_arm_while_a_heartbeat_lasts_and_percent_slow_it():
    script = {
        0.05: {"/speed_override": 50},
        0.1: {"/kuka": THERE},
        0.3: {"/heartbeat": True},
        0.34: {"/heartbeat": True},
        0.36: {"/heartbeat": False},
        0.6: {"/heartbeat": True},
    }
    bridge = run(script, 0.8)
    assert state_at(bridge, 0.59)[0] is SafetyState.RUNNING
    times, scale = series(bridge, "safety.speed_scale")
    assert scale[times < 0.59][-1, 0] == pytest.approx(0.5, abs=0.03)
    assert state_at(bridge, 0.67)[1] is StopReason.STALE


def test_commands_are_checked():
    assert safety_topics(["arm.position_desired"]) == []
    for percent in (-1, 101):
        with pytest.raises(CommandError, match="must be 0 to 100 percent"):
            TOPICS["/speed_override"].convert(percent)
