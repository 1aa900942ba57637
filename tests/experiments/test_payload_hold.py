import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import payload_hold
from drake_srg.experiments.payload_hold import HOLD, Held, Load, hold, largest_mass


@pytest.mark.slow
def test_a_light_cylinder_is_held_and_a_heavy_one_is_lost(monkeypatch):
    monkeypatch.setattr(payload_hold, "HOLD", 0.5)
    monkeypatch.setattr(payload_hold, "_LIFT", 1.0)  # at most a 28th of gravity
    # 125 N press with 20 N per finger, which holds 3 kg at friction 0.8.
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

    monkeypatch.setattr(payload_hold, "hold", pretend)
    tried = list(largest_mass(Load("wrap", "down", 5.0, 100.0)))
    assert tried[0][0].mass == 5.0
    best = max(load.mass for load, held in tried if held.held)
    assert best <= limit < best * 1.02
    assert len(tried) < 15


def test_the_search_gives_up_when_nothing_is_held(monkeypatch):
    nothing = Held(0.0, 0.0, 0.0, 100.0, np.zeros(1), np.zeros(1))
    monkeypatch.setattr(payload_hold, "hold", lambda load, scenario: nothing)
    assert len(list(largest_mass(Load("wrap", "down", 5.0, 100.0)))) < 10
