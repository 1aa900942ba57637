import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from drake_srg.learning.cell_planner import OneShotPlanner, PolicyPlanner
from drake_srg.learning.envs.episode_station import SimulationError
from drake_srg.learning.envs.scenes import CONTROL_PERIOD, Workspace
from drake_srg.learning.envs.tasks import MAX_STEPS, STEP, PickEnv, grasp_of, pick_state
from drake_srg.learning.rules import grasp_one_shot
from drake_srg.types import Box, Failure, Mode

from .hand_planners import Straight, blob

THING = Box([0.04, 0.05, 0.08])
HOME = np.array([0.1, 0.0, 0.3, 0.0])
ACTION = np.array([0.5, -0.5, 0.0, 0.25, 0.0, 0.8])


def made(blobs, act=lambda _: ACTION):
    planner = OneShotPlanner(act, Straight(), HOME, "thing", THING, 0.0)
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


# Planners that act step by step.

ABOVE = np.array([0.0, 0.0, 0.3, 0.0])
START = np.array([0.1, 0.0, 0.2, 0.0])
SPACE = Workspace(np.array([-0.1, -0.1, 0.03]), np.array([0.4, 0.4, 0.4]), START)
FORCE = np.array([1.0, 2.0, 3.0, 4.0])
# The motion to the start: 0.1 m at 0.2 m/s.
TIME = PickEnv.observation_names.index("time")
FAR = int(np.ceil(0.5 / CONTROL_PERIOD))


def moving(act, **options):
    planner = PolicyPlanner(
        act, Straight(), ABOVE, "thing", THING, 0.0, workspace=SPACE, **options
    )
    simulator = Simulator(planner)
    context = simulator.get_mutable_context()
    planner.GetInputPort("blobs").FixValue(context, AbstractValue.Make([blob()]))
    for name, value in (
        ("arm_state", [*START, 0.0, 0.0, 0.0, 0.0]),
        ("gripper_state", np.zeros(8)),
        ("contact_force", FORCE),
    ):
        planner.GetInputPort(name).FixValue(context, value)

    def get(name):
        return planner.GetOutputPort(name).Eval(context)

    def advance(ticks):
        """Advance until the command of so many periods is reached."""
        simulator.AdvanceTo(ticks * CONTROL_PERIOD - 1e-6)

    return advance, get


@pytest.mark.parametrize("touch", [True, False])
def test_it_sees_what_the_environment_would_and_moves_as_it_would(touch):
    seen = []

    def act(observation):
        seen.append(observation)
        return np.array([1.0, 0.0, -0.5, 0.0, -1.0])

    advance, get = moving(act, touch=touch)
    advance(FAR)
    assert seen == []
    assert get("mode") is Mode.PRE_GRASP
    np.testing.assert_allclose(get("position_commanded"), START, atol=1e-6)
    advance(FAR + 3)
    assert len(seen) == 3
    force = FORCE if touch else np.zeros(4)
    sensed = ([0.2, 0.1, 0.04, 0.3], THING, 0.0, np.zeros(8), force, 0.0)
    for k, observation in enumerate(seen):
        expected = pick_state(START, *sensed, k / MAX_STEPS)
        np.testing.assert_allclose(observation, expected, atol=1e-6)
    expected = START + 3 * STEP * [1.0, 0.0, -0.5, 0.0]
    np.testing.assert_allclose(get("position_commanded"), expected, atol=1e-4)
    assert get("mode") is Mode.GRASP


def test_the_hand_stays_in_the_workspace():
    advance, get = moving(lambda _: np.array([-1.0, 1.0, -1.0, 0, -1.0]))
    advance(FAR + 30)
    np.testing.assert_allclose(get("position_commanded")[:3], [-0.1, 0.4, 0.03])


def test_it_shakes_the_closed_hand_once_it_has_risen_and_is_done():
    advance, get = moving(lambda _: np.array([0, 0, 1.0, 0, 1.0]))
    seen, modes = [], []
    for k in range(FAR + 1, FAR + 50):
        advance(k)
        seen.append(get("position_commanded"))
        modes.append(get("mode"))
    assert [*dict.fromkeys(modes)] == [Mode.CLOSE, Mode.VERIFY, Mode.DONE]
    risen = seen[-1][2] - START[2]
    assert 0.12 < risen < 0.17
    shaken = np.array(
        [q for q, mode in zip(seen, modes, strict=True) if mode is Mode.VERIFY]
    )
    assert np.ptp(shaken[:, 0]) > 0.05  # m
    np.testing.assert_allclose(shaken[:, 2], seen[-1][2])
    assert get("closure_commanded") == [1.0]
    assert get("status").mode is Mode.DONE


def test_a_policy_that_gets_nowhere_is_stopped():
    acted = []

    def act(observation):
        acted.append(observation[TIME])
        return np.zeros(5)

    advance, get = moving(act)
    advance(FAR + MAX_STEPS)
    assert get("mode") is Mode.GRASP
    advance(FAR + MAX_STEPS + 2)
    assert get("mode") is Mode.FAILED
    assert get("status").failure is Failure.TIME_BUDGET
    assert "has not risen after 100 steps" in get("status").message
    assert len(acted) == MAX_STEPS
    np.testing.assert_allclose(np.diff(acted), 2.0 / MAX_STEPS, atol=1e-6)


def test_what_is_lifted_too_little_is_not_shaken():
    """A hand that has risen by 10 cm of the 12 when the time is over has failed."""

    def act(observation):
        rises = observation[TIME] > 1.0 - 10.5 / MAX_STEPS  # in the last five steps
        return np.array([0.0, 0.0, float(rises), 0.0, 1.0])

    advance, get = moving(act)
    advance(FAR + MAX_STEPS + 2)
    assert get("mode") is Mode.FAILED
    assert get("position_commanded")[2] == pytest.approx(START[2] + 0.1)


def test_an_action_that_is_not_finite_is_told():
    advance, _ = moving(lambda _: np.full(5, np.nan))
    with pytest.raises(SimulationError, match="not finite"):
        advance(FAR + 2)


def test_it_is_freed_with_its_diagram(leaked):
    def stay(observation):
        return np.zeros(5)

    advance, get = moving(stay)
    advance(FAR)
    assert leaked() == ["PolicyPlanner"]
    del advance, get
    assert leaked() == []
