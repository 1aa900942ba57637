import threading

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from drake_srg.bridges.camera_process import CameraProcess
from drake_srg.bridges.topics import BLOBS, COLOR
from drake_srg.plant import MakePlant
from drake_srg.scenario import load_scenario

SCENARIO = load_scenario("kitchen", overrides=["object.position=[0.6, 0.1]"])


class Shown:
    """What comes from the process, as it comes."""

    def __init__(self):
        self.pictures = []
        self.came, self.failed = threading.Event(), threading.Event()

    def show(self, time, topic, values):
        self.pictures.append((time, topic, values))
        self.came.set()

    def wait_until_idle(self, cameras):
        ends = threading.Event()
        for _ in range(600):
            if cameras.idle:
                return
            ends.wait(0.1)
        raise TimeoutError


@pytest.fixture(scope="module")
def plant():
    return MakePlant(DiagramBuilder(), SCENARIO)[0]


@pytest.fixture
def shown():
    return Shown()


@pytest.fixture
def cameras(plant, shown):
    state = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    process = CameraProcess(SCENARIO, "ceiling", state, shown.show, shown.failed.set)
    shown.wait_until_idle(process)
    yield process
    process.close()


def test_it_shows_the_state_that_it_is_told(plant, shown, cameras):
    context = plant.CreateDefaultContext()
    (body,) = plant.GetBodyIndices(plant.GetModelInstanceByName("soup_can"))
    body = plant.get_body(body)
    X_WO = plant.EvalBodyPoseInWorld(context, body)
    X_WO.set_translation(np.array([0.7, 0.1, X_WO.translation()[2]]))
    plant.SetFreeBodyPose(context, body, X_WO)
    cameras.look(2.5, plant.GetPositionsAndVelocities(context), [BLOBS])
    assert shown.came.wait(60.0)
    ((time, topic, (blobs,)),) = shown.pictures
    assert (time, topic) == (2.5, BLOBS)
    (blob,) = blobs
    np.testing.assert_allclose(blob.position[:2], [0.7, 0.1], atol=0.001)


def test_who_asks_for_nothing_leaves_it_idle(plant, cameras):
    cameras.look(0.0, np.zeros(0), [])
    assert cameras.idle


def test_its_end_is_told_and_looking_goes_on_without(plant, shown, cameras):
    cameras._process.kill()  # as somebody short of memory would
    assert shown.failed.wait(10.0)
    assert not cameras.idle
    state = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    cameras.look(1.0, state, [COLOR])
    assert shown.pictures == []
