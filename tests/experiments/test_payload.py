import numpy as np
import pytest

from drake_srg.experiments import payload_hold
from drake_srg.experiments.payload_hold import HOLD, Held
from drake_srg.experiments.registry import run_experiment


@pytest.mark.parametrize(("name", "strongest"), [("wrap", 9.0), ("pinch", 3.0)])
def test_the_claimed_mass_and_the_largest_one_are_judged(monkeypatch, name, strongest):
    def pretend(load, scenario):
        held_for = HOLD if load.mass <= strongest else 1.0
        return Held(held_for, 1e-3, 0.0, 100.0, np.arange(2.0), np.zeros(2))

    monkeypatch.setattr(payload_hold, "hold", pretend)
    result = run_experiment(f"payload_{name}")
    assert result.passed
    claim = {"wrap": 5.0, "pinch": 2.5}[name]
    assert {row.name for row in result.rows} == {f"{name}, down", f"{name}, side"}
    held = [r for r in result.rows if r.quantity == f"{claim:g} kg held for"]
    largest = [r.measured for r in result.rows if r.quantity == "largest mass held"]
    assert [row.measured for row in held] == [HOLD, HOLD]
    np.testing.assert_allclose(largest, strongest, rtol=0.02)
    assert not run_experiment(f"payload_{name}", overrides=["mass=12"]).passed
