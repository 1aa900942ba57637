import contextlib
import multiprocessing as mp
import os
import queue
import signal

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.pictures import BLOBS, COLOR, CameraProcess
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import AddPlant
from robot.serve.waiting import wait_until

pytestmark = pytest.mark.slow

SCENARIO = load_scenario("kitchen", overrides=["object.position=[0.6, 0.1]"])


class Shown:
    """Collects the pictures from the process."""

    def __init__(self):
        self._pictures = queue.Queue()

    def show(self, time, topic, values):
        self._pictures.put((time, topic, values))

    def next_after(self, look):
        """Return the picture that a call of `look` brings."""
        look()
        return self._pictures.get(timeout=60.0)


@pytest.fixture(scope="module")
def plant():
    return AddPlant(DiagramBuilder(), SCENARIO)[0]


@pytest.fixture(scope="module")
def state(plant):
    return plant.GetPositionsAndVelocities(plant.CreateDefaultContext())


@contextlib.contextmanager
def opened(state, show, tell):
    """Open a process that renders, once it is ready."""
    others = mp.active_children()
    cameras = CameraProcess(SCENARIO, "ceiling", state, show, Warnings(tell))
    assert wait_until(lambda: cameras.idle, 60.0)
    (process,) = set(mp.active_children()) - set(others)
    yield cameras, process
    cameras.close()


@pytest.fixture
def own(state, told):
    """A process of the test's own, which it may end."""
    with opened(state, Shown().show, told.append) as pair:
        yield pair


@pytest.fixture(scope="module")
def shared(state):
    """A process that all tests with it leave alive, and what it shows."""
    shown, told = Shown(), []
    with opened(state, shown.show, told.append) as (cameras, process):
        yield cameras, process, shown
    assert told == []


def test_a_picture_shows_the_given_state(plant, shared):
    cameras, _, shown = shared
    context = plant.CreateDefaultContext()
    (body,) = plant.GetBodyIndices(plant.GetModelInstanceByName("soup_can"))
    body = plant.get_body(body)
    X_WO = plant.EvalBodyPoseInWorld(context, body)
    X_WO.set_translation(np.array([0.7, 0.1, X_WO.translation()[2]]))
    plant.SetFreeBodyPose(context, body, X_WO)
    seen_at, topic, (blobs,) = shown.next_after(
        lambda: cameras.look(2.5, plant.GetPositionsAndVelocities(context), [BLOBS])
    )
    assert (seen_at, topic) == (2.5, BLOBS)
    (blob,) = blobs
    np.testing.assert_allclose(blob.position[:2], [0.7, 0.1], atol=0.001)


def test_the_process_stays_idle_when_no_topic_is_wanted(shared):
    cameras, _, _ = shared
    cameras.look(0.0, np.zeros(0), [])
    assert cameras.idle


def test_a_dead_process_is_reported_once_and_look_does_nothing(state, own, told):
    cameras, process = own
    process.kill()  # as the system does when memory runs out
    assert wait_until(lambda: told, 60.0)
    assert not cameras.idle
    cameras.look(1.0, state, [COLOR])
    cameras.close()
    (text,) = told
    assert "the camera process has ended" in text


def test_close_ends_a_process_that_does_not_react(own, told):
    cameras, process = own
    os.kill(process.pid, signal.SIGSTOP)
    cameras.close()
    assert process not in mp.active_children()
    assert told == []  # no failure


def test_ctrl_c_in_the_terminal_does_not_end_the_process(state, shared):
    cameras, process, shown = shared
    os.kill(process.pid, signal.SIGINT)
    shown.next_after(lambda: cameras.look(1.0, state, [COLOR]))
