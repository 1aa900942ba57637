import json
import multiprocessing as mp
import queue

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo
from rosbags.typesys import Stores, get_typestore

from drake_srg.robot.serve import pictures as pictures_module
from drake_srg.robot.serve.bridge import Outlet
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.pictures import (
    BLOBS,
    CAMERA_INFO,
    COLOR,
    DEPTH,
    OBJECT_POSE,
    CameraProcess,
    Pictures,
    Viewer,
    camera_topics,
    served_camera,
    served_cameras,
)
from drake_srg.scenario import load_scenario, servo_of
from drake_srg.station.plant import AddPlant
from drake_srg.types import Blob, BlobFlag
from robot.serve.fake_bridge import FakeBridge
from robot.serve.waiting import wait_until

INFO = CameraInfo(640, 480, 579.4, 580.6, 319.5, 239.5)
TOPICS = camera_topics("ceiling", INFO, "can")


@pytest.fixture(params=[Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE])
def send(request):
    """Convert values to a message, through the wire format of ROS 1 or ROS 2."""
    store = get_typestore(request.param)
    ros1 = request.param == Stores.ROS1_NOETIC

    def make(kind, *values, **fields):
        if ros1 and kind == "std_msgs/msg/Header":
            fields["seq"] = 0
        return store.types[kind](*values, **fields)

    def send(name, *values):
        topic = TOPICS[name]
        message = topic.convert(make, 1.25, *values)
        if ros1:
            content = store.serialize_ros1(message, topic.type)
            return store.deserialize_ros1(content, topic.type)
        content = store.serialize_cdr(message, topic.type)
        return store.deserialize_cdr(content, topic.type)

    return send


def test_a_colour_image_arrives_unchanged(send):
    pixels = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    message = send(COLOR, pixels)
    assert (message.height, message.width, message.step) == (48, 64, 192)
    assert message.encoding == "rgb8"
    assert message.header.frame_id == "camera_ceiling"
    stamp = message.header.stamp
    assert (stamp.sec, stamp.nanosec) == (1, 250_000_000)
    np.testing.assert_array_equal(message.data.reshape(48, 64, 3), pixels)


def test_a_depth_image_is_in_metres_with_the_infinities_of_rep_118(send):
    pixels = np.array([[0.0, 1.5], [np.inf, 2.25]], dtype=np.float32)
    message = send(DEPTH, pixels)
    assert (message.encoding, message.step) == ("32FC1", 8)
    seen = message.data.view(np.float32).reshape(2, 2)
    np.testing.assert_array_equal(seen, [[-np.inf, 1.5], [np.inf, 2.25]])


def test_camera_info_counts_pixels_from_the_centre_of_the_first(send):
    message = send(CAMERA_INFO)
    K = message.K if hasattr(message, "K") else message.k  # ROS 1, ROS 2
    np.testing.assert_allclose(
        K.reshape(3, 3), [[579.4, 0, 319.0], [0, 580.6, 239.0], [0, 0, 1]]
    )
    assert (message.width, message.height) == (640, 480)


def test_blobs_are_json_with_every_field(send):
    blob = Blob(
        "can",
        "ceiling",
        (320.5, 240.25),
        RigidTransform(RotationMatrix.MakeZRotation(np.pi / 2), [0.5, 0.1, 0.05]),
        0.9,
        frozenset({BlobFlag.OCCLUDED}),
    )
    half = np.sqrt(0.5)
    text = json.loads(send(BLOBS, [blob]).data)
    assert text == {
        "stamp": 1.25,
        "frame_id": "world",
        "blobs": [
            {
                "object_name": "can",
                "camera": "ceiling",
                "pixel": [320.5, 240.25],
                "position": [0.5, 0.1, 0.05],
                "axis": [0.0, 0.0, 1.0],
                "orientation": pytest.approx({"x": 0, "y": 0, "z": half, "w": half}),
                "quality": 0.9,
                "flags": ["occluded"],
            }
        ],
    }


def seen(name, x, *flags, misfit=0.0):
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(np.pi / 2), [x, 0.1, 0.05])
    return Blob(name, "ceiling", (0.0, 0.0), X_WO, 0.9, frozenset(flags), misfit)


def test_the_object_pose_is_that_of_the_most_trustworthy_certain_blob(send):
    uncertain = seen("can", 0.1, BlobFlag.UNCERTAIN)
    blobs = [
        uncertain,
        seen("box", 0.2),
        seen("can", 0.3, misfit=0.2),
        seen("can", 0.4),
    ]
    message = send(OBJECT_POSE, blobs)
    assert message.header.frame_id == "world"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 250_000_000)
    p, q = message.pose.position, message.pose.orientation
    assert (p.x, p.y, p.z) == (0.4, 0.1, 0.05)
    assert (q.x, q.y, q.z, q.w) == pytest.approx((0, 0, np.sqrt(0.5), np.sqrt(0.5)))


def test_there_is_no_message_of_an_object_that_is_not_certain_to_be_seen():
    uncertain = seen("can", 0.1, BlobFlag.UNCERTAIN)
    for blobs in ([], [seen("box", 0.2)], [uncertain]):
        assert TOPICS[OBJECT_POSE].convert(None, 1.25, blobs) is None


KITCHEN = load_scenario("kitchen")


class FakeProcess:
    """Stands in for `CameraProcess`."""

    def __init__(self, scenario, camera, state, show, warnings):
        self.camera, self.state, self.show = camera, state, show
        self.scenario = scenario
        self.idle, self.is_closed, self.looks = True, False, []

    def look(self, time, state, topics):
        self.looks.append((time, topics))

    def close(self):
        self.is_closed = True


@pytest.fixture
def made(monkeypatch):
    """The processes made so far."""
    made = []

    def make(*arguments):
        made.append(FakeProcess(*arguments))
        return made[-1]

    monkeypatch.setattr(pictures_module, "CameraProcess", make)
    return made


def plant_state():
    return np.arange(3.0)


def look(pictures, time, *wanted):
    bridge = FakeBridge(wanted=lambda name: name in wanted)
    pictures.look(time, plant_state, Outlet([bridge], Warnings(print)))
    return bridge


@pytest.mark.parametrize("name", ["clear_table", "sort_table", "row_table"])
def test_where_objects_of_any_shape_are_cleared_there_are_pictures_alone(name):
    served, *_ = served_cameras(load_scenario(name))
    assert served.topics.keys() == {COLOR, DEPTH, CAMERA_INFO}
    Viewer(served.scenario, served.name)


def test_the_camera_above_a_bin_is_served_too():
    _, above = served_cameras(load_scenario("clear_table"), period=0.2)
    assert (above.name, above.period) == ("bin", 0.2)
    names = {topic.name for topic in above.topics.values()}
    assert "/camera_bin/depth/image_raw" in names
    Viewer(above.scenario, above.name)


def test_the_camera_of_a_visual_servo_is_served_too(made):
    scenario = load_scenario("kitchen_servoing")
    pictures = Pictures(scenario, Warnings(print))
    hand = "/camera_hand/color/image_raw"
    assert {COLOR, hand, "/camera_hand/color/camera_info"} < set(pictures.topics)
    period = servo_of(scenario).camera_period
    bridge = look(pictures, 0.0, hand)
    for step in range(1, 5):
        look(pictures, 0.5 * step * period, hand)
    (process,) = made
    assert process.camera == "hand"
    assert set(process.scenario.cameras) == {"hand"}
    assert [time for time, _ in process.looks] == [0.5 * period, 1.5 * period]
    process.show(0.1, COLOR, ("pixels",))
    assert bridge.messages == {hand: [(0.1, ("pixels",))]}


def test_a_scenario_without_cameras_has_no_topics(made):
    overrides = ["cameras={}", "recording.video_camera=''"]
    scenario = load_scenario("gripper_bench", overrides=overrides)
    assert served_camera(scenario) is None
    pictures = Pictures(scenario, Warnings(print))
    assert pictures.topics == {}
    look(pictures, 0.0, COLOR)
    pictures.close()
    assert made == []


def test_a_scenario_with_a_soft_object_has_no_topics():
    soft = "objects.sponge={shape: !Box {}, soft: {}, mass: 0.1, friction: 0.5}"
    scenario = load_scenario("gripper_bench", overrides=[soft])
    assert Pictures(scenario, Warnings(print)).topics == {}


@pytest.mark.parametrize(
    ("name", "camera"), [("kitchen", "ceiling"), ("gripper_bench", "overview")]
)
def test_the_localizer_s_or_the_scenario_s_first_camera_is_served(name, camera):
    assert served_camera(load_scenario(name))[0] == camera


def test_the_process_starts_with_the_first_subscription(made):
    pictures = Pictures(KITCHEN, Warnings(print))
    topics = {COLOR, DEPTH, CAMERA_INFO, BLOBS, OBJECT_POSE}
    assert set(pictures.topics) == topics
    look(pictures, 0.0)
    assert made == []
    bridge = look(pictures, 0.1, COLOR)
    (process,) = made
    assert process.camera == "ceiling"
    np.testing.assert_array_equal(process.state, plant_state())
    process.show(0.1, DEPTH, ("pixels",))
    process.show(0.1, COLOR, ("pixels",))
    assert bridge.messages == {COLOR: [(0.1, ("pixels",))]}
    pictures.close()
    assert process.is_closed


@pytest.mark.parametrize(
    ("options", "times", "due"),
    [
        ({}, (0.0, 0.05, 0.1, 0.16, 0.2), [0.05, 0.16]),
        ({"period": 0.2}, (0.0, 0.05, 0.16, 0.24, 0.26), [0.05, 0.26]),
    ],
)
def test_pictures_of_subscribed_topics_are_due_once_a_period(made, options, times, due):
    pictures = Pictures(KITCHEN, Warnings(print), **options)
    for time in times:
        look(pictures, time, COLOR, BLOBS)
    look(pictures, 0.5)
    made[0].idle = False
    look(pictures, 1.0, DEPTH)
    assert made[0].looks == [(time, [COLOR, BLOBS]) for time in due]


SCENARIO = load_scenario("kitchen", overrides=["object.position=[0.6, 0.1]"])


@pytest.mark.slow
def test_a_picture_shows_the_given_state_until_the_process_dies(told):
    plant, shown = AddPlant(DiagramBuilder(), SCENARIO)[0], queue.Queue()
    context, others = plant.CreateDefaultContext(), mp.active_children()
    (body,) = plant.GetBodyIndices(plant.GetModelInstanceByName("soup_can"))
    body = plant.get_body(body)
    X_WO = plant.EvalBodyPoseInWorld(context, body)
    X_WO.set_translation(np.array([0.7, 0.1, X_WO.translation()[2]]))
    plant.SetFreeBodyPose(context, body, X_WO)
    state = plant.GetPositionsAndVelocities(context)
    cameras = CameraProcess(
        SCENARIO, "ceiling", state, lambda *seen: shown.put(seen), Warnings(told.append)
    )
    (process,) = set(mp.active_children()) - set(others)
    assert wait_until(lambda: cameras.idle, 60.0)
    cameras.look(0.0, state, [])
    assert cameras.idle
    cameras.look(2.5, state, [BLOBS])
    seen_at, topic, ((blob,),) = shown.get(timeout=60.0)
    assert (seen_at, topic) == (2.5, BLOBS)
    np.testing.assert_allclose(blob.position[:2], [0.7, 0.1], atol=0.001)
    process.kill()  # as the system does when memory runs out
    assert wait_until(lambda: told, 60.0)
    assert not cameras.idle
    cameras.look(3.0, state, [BLOBS])
    cameras.close()
    (text,) = told
    assert "the camera process has ended" in text
