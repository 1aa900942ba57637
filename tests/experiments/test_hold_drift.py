import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import hold_drift
from drake_srg.experiments.hold_drift import ACCURATE, LIMIT, creep, run, things
from drake_srg.experiments.registry import quiet


@pytest.mark.slow
def test_a_held_can_hardly_moves():
    time, moved = creep(*things()["can"], "gripper_bench", {}, duration=0.5)
    assert len(time) == 51
    assert moved[0] == 0.0
    # It moves, but less than with lagged contact at Drake's own settings.
    assert 0.0 < moved[-1] < 100e-6 * 0.5


@pytest.mark.slow
def test_a_hand_that_holds_nothing_is_reported():
    can, height = things()["can"]
    can.friction = 0.0
    with pytest.raises(ScenarioError, match="the hand holds nothing; the object"):
        creep(can, height, "gripper_bench", {})


@pytest.mark.slow
def test_only_the_accurate_scenario_is_judged(monkeypatch):
    def pretend(thing, height, scenario, changes, duration, force_limit):
        rate = 2.0 if thing.model else 4.0  # um/s of can and box
        return np.array([0.0, 10.0]), np.array([0.0, rate * 10.0 * 1e-6])

    monkeypatch.setattr(hold_drift, "creep", pretend)
    result = run(quiet)
    judged = {r.name: r for r in result.rows if ACCURATE in r.name}
    assert [r.passed for r in judged.values()] == [True, False]
    assert all(r.expected == f"<= {LIMIT:g}" for r in judged.values())
    others = [r for r in result.rows if r.name not in judged]
    assert all(r.expected == "a number" for r in others)
    assert len(result.rows) == len(result.tables["creep"]["object"])
