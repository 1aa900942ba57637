"""The five-axis arm's cell: whole cycles, with and without disturbances.

Disturbed cycles run in the fast cell, which agrees with the accurate one.
"""

import numpy as np
import pytest

from drake_srg.common.log_format import MODES
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.types import Mode

pytestmark = pytest.mark.slow


def simulate(*overrides, name="assistive_arm_fast"):
    return Simulate(load_scenario(name, seed=1, overrides=overrides), record=False)


def modes(result):
    mode = result.log["mode"].astype(int)
    return [MODES[i] for i in mode[np.flatnonzero(np.diff(mode, prepend=-1))]]


@pytest.fixture(scope="module")
def accurate():
    """The metrics of a whole cycle."""
    return simulate(name="assistive_arm").metrics


def judge_cycle(metrics):
    assert metrics.success
    assert metrics.attempts == 1
    # Half of the recess's radial clearance.
    assert np.max(np.abs(metrics.placement_error_m)) < 0.5e-3
    assert np.max(np.abs(metrics.localization_error_m)) < 0.3e-3
    assert metrics.cycle_time_s < 8.0


def test_a_cycle_seats_the_cylinder_in_the_recess(accurate):
    judge_cycle(accurate)


def test_flat_pads_seat_the_cylinder_in_the_recess():
    judge_cycle(Simulate(load_scenario("assistive_arm_flat", seed=3)).metrics)


def test_the_fast_arm_agrees_with_the_accurate_one(accurate):
    fast = simulate().metrics
    assert fast.success
    assert fast.attempts == 1
    assert abs(fast.cycle_time_s - accurate.cycle_time_s) < 0.3
    # The recess has 1 mm of clearance; the aim is half of that.
    assert np.all(np.abs(fast.placement_error_m[:2]) < 0.5e-3)
    np.testing.assert_allclose(
        fast.localization_error_m, accurate.localization_error_m, atol=1e-4
    )


@pytest.mark.parametrize(
    ("override", "failures"),
    [
        ("object.friction=0.0", {"no_grasp", "dropped"}),
        ("task.place.position=[0.0, 0.6]", {"out_of_reach"}),
        ("task.place.position=[0.0, 0.12]", {"blocked"}),  # beside the recess
    ],
)
def test_an_impossible_task_fails_with_its_reason(override, failures):
    metrics = simulate(override, "planner.max_attempts=1").metrics
    assert not metrics.success
    assert metrics.failure in failures


def test_a_pushed_cylinder_is_seen_again_before_the_grasp():
    push = (
        "!Push {at: pre_grasp, after: 0.2, displacement: [0, 0.03, 0], duration: 0.3}"
    )
    result = simulate(f"disturbances=[{push}]")
    assert result.metrics.success
    assert result.metrics.attempts == 1  # no grasp at its old place
    assert modes(result)[:4] == [Mode.IDLE, Mode.PRE_GRASP, Mode.IDLE, Mode.PRE_GRASP]


def test_a_cylinder_that_is_knocked_over_is_stood_up():
    topple = "!Topple {at: idle, direction: [-1, 0]}"
    result = simulate(f"disturbances=[{topple}]", "object.position=[-0.245, -0.175]")
    axis = result.log["object_pose.cylinder"]
    assert np.min(np.abs(1 - 2 * (axis[:, 4] ** 2 + axis[:, 5] ** 2))) < 0.1  # lying
    assert result.metrics.success
    assert result.metrics.placement_tilt_rad < np.deg2rad(1.0)


def test_a_cylinder_torn_from_the_hand_is_taken_again_or_reported():
    force = "!Force {at: transfer, after: 0.5, force: [0, 0, -20], duration: 0.2}"
    result = simulate(f"disturbances=[{force}]")
    trace = modes(result)
    assert trace[trace.index(Mode.TRANSFER) + 1] is Mode.RELEASE
    assert result.metrics.success or result.metrics.failure == "dropped"
    if result.metrics.success:
        assert result.metrics.attempts > 1


def test_repeated_cycles_go_there_and_back():
    result = simulate("task.repeat=2")
    metrics = result.metrics
    assert metrics.success
    assert (metrics.cycles, metrics.attempts) == (2, 2)
    start, end = result.log["object_pose.cylinder"][[0, -1], :3]
    np.testing.assert_allclose(end, start, atol=0.5e-3)
