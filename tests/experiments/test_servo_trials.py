"""Trials of the experiment on visual servoing: how they are set up."""

import weakref

import numpy as np
import pytest

from drake_srg.experiments import servo_trials
from drake_srg.experiments.servo_trials import METHODS, Case, Grasped, grasp_once
from drake_srg.scenario import servo_of

OFF = Case(distance=0.01, angle=np.deg2rad(2.5))


@pytest.fixture
def scenarios(monkeypatch):
    """The scenarios that trials would simulate."""
    seen = []

    def run(scenario):
        seen.append(scenario)
        return Grasped(True, 0.0, 0.0, "")

    monkeypatch.setattr(servo_trials, "_run", run)
    return seen


def test_each_method_errs_with_the_camera_that_it_relies_on(scenarios):
    for method, (camera, _) in METHODS.items():
        grasp_once(OFF, method, 7)
        (name,) = scenarios[-1].camera_errors
        assert name == camera
    errors = [next(iter(s.camera_errors.values())) for s in scenarios]
    assert all(error == errors[0] for error in errors)
    assert np.linalg.norm(errors[0].translation) == pytest.approx(0.01)
    assert np.linalg.norm(errors[0].rotation) == pytest.approx(np.deg2rad(2.5))


def test_only_what_looks_is_rendered(scenarios):
    for method in METHODS:
        grasp_once(Case(0.05), method, 7)
    once, *others = scenarios
    assert servo_of(once) is None
    assert list(once.cameras) == ["ceiling"]
    assert all(set(s.cameras) == {"ceiling", "hand"} for s in others)
    assert all(s.slides["tray"].speed == 0.05 for s in scenarios)
    assert all(s.planner.max_attempts == 1 for s in scenarios)


def test_what_a_trial_leaves_is_freed(monkeypatch):
    left = []

    class Cycle:
        def __init__(self):
            self.myself = self

    def run(scenario):
        left.append(weakref.ref(Cycle()))
        return Grasped(True, 0.0, 0.0, "")

    monkeypatch.setattr(servo_trials, "_run", run)
    grasp_once(OFF, "pbvs", 7)
    assert left[0]() is None


@pytest.mark.slow
def test_pbvs_takes_the_can_from_the_moving_tray():
    grasped = grasp_once(Case(0.05), "pbvs", 1)
    assert grasped.held, grasped.reason
    assert grasped.error < 3e-3
