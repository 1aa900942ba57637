import multiprocessing as mp
import os
import signal
import threading

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from bridges.waiting import wait_until
from drake_srg.bridges.camera_process import CameraProcess
from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.topics import BLOBS, COLOR
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import AddPlant

pytestmark = pytest.mark.slow

SCENARIO = load_scenario("kitchen", overrides=["object.position=[0.6, 0.1]"])


class Shown:
    """Collects the pictures from the process."""

    def __init__(self):
        self.pictures = []
        self.arrived = threading.Event()

    def show(self, time, topic, values):
        self.pictures.append((time, topic, values))
        self.arrived.set()


@pytest.fixture(scope="module")
def plant():
    return AddPlant(DiagramBuilder(), SCENARIO)[0]


@pytest.fixture
def shown():
    return Shown()


@pytest.fixture
def state(plant):
    return plant.GetPositionsAndVelocities(plant.CreateDefaultContext())


@pytest.fixture
def cameras(state, shown, told):
    warnings = Warnings(told.append)
    cameras = CameraProcess(SCENARIO, "ceiling", state, shown.show, warnings)
    assert wait_until(lambda: cameras.idle, 60.0)
    yield cameras
    cameras.close()


@pytest.fixture
def process(cameras):
    """The process that renders."""
    (process,) = mp.active_children()
    return process


def test_a_picture_shows_the_given_state(plant, shown, cameras):
    context = plant.CreateDefaultContext()
    (body,) = plant.GetBodyIndices(plant.GetModelInstanceByName("soup_can"))
    body = plant.get_body(body)
    X_WO = plant.EvalBodyPoseInWorld(context, body)
    X_WO.set_translation(np.array([0.7, 0.1, X_WO.translation()[2]]))
    plant.SetFreeBodyPose(context, body, X_WO)
    cameras.look(2.5, plant.GetPositionsAndVelocities(context), [BLOBS])
    assert shown.arrived.wait(60.0)
    ((seen_at, topic, (blobs,)),) = shown.pictures
    assert (seen_at, topic) == (2.5, BLOBS)
    (blob,) = blobs
    np.testing.assert_allclose(blob.position[:2], [0.7, 0.1], atol=0.001)


def test_the_process_stays_idle_when_no_topic_is_wanted(cameras):
    cameras.look(0.0, np.zeros(0), [])
    assert cameras.idle


def test_a_dead_process_is_reported_once_and_look_does_nothing(
    state, cameras, process, told
):
    process.kill()  # as the system does when memory runs out
    assert wait_until(lambda: told, 60.0)
    assert not cameras.idle
    cameras.look(1.0, state, [COLOR])
    cameras.close()
    (text,) = told
    assert "the camera process has ended" in text


def test_close_ends_a_process_that_does_not_react(cameras, process):
    os.kill(process.pid, signal.SIGSTOP)
    cameras.close()
    assert process not in mp.active_children()


def test_close_is_not_reported_as_a_failure(cameras, told):
    cameras.close()
    assert told == []


def test_ctrl_c_in_the_terminal_does_not_end_the_process(
    state, shown, cameras, process
):
    os.kill(process.pid, signal.SIGINT)
    cameras.look(1.0, state, [COLOR])
    assert shown.arrived.wait(60.0)
