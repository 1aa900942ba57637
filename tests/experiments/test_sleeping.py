import numpy as np
import pytest

from drake_srg.experiments import sleeping
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.sleeping import ASLEEP, AWAKE, HALF, Outcome, judge, scene
from drake_srg.scenario.checks import check_scenario
from drake_srg.simulation.rig import tabletop

COSTS = {(6, AWAKE): 1.0, (6, ASLEEP): 0.1, (40, AWAKE): 8.0, (40, ASLEEP): 0.5}


def outcome(x=0.1, tilt=0.0, slept=2):
    """The first of two objects moves by x [m] and tilts [rad]."""
    return Outcome(np.array([[x, 0, 0], [0, 0, 0]]), np.array([tilt, 0.0]), slept)


def failed(costs=COSTS, **changes):
    outcomes = {
        AWAKE: {0: outcome(), 1: outcome()},
        ASLEEP: {0: outcome(), 1: outcome(**changes)},
        HALF: {0: outcome(0.101)},
    }
    return [row.quantity for row in judge(costs, outcomes) if not row.passed]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, []),
        ({"x": 0.1005}, []),
        ({"x": 0.003}, ["end otherwise", "median", "95th"]),
        ({"tilt": 1.0}, ["end otherwise"]),
        ({"slept": 1}, ["all slept"]),
        ({"costs": COSTS | {(6, ASLEEP): 0.6}}, ["cost asleep"]),
    ],
)
def test_what_sleeping_changes_fails(changes, words):
    found = failed(**changes)
    assert len(found) == len(words)
    for quantity, word in zip(found, words, strict=True):
        assert word in quantity


def test_an_outcome_is_put_into_words():
    moved = np.array([[0.0, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.01, 0.0]])
    words = Outcome(moved, np.array([0.0, 0.1, 1.5]), 0).words
    assert words == ("stayed", "moved", "fell")


def test_scenes_differ_by_their_seed():
    first, again, other = scene(0), scene(0), scene(1)
    assert first == again
    assert first != other
    check_scenario(tabletop(first[0], sleeping.SLEEPING), "scene")


@pytest.mark.slow
def test_a_short_run_passes(monkeypatch):
    monkeypatch.setattr(sleeping, "_MANY", 7)
    monkeypatch.setattr(sleeping, "_COST", 0.5)
    result = sleeping.run(quiet, seeds=1)
    assert result.passed, result.table()
    assert result.tables["scenes"]["simulated"] == [AWAKE, ASLEEP, HALF]
    assert len(result.figure.axes) == 2
