import contextlib

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    ConstantValueSource,
    ConstantVectorSource,
    TrajectorySource,
)
from pydrake.trajectories import PiecewisePolynomial
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from drake_srg.common.safety_states import SafetyState, StopReason, state_indices
from drake_srg.recording import rosbag
from drake_srg.recording.rosbag import ArmNames, RosbagRecorder, Topic, cell_topics
from drake_srg.types import Mode
from recording.recording_sources import RED, Sweep

ARM, GRIPPER = ["a1", "a2"], ["left_base", "right_base"]
TOPICS = cell_topics([ArmNames(ARM, GRIPPER, 2)], {"top": 0.25})


def make(path, torque=True):
    """A diagram that records the ports of a cell."""
    ramp = PiecewisePolynomial.FirstOrderHold([0.0, 10.0], [[0.0, 10.0]])
    sources = {
        "arm.state_measured": ConstantVectorSource([1.0, 2.0, 3.0, 4.0]),
        "gripper.state_measured": ConstantVectorSource([0.1, 0.2, 0.3, 0.4]),
        "arm.position_commanded": ConstantVectorSource([5.0, 6.0]),
        "gripper.closure_commanded": TrajectorySource(ramp),
        "gripper.proximity": ConstantVectorSource([0.01, np.inf]),
        "gripper.contact_force": ConstantVectorSource([0.0, 3.0]),
        "planner.mode": ConstantValueSource(AbstractValue.Make(Mode.PRE_GRASP)),
        "camera_top.color_image": Sweep(),
    }
    if torque:
        sources["arm.torque_measured"] = ConstantVectorSource([7.0, 8.0])
    builder = DiagramBuilder()
    recorder = builder.AddSystem(RosbagRecorder(path, TOPICS, period=0.1))
    for name, source in sources.items():
        builder.AddSystem(source)
        builder.Connect(source.get_output_port(), recorder.GetInputPort(name))
    return builder.Build(), recorder


def run(path, until=1.0, torque=True):
    diagram, recorder = make(path, torque)
    with recorder:
        Simulator(diagram).AdvanceTo(until)
        assert not path.exists()
    return diagram


def read(path):
    """Return topic to (type, stamps [ns], messages)."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    topics = {}
    with Reader(path) as reader:
        for connection, time, raw in reader.messages():
            entry = topics.setdefault(connection.topic, (connection.msgtype, [], []))
            entry[1].append(time)
            entry[2].append(store.deserialize_cdr(raw, connection.msgtype))
    return topics


def test_a_monitored_station_has_topics_of_its_stops():
    names = ArmNames(ARM, GRIPPER, 2, safety="safety")
    topics = {t.name: t for t in cell_topics([names])}
    assert topics.keys() - {t.name for t in TOPICS} == {
        "/safety/state",
        "/safety/speed_scale",
    }
    stale = state_indices(SafetyState.BRAKING, StopReason.STALE)
    message = topics["/safety/state"].convert(lambda kind, data: data, 0.0, stale)
    assert message == "braking: stale"


def ns(sec, nanosec):
    return sec * 10**9 + nanosec


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bag") / "recording.mcap"
    run(path, 1.24)
    assert list(path.parent.iterdir()) == [path]
    return read(path)


def test_topics_have_their_message_types(bag):
    assert {name: kind for name, (kind, _, _) in bag.items()} == {
        "/clock": "rosgraph_msgs/msg/Clock",
        "/joint_states": "sensor_msgs/msg/JointState",
        "/arm/position_commanded": "std_msgs/msg/Float64MultiArray",
        "/gripper/closure_commanded": "std_msgs/msg/Float64",
        "/gripper/proximity": "std_msgs/msg/Float64MultiArray",
        "/gripper/contact_force": "std_msgs/msg/Float64MultiArray",
        "/planner/mode": "std_msgs/msg/String",
        "/camera_top/color/image_raw": "sensor_msgs/msg/Image",
    }


def test_stamps_are_simulated_time_and_start_after_one_period(bag):
    for name, (_, times, _) in bag.items():
        step = 250_000_000 if "camera" in name else 100_000_000
        assert times == [step * k for k in range(1, len(times) + 1)]
        assert len(times) == int(1.24e9 // step)
    _, times, messages = bag["/clock"]
    assert [ns(m.clock.sec, m.clock.nanosec) for m in messages] == times
    for name in ("/joint_states", "/camera_top/color/image_raw"):
        _, times, messages = bag[name]
        stamps = [m.header.stamp for m in messages]
        assert [ns(s.sec, s.nanosec) for s in stamps] == times


def test_joint_states_contain_arm_and_gripper(bag):
    message = bag["/joint_states"][2][0]
    assert message.name == ARM + GRIPPER
    assert message.position.tolist() == [1.0, 2.0, 0.1, 0.2]
    assert message.velocity.tolist() == [3.0, 4.0, 0.3, 0.4]
    np.testing.assert_array_equal(message.effort, [7.0, 8.0, np.nan, np.nan])


def test_numbers_and_words_are_the_values_of_the_ports(bag):
    assert bag["/arm/position_commanded"][2][-1].data.tolist() == [5.0, 6.0]
    assert bag["/gripper/proximity"][2][-1].data.tolist() == [0.01, np.inf]
    assert bag["/gripper/contact_force"][2][-1].data.tolist() == [0.0, 3.0]
    assert bag["/planner/mode"][2][-1].data == "pre_grasp"
    closure = [m.data for m in bag["/gripper/closure_commanded"][2]]
    np.testing.assert_allclose(closure, 0.1 * np.arange(1, 13))


def test_images_are_rgb(bag):
    for k, message in enumerate(bag["/camera_top/color/image_raw"][2], start=1):
        assert (message.height, message.width) == (48, 64)
        assert (message.encoding, message.step) == ("rgb8", 192)
        assert message.header.frame_id == "camera_top"
        pixels = message.data.reshape(48, 64, 3)
        assert (pixels[5] == RED[:3]).all(axis=1).sum() == int(10 * 0.25 * k + 0.5)


def test_equal_runs_give_equal_bytes(tmp_path):
    paths = [tmp_path / name / "recording.mcap" for name in "ab"]
    for path in paths:
        run(path, 0.5)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_the_torque_port_is_optional(tmp_path):
    run(tmp_path / "r.mcap", 0.1, torque=False)
    assert np.isnan(read(tmp_path / "r.mcap")["/joint_states"][2][0].effort).all()


def test_an_unconnected_port_is_named(tmp_path):
    with (
        RosbagRecorder(tmp_path / "r.mcap", TOPICS) as recorder,
        pytest.raises(RuntimeError, match=r"port '.*' \(/.*\) is not connected"),
    ):
        Simulator(recorder).AdvanceTo(0.05)


def test_users_can_add_topics_and_skip_messages(tmp_path):
    def convert(make, time, value):
        if value[0] < 2.0:
            return None
        return make("std_msgs/msg/Bool", data=True)

    topic = Topic("/heavy", "std_msgs/msg/Bool", {"weight": 1}, convert, period=0.5)
    with RosbagRecorder(tmp_path / "r.mcap", [topic]) as recorder:
        context = recorder.CreateDefaultContext()
        simulator = Simulator(recorder, context)
        for weight in (1.0, 3.0):
            recorder.GetInputPort("weight").FixValue(context, [weight])
            simulator.AdvanceTo(context.get_time() + 1.0)
    assert read(tmp_path / "r.mcap")["/heavy"][1] == [1_500_000_000, 2_000_000_000]


def test_topics_can_share_a_port(tmp_path):
    topics = [rosbag.float64(name, "x") for name in ("/a", "/b")]
    with RosbagRecorder(tmp_path / "r.mcap", topics) as recorder:
        assert recorder.num_input_ports() == 1


@pytest.mark.parametrize(
    ("topics", "arguments", "message"),
    [
        ([], {}, "unique names, got"),
        ([rosbag.clock()] * 2, {}, "unique names, got .*'/clock', '/clock'"),
        (
            [rosbag.clock()],
            {"period": 0.0},
            r"/clock: period must be greater than 0, got 0\.0",
        ),
        (
            [rosbag.clock()],
            {"path": "bag.db3"},
            r"must end in .mcap, got 'bag\.db3'",
        ),
        (
            [rosbag.float64("/a", "x"), rosbag.float64_array("/b", "x", 3)],
            {},
            "/b: port 'x' is 3 here and 1 in another topic",
        ),
    ],
)
def test_errors_name_the_bad_argument(tmp_path, topics, arguments, message):
    path = tmp_path / arguments.pop("path", "r.mcap")
    with pytest.raises(ValueError, match=message):
        RosbagRecorder(path, topics, **arguments)


def test_a_closed_recorder_says_so_and_closing_twice_is_fine(tmp_path):
    diagram, recorder = make(tmp_path / "r.mcap")
    recorder.close()
    recorder.close()
    with pytest.raises(RuntimeError, match=r"r\.mcap: the recorder is closed"):
        Simulator(diagram).AdvanceTo(0.1)


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt, SystemExit])
def test_a_recording_up_to_an_error_is_kept(tmp_path, error):
    diagram, recorder = make(tmp_path / "r.mcap")
    with pytest.raises(error), recorder:
        Simulator(diagram).AdvanceTo(0.2)
        raise error
    with Reader(tmp_path / "r.mcap") as reader:
        stamps = {stamp for _, stamp, _ in reader.messages()}
    assert max(stamps) == 200_000_000
    assert list(tmp_path.iterdir()) == [tmp_path / "r.mcap"]


@pytest.mark.parametrize("error", [None, KeyboardInterrupt])
def test_a_recording_stopped_before_its_first_message_is_an_empty_bag(tmp_path, error):
    with (
        contextlib.suppress(KeyboardInterrupt),
        RosbagRecorder(tmp_path / "r.mcap", [rosbag.clock()]),
    ):
        if error:
            raise error
    with Reader(tmp_path / "r.mcap") as reader:
        assert reader.message_count == 0


def test_an_error_before_the_first_message_leaves_nothing(tmp_path):
    with (
        pytest.raises(ZeroDivisionError),
        RosbagRecorder(tmp_path / "r.mcap", [rosbag.clock()]),
    ):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())
