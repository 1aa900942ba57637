import numpy as np
import pytest

from drake_srg.common.errors import ScenarioError
from drake_srg.experiments import hold_drift
from drake_srg.experiments.hold_drift import ACCURATE, LIMIT, creep, run, things
from drake_srg.experiments.registry import quiet


def test_a_held_can_hardly_moves(monkeypatch):
    monkeypatch.setattr(hold_drift, "HOLD", 0.5)
    time, moved = creep(*things()["can"], "gripper_bench", {})
    assert len(time) == 51
    assert moved[0] == 0.0
    # It moves, but less than lagged contact at Drake's own settings lets it.
    assert 0.0 < moved[-1] < 100e-6 * 0.5


def test_nothing_held_is_said(monkeypatch):
    can, height = things()["can"]
    can.friction = 0.0
    with pytest.raises(ScenarioError, match="nothing is held; the object touches"):
        creep(can, height, "gripper_bench", {})


def test_the_accurate_scenario_is_judged(monkeypatch):
    def pretend(thing, height, scenario, changes):
        rate = 2.0 if thing.model else 4.0  # um/s of can and box
        return np.array([0.0, 10.0]), np.array([0.0, rate * 10.0 * 1e-6])

    monkeypatch.setattr(hold_drift, "creep", pretend)
    result = run(quiet)
    judged = {r.name: r for r in result.rows if ACCURATE in r.name}
    assert [r.passed for r in judged.values()] == [True, False]
    assert all(r.expected == f"<= {LIMIT:g}" for r in judged.values())
    assert len(result.rows) == len(result.tables["creep"]["object"])
