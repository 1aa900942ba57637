import multiprocessing as mp
import queue

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.pictures import BLOBS, CameraProcess
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import AddPlant
from robot.serve.waiting import wait_until

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
