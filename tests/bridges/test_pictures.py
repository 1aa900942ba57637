import numpy as np
import pytest

from bridges.fake_bridge import FakeBridge
from drake_srg.bridges import pictures as pictures_module
from drake_srg.bridges.camera_process import Viewer
from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.outlet import Outlet
from drake_srg.bridges.pictures import Pictures, served_camera, served_cameras
from drake_srg.bridges.topics import BLOBS, CAMERA_INFO, COLOR, DEPTH, OBJECT_POSE
from drake_srg.scenario import load_scenario, servo_of

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


def test_the_served_camera_is_the_localizer_s_first():
    name, intrinsics = served_camera(KITCHEN)
    assert (name, intrinsics.width()) == ("ceiling", 640)


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


def test_without_a_localizer_the_scenario_s_first_camera_is_served():
    assert served_camera(load_scenario("gripper_bench"))[0] == "overview"


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


def test_the_process_starts_with_the_first_subscription(made):
    pictures = Pictures(KITCHEN, Warnings(print))
    topics = {COLOR, DEPTH, CAMERA_INFO, BLOBS, OBJECT_POSE}
    assert set(pictures.topics) == topics
    look(pictures, 0.0)
    assert made == []
    look(pictures, 0.1, COLOR)
    (process,) = made
    assert process.camera == "ceiling"
    np.testing.assert_array_equal(process.state, plant_state())
    pictures.close()
    assert process.is_closed


def test_pictures_of_subscribed_topics_are_due_every_tenth_of_a_second(made):
    pictures = Pictures(KITCHEN, Warnings(print))
    for time in (0.0, 0.05, 0.1, 0.16, 0.2):
        look(pictures, time, COLOR, BLOBS)
    look(pictures, 0.3)
    assert made[0].looks == [(0.05, [COLOR, BLOBS]), (0.16, [COLOR, BLOBS])]


def test_pictures_may_be_due_less_often(made):
    pictures = Pictures(KITCHEN, Warnings(print), period=0.2)
    for time in (0.0, 0.05, 0.16, 0.24, 0.26):
        look(pictures, time, COLOR)
    assert [time for time, _ in made[0].looks] == [0.05, 0.26]


def test_a_busy_process_gets_no_work(made):
    pictures = Pictures(KITCHEN, Warnings(print))
    look(pictures, 0.0, DEPTH)
    made[0].idle = False
    look(pictures, 0.1, DEPTH)
    assert made[0].looks == []


def test_a_picture_goes_to_the_subscribers(made):
    pictures = Pictures(KITCHEN, Warnings(print))
    bridge = look(pictures, 0.0, DEPTH)
    made[0].show(0.1, DEPTH, ("pixels",))
    made[0].show(0.1, COLOR, ("pixels",))
    assert bridge.messages == {DEPTH: [(0.1, ("pixels",))]}
