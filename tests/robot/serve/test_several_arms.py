"""A served station with several arms: whose topics are whose, and what is shared."""

import numpy as np
import pytest
from station.two_arm_station import two_arms

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.safety_states import SafetyState, safety_state
from drake_srg.common.systems import input_ports
from drake_srg.robot.drive.arm import joint_trajectory
from drake_srg.robot.serve.action_server import ACTION, goal_fields
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.connecting import BridgeOptions
from drake_srg.robot.serve.loop import (
    MakeServedStation,
    control_period,
    station_inbox,
)
from drake_srg.robot.serve.pictures import Pictures
from drake_srg.scenario import load_scenario
from experiments.stands.direct_node import make_message as make
from robot.serve import test_loop

ARMS = ("left", "right")
HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
AWAY = HOME + 0.1
JUMP = np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # too sudden
JOINTS = [f"joint_{i}" for i in range(1, 8)]


def scenario(change=lambda tree: None):
    """Two arms that follow trajectories."""

    def follow(tree):
        for each in tree["arms"].values():
            each["arm"] = {**each["arm"], "limits": None}
        change(tree)

    return two_arms(follow)


def is_state(topic):
    """Whether a topic needs no camera."""
    return not topic.startswith(("/camera", "/blobs", "/object_pose"))


def watched(tree):
    for each in tree["arms"].values():
        each["safety"] = {}


def serve(acts, until, change=lambda tree: None, ports=()):
    """Serve as fast as possible; call `acts[i](bridge)` once at i + 1 tenths of 1 s."""
    left, told = list(enumerate(acts, start=1)), []

    def act(bridge):
        while left and bridge.time >= 0.1 * left[0][0]:
            left.pop(0)[1](bridge)

    names = ("position_commanded", "gripper.closure_commanded")
    bridge, _ = test_loop.serve(
        act,
        until,
        name="two",
        scenario=scenario(change),
        wanted=is_state,
        ports=[*(f"{arm}.{name}" for arm in ARMS for name in names), *ports],
        tell=told.append,
    )
    bridge.told = told
    return bridge


def last(bridge, port):
    return bridge.updates[-1][1][port]


def test_topics_that_command_an_arm_begin_with_its_name():
    station = MakeServedStation(scenario(watched))
    inbox = station_inbox(scenario(watched), station, Warnings(print))
    own = ("grasp", "startgrasp", "position_grasp", "joint_trajectory", "kuka")
    assert [*inbox.topics] == [
        *(f"/{arm}/{name}" for arm in ARMS for name in own),
        *("/estop", "/release", "/heartbeat", "/speed_override"),
    ]
    ports = [name for name in input_ports(station) if "safety." in name]
    assert ports == [
        f"safety.{name}" for name in ("estop", "release", "speed_override", "heartbeat")
    ]


def test_each_camera_of_the_localizer_is_published():
    topics = Pictures(load_scenario("handover"), Warnings(print)).topics
    assert {"/camera/depth/image_raw", "/camera_front/depth/image_raw"} <= {*topics}


def test_a_station_polls_as_often_as_its_fastest_arm():
    served = scenario()
    served.arms["right"].arm.period = 0.5 * served.arms["left"].arm.period
    assert control_period(served) == served.arms["right"].arm.period


@pytest.fixture(scope="module")
def commanded():
    """A run in which each arm gets commands of its own."""

    def act(bridge):
        bridge.inbox.receive("/left/grasp", 40)
        bridge.inbox.receive("/right/kuka", AWAY)

    return serve([act], until=0.5)


def test_arms_obey_their_own_topics(commanded):
    np.testing.assert_allclose(last(commanded, "left.position_commanded"), HOME)
    np.testing.assert_allclose(last(commanded, "right.position_commanded"), AWAY)
    assert last(commanded, "left.gripper.closure_commanded") == [0.4]
    assert last(commanded, "right.gripper.closure_commanded") == [0.0]


def test_states_have_the_topics_of_a_recording(commanded):
    topics = {*commanded.messages}
    own = ("position_commanded", "gripper/proximity", "gripper/grasped", "gripper/pwm")
    assert {f"/{arm}/{name}" for arm in ARMS for name in own} <= topics
    assert {"/clock", "/joint_states"} <= topics
    assert not [name for name in topics if name.startswith(("/arm", "/gripper"))]


def trajectory(arm, q):
    names = [f"{arm}_{joint}" for joint in JOINTS]
    times = np.array([0.0, 0.2])
    return joint_trajectory("", names).convert(make, 0.0, times, np.stack([HOME, q]))


def test_joints_in_trajectories_have_the_names_of_the_joint_states():
    def act(bridge):
        bridge.inbox.receive("/left/joint_trajectory", trajectory("left", AWAY))
        bridge.inbox.receive("/right/joint_trajectory", trajectory("left", AWAY))

    bridge = serve([act], until=0.5)
    np.testing.assert_allclose(last(bridge, "left.position_commanded"), AWAY)
    np.testing.assert_allclose(last(bridge, "right.position_commanded"), HOME)
    (told,) = bridge.told
    assert told.startswith("/right/joint_trajectory: needs the joints right_joint_1")


def test_each_arm_has_an_action():
    def act(bridge):
        fields = goal_fields(make, bytes([1] * 16), trajectory("right", AWAY))
        kind = ACTION.send_goal.request_type
        request = make(kind, client=7, number=1, **fields)
        topic = ACTION.send_goal.request.replace("rq", "rq/right")
        bridge.inbox.receive_message(topic, request)

    bridge = serve([act], until=0.5)
    np.testing.assert_allclose(last(bridge, "left.position_commanded"), HOME)
    np.testing.assert_allclose(last(bridge, "right.position_commanded"), AWAY)
    reply = ACTION.send_goal.reply.replace("rr", "rr/right")
    ((_, (_, fill)),) = bridge.messages[reply]
    assert fill(make)["accepted"]


STATES = ("left.safety.state", "right.safety.state")


def test_one_button_stops_all_arms():
    acts = [
        lambda bridge: bridge.inbox.receive("/estop", True),
        lambda bridge: bridge.inbox.receive("/left/kuka", AWAY),
    ]
    bridge = serve(acts, until=0.4, change=watched, ports=STATES)
    for port in STATES:
        assert safety_state(last(bridge, port))[0] is SafetyState.EMERGENCY_STOP
    np.testing.assert_allclose(last(bridge, "left.position_commanded"), HOME)
    assert {text.partition(" is")[0] for text in bridge.told} == {
        "the arm left",
        "the arm right",
    }


def test_an_arm_that_is_stopped_leaves_the_other_its_commands():
    acts = [
        lambda bridge: bridge.inbox.receive("/left/kuka", HOME + JUMP),
        lambda bridge: bridge.inbox.receive("/right/kuka", HOME + 1e-4),
    ]
    bridge = serve(acts, until=0.4, change=watched, ports=STATES)
    states = [safety_state(last(bridge, port))[0] for port in STATES]
    assert states == [SafetyState.PROTECTIVE_STOP, SafetyState.RUNNING]
    np.testing.assert_allclose(last(bridge, "right.position_commanded"), HOME + 1e-4)


@pytest.mark.parametrize("option", ["servo", "dex1"])
def test_emulated_servos_and_hands_belong_to_one_arm(option):
    options = BridgeOptions(**{option: "left"})
    words = f"^serve: arms: --{option} takes one arm, got left, right"
    with pytest.raises(ScenarioError, match=words):
        options.connect(scenario(), None, [])
