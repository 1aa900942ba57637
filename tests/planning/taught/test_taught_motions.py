import numpy as np
import pytest

from drake_srg.cell import MakeTaughtPlanner
from drake_srg.cell.planners import MakeTaughtMotions
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.scenario import load_scenario
from drake_srg.types import Failure, Mode

pytestmark = pytest.mark.slow
ORDER = (Mode.PRE_GRASP, Mode.GRASP, Mode.LIFT, Mode.PLACE, Mode.HOME)
P2 = np.array([-0.325, -0.175, 0.14])


@pytest.fixture(scope="module")
def motions():
    return MakeTaughtMotions(load_scenario("assistive_arm_thesis"))


@pytest.fixture(scope="module")
def planned(motions):
    return motions.plan(P2)


def tip(motions, trajectory, time):
    return motions.moves.tip(trajectory.value(time)[:, 0])


def test_every_motion_begins_where_the_last_one_ended(motions, planned):
    assert tuple(planned) == ORDER
    ends = [motions.q_home]
    for trajectory in planned.values():
        np.testing.assert_allclose(trajectory.value(0.0)[:, 0], ends[-1], atol=0.01)
        ends.append(trajectory.value(trajectory.end_time())[:, 0])
    np.testing.assert_allclose(ends[-1], motions.q_home, atol=1e-6)
    np.testing.assert_allclose(ends[3], motions.config.lift, atol=1e-6)
    np.testing.assert_allclose(ends[4], motions.config.place, atol=1e-6)


def test_p1_is_beside_the_blob_and_p2_at_it(motions, planned):
    beside, at = (
        tip(motions, planned[mode], planned[mode].end_time()) for mode in ORDER[:2]
    )
    np.testing.assert_allclose(beside, P2 + np.array([0.025, 0.0, 0.0]), atol=3e-4)
    np.testing.assert_allclose(at, P2, atol=3e-4)


def test_the_tip_keeps_the_thesis_s_speed(motions, planned):
    for trajectory in planned.values():
        times = np.linspace(0.0, trajectory.end_time(), 400)
        path = np.array([tip(motions, trajectory, t) for t in times])
        speed = np.linalg.norm(np.gradient(path, times, axis=0), axis=1)
        assert np.max(speed) <= 0.1 * 1.01  # the slack of sampling


def test_the_tip_moves_on_straight_lines(motions, planned):
    for trajectory in planned.values():
        times = np.linspace(0.0, trajectory.end_time(), 50)
        path = np.array([tip(motions, trajectory, t) for t in times])
        line = (path[-1] - path[0]) / np.linalg.norm(path[-1] - path[0])
        beside = path - path[0] - np.outer((path - path[0]) @ line, line)
        assert np.max(np.linalg.norm(beside, axis=1)) < 2e-3


@pytest.mark.parametrize(
    ("p_WT", "failure"),
    [
        ([-0.9, 0.0, 0.14], Failure.OUT_OF_REACH),
        ([-0.325, -0.175, 0.09], Failure.BLOCKED),
    ],
)
def test_what_cannot_be_reached_is_said(motions, p_WT, failure):
    result = motions.plan(np.array(p_WT))
    assert isinstance(result, PlanningFailure)
    assert result.failure is failure


def test_either_tip_was_taught_the_same_places(motions):
    before = MakeTaughtMotions(load_scenario("assistive_arm_before"))
    apart = np.linalg.norm(before.moves.p_GT - motions.moves.p_GT)
    assert 1e-3 < apart < 1.5e-3  # a constant offset, beyond the recess's clearance
    for name in ("lift", "place"):
        ours, other = (
            m.moves.tip(np.array(getattr(m.config, name))) for m in (motions, before)
        )
        np.testing.assert_allclose(other, ours, atol=5e-5)


def test_a_posture_of_another_arm_is_refused():
    scenario = load_scenario("assistive_arm_thesis")
    scenario.planner.lift = [0.0, 0.0]
    with pytest.raises(
        ValueError, match=r"planner\.lift: needs one entry per joint.*5"
    ):
        MakeTaughtPlanner(scenario)
