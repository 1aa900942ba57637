import os
import signal
import threading
import time

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from drake_srg.bridges.camera_process import CameraProcess
from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.topics import BLOBS, COLOR
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakePlant

SCENARIO = load_scenario("kitchen", overrides=["object.position=[0.6, 0.1]"])


class Shown:
    """What comes from the process, as it comes."""

    def __init__(self):
        self.pictures = []
        self.came = threading.Event()
        self.told = []

    def show(self, time, topic, values):
        self.pictures.append((time, topic, values))
        self.came.set()


def wait_until(condition):
    for _ in range(600):
        if condition():
            return
        time.sleep(0.1)
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
    warnings = Warnings(shown.told.append)
    process = CameraProcess(SCENARIO, "ceiling", state, shown.show, warnings)
    wait_until(lambda: process.idle)
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
    ((seen_at, topic, (blobs,)),) = shown.pictures
    assert (seen_at, topic) == (2.5, BLOBS)
    (blob,) = blobs
    np.testing.assert_allclose(blob.position[:2], [0.7, 0.1], atol=0.001)


def test_who_asks_for_nothing_leaves_it_idle(plant, cameras):
    cameras.look(0.0, np.zeros(0), [])
    assert cameras.idle


def test_its_end_is_told_and_looking_goes_on_without(plant, shown, cameras):
    cameras._process.kill()  # as somebody short of memory would
    wait_until(lambda: shown.told)
    assert "process has ended" in shown.told[0]
    assert not cameras.idle
    state = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    cameras.look(1.0, state, [COLOR])  # does nothing, and does not raise
    cameras.close()
    assert len(shown.told) == 1


def test_a_process_that_does_not_react_is_ended_all_the_same(cameras):
    os.kill(cameras._process.pid, signal.SIGSTOP)
    cameras.close()
    assert not cameras._process.is_alive()


def test_its_end_on_request_is_no_news(shown, cameras):
    cameras.close()
    assert shown.told == []


def test_ctrl_c_in_the_terminal_is_not_for_it(plant, shown, cameras):
    os.kill(cameras._process.pid, signal.SIGINT)
    state = plant.GetPositionsAndVelocities(plant.CreateDefaultContext())
    cameras.look(1.0, state, [COLOR])
    assert shown.came.wait(60.0)
