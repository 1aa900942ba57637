import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import payload
from drake_srg.experiments.payload import HOLD, Held, Load, hold, largest_mass
from drake_srg.experiments.registry import run_experiment


@pytest.mark.slow
def test_a_light_cylinder_is_held_and_a_heavy_one_is_lost(monkeypatch):
    monkeypatch.setattr(payload, "HOLD", 0.5)
    # 125 N press with 20 N a finger, which holds 3 kg at friction 0.8.
    light = hold(Load("pinch", "down", 0.5, 125.0))
    assert light.held
    assert light.wire_force == pytest.approx(125.0, rel=0.05)
    # Less than the pads yield to, and more than nothing.
    assert 1e-6 < light.slip < 1e-3
    heavy = hold(Load("pinch", "down", 20.0, 125.0))
    assert heavy.held_for == 0.0


@pytest.mark.parametrize("force", [-1.0, 400.0])
def test_wires_cannot_pull_harder_than_the_servo(force):
    with pytest.raises(ScenarioError, match=r"the servo gives 0 \.\. 309 N"):
        hold(Load("wrap", "side", 1.0, force))


def test_a_gripper_without_wires_is_refused():
    overrides = ["gripper=!SrgPositionDriver {}"]
    with pytest.raises(ScenarioError, match="needs !SrgTendonDriver"):
        hold(Load("wrap", "side", 1.0, 100.0), overrides=overrides)


@pytest.mark.parametrize("limit", [0.3, 2.6, 5.0, 7.77, 31.0])
def test_the_largest_mass_is_bracketed(monkeypatch, limit):
    def pretend(load, scenario):
        held_for = HOLD if load.mass <= limit else 1.0
        return Held(held_for, 0.0, 0.0, 100.0, np.zeros(1), np.zeros(1))

    monkeypatch.setattr(payload, "hold", pretend)
    tried = list(largest_mass(Load("wrap", "down", 5.0, 100.0)))
    assert tried[0][0].mass == 5.0
    best = max(load.mass for load, held in tried if held.held)
    assert best <= limit < best * 1.02
    assert len(tried) < 15


def test_the_search_gives_up_when_nothing_is_held(monkeypatch):
    nothing = Held(0.0, 0.0, 0.0, 100.0, np.zeros(1), np.zeros(1))
    monkeypatch.setattr(payload, "hold", lambda load, scenario: nothing)
    assert len(list(largest_mass(Load("wrap", "down", 5.0, 100.0)))) < 10


@pytest.mark.parametrize(("name", "strongest"), [("wrap", 9.0), ("pinch", 3.0)])
def test_the_claimed_mass_and_the_largest_one_are_judged(monkeypatch, name, strongest):
    def pretend(load, scenario):
        held_for = HOLD if load.mass <= strongest else 1.0
        return Held(held_for, 1e-3, 0.0, 100.0, np.arange(2.0), np.zeros(2))

    monkeypatch.setattr(payload, "hold", pretend)
    result = run_experiment(f"payload_{name}")
    assert result.passed
    claim = {"wrap": 5.0, "pinch": 2.5}[name]
    assert {row.name for row in result.rows} == {f"{name}, down", f"{name}, side"}
    held = [r for r in result.rows if r.quantity == f"{claim:g} kg held for"]
    largest = [r.measured for r in result.rows if r.quantity == "largest mass held"]
    assert [row.measured for row in held] == [HOLD, HOLD]
    np.testing.assert_allclose(largest, strongest, rtol=0.02)
    assert not run_experiment(f"payload_{name}", overrides=["mass=12"]).passed
