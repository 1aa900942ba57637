"""The varied cells, each for its first second; sweeps run whole trials."""

import numpy as np
import pytest

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate

pytestmark = pytest.mark.slow

# A seed with clutter, and one whose arm moves fast from the start.
CELLS = {
    "kitchen_varied": 100000,
    "kitchen_varied_accurate": 100000,
    "assistive_arm_varied": 100078,
    "assistive_arm_varied_accurate": 100078,
}


def simulate_start(name, *overrides):
    scenario = load_scenario(
        name, seed=CELLS[name], overrides=["planner.time_budget=1.2", *overrides]
    )
    return Simulate(scenario, name=name)


@pytest.mark.parametrize("name", CELLS)
def test_a_varied_cell_sees_plans_and_moves(name):
    run = simulate_start(name)
    assert run.metrics.failure == "time_budget"
    assert run.metrics.localization_error_m is not None
    assert np.linalg.norm(run.metrics.localization_error_m) < 0.005
    moved = np.ptp(run.log["arm.state_cheat"][:, 0])
    assert moved > 0.1


def test_fast_motion_at_short_steps_does_not_trigger_the_protective_stop():
    run = simulate_start(
        "assistive_arm_varied_accurate", "plant_config.time_step=0.0025"
    )
    assert run.metrics.failure == "time_budget"


@pytest.mark.parametrize("name", CELLS)
def test_untouched_clutter_stays_at_rest(name):
    # This seed puts a disc of 3 mm and 10 g on the arm's table; a stiff one would hop.
    seed, budget = 600015, ["planner.time_budget=0.3"]
    run = Simulate(load_scenario(name, seed=seed, overrides=budget), name=name)
    settled = run.log["time"] > 0.1
    clutter = [p for key, p in run.log.items() if key.startswith("object_pose.clutter")]
    assert clutter
    for poses in clutter:
        assert np.max(np.ptp(poses[settled, :3], axis=0)) < 1e-5


@pytest.mark.parametrize("cell", ["kitchen_varied", "assistive_arm_varied"])
def test_fast_and_accurate_physics_draw_the_same_trial(cell):
    fast, accurate = (
        load_scenario(name, seed=7) for name in (cell, f"{cell}_accurate")
    )
    assert fast.objects.keys() == accurate.objects.keys()
    for name, thing in fast.objects.items():
        other = accurate.objects[name]
        assert (thing.position, thing.mass) == (other.position, other.mass)
    assert fast.camera_errors == accurate.camera_errors
    assert fast.arm.errors == accurate.arm.errors
