import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from drake_srg.learning.cell_planner import GraspPlanner
from drake_srg.learning.envs.scenes import CONTROL_PERIOD
from drake_srg.learning.envs.tasks import grasp_of
from drake_srg.learning.rules import grasp_one_shot
from drake_srg.types import Box, Failure, Mode

from .hand_planners import Straight, blob

THING = Box([0.04, 0.05, 0.08])
HOME = np.array([0.1, 0.0, 0.3, 0.0])
ACTION = np.array([0.5, -0.5, 0.0, 0.25, 0.0, 0.8])


def made(blobs, act=lambda _: ACTION):
    planner = GraspPlanner(act, Straight(), HOME, "thing", THING, 0.0)
    simulator = Simulator(planner)
    context = simulator.get_mutable_context()
    planner.GetInputPort("blobs").FixValue(context, AbstractValue.Make(blobs))

    def get(name):
        return planner.GetOutputPort(name).Eval(context)

    return simulator, get


def test_it_grasps_where_the_policy_says_and_then_shakes():
    simulator, get = made([blob(name="other"), blob()])
    grasp = grasp_of(ACTION, np.array([0.2, 0.1, 0.04, 0.3]), 0.0)
    seen = {}
    while get("mode") is not Mode.DONE:
        simulator.AdvanceTo(simulator.get_context().get_time() + CONTROL_PERIOD)
        q = get("position_commanded")
        seen.setdefault(get("mode"), []).append(np.append(q, get("closure_commanded")))
    assert [*seen] == [
        *(Mode.PRE_GRASP, Mode.GRASP, Mode.CLOSE, Mode.LIFT, Mode.VERIFY, Mode.DONE)
    ]
    for mode, target, closure in (
        (Mode.PRE_GRASP, grasp.over, 0.0),
        (Mode.GRASP, grasp.at, grasp.preshape),
        (Mode.CLOSE, grasp.at, grasp.closure),
        (Mode.LIFT, grasp.up, grasp.closure),
        (Mode.DONE, grasp.up, grasp.closure),
    ):
        np.testing.assert_allclose(seen[mode][-1], np.append(target, closure))
    assert np.ptp(np.array(seen[Mode.VERIFY])[:, 0]) > 0.05  # m
    status = get("status")
    assert (status.attempts, status.localization.object_name) == (1, "thing")


def test_the_hand_never_jumps():
    simulator, get = made([blob()])
    last = HOME
    for k in range(600):
        simulator.AdvanceTo(k * 0.01)
        q = get("position_commanded")
        assert np.abs(q - last).max() < 0.02
        last = q


@pytest.mark.parametrize("blobs", [[], [blob(name="other")], [blob((1.5, 0.0, 0.0))]])
def test_without_a_standing_object_it_gives_up(blobs):
    simulator, get = made(blobs)
    simulator.AdvanceTo(2.0)
    assert get("mode") is Mode.FAILED
    assert get("status").failure is Failure.NOT_SEEN
    np.testing.assert_array_equal(get("position_commanded"), HOME)


def test_a_policy_sees_what_it_saw_in_the_environment():
    seen = []

    def act(observation):
        seen.append(observation)
        return grasp_one_shot(observation)

    simulator, _ = made([blob()], act)
    simulator.AdvanceTo(1.0)
    (observation,) = seen
    np.testing.assert_allclose(observation, [4 / 15, 5 / 15, 8 / 15, 0.0], rtol=1e-6)
