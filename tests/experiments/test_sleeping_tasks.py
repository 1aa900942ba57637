from types import SimpleNamespace

import numpy as np
import pytest

from drake_srg.experiments import sleeping_tasks
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.sleeping import ASLEEP, AWAKE
from drake_srg.experiments.sleeping_tasks import Trial, judge

SAME = Trial(True, "", 1, False, np.zeros((2, 3)), 2.0)


def made(**changes):
    """Two trials, of which the second ends otherwise asleep."""
    other = Trial(**{**SAME.__dict__, **changes})
    return {AWAKE: [SAME, SAME], ASLEEP: [SAME, other]}


def row(rows, quantity):
    (found,) = [row for row in rows if row.quantity == quantity]
    return found


@pytest.mark.parametrize(
    ("changes", "count"),
    [
        ({}, 0),
        ({"touched": True, "seconds": 1.0, "ends": np.ones((2, 3))}, 0),
        ({"success": False}, 1),
        ({"failure": "dropped"}, 1),
        ({"attempts": 2}, 1),
    ],
)
def test_only_what_a_user_asks_about_must_not_differ(changes, count):
    judged = row(judge(made(**changes)), "trials that end otherwise")
    assert (judged.measured, judged.passed) == (count, count == 0)


def test_distances_and_cost_are_stated():
    ends = np.array([[0.0, 0.0, 0.0], [0.003, 0.004, 0.0]])
    rows = judge(made(ends=ends, seconds=1.0, touched=True))
    assert row(rows, "difference of positions, largest").measured == pytest.approx(5.0)
    assert row(rows, "cost asleep over cost awake").measured == 0.75
    moved = "trials in which only one moves another object"
    assert row(rows, moved).measured == 1
    assert row(rows, "their share, at most").measured == pytest.approx(0.658, abs=1e-3)


def test_each_seed_is_simulated_awake_and_asleep(monkeypatch):
    scenarios = []

    def simulate(scenario):
        scenarios.append(scenario)
        metrics = {"success": False, "failure": "dropped", "attempts": 2}
        return SimpleNamespace(
            metrics=SimpleNamespace(**metrics, others_moved_m=0.006),
            log={"object_pose.can": np.array([[0.1, 0.2, 0.3, 1, 0, 0, 0]] * 2)},
        )

    monkeypatch.setattr(sleeping_tasks, "simulate_whole", simulate)
    result = sleeping_tasks.run(quiet, trials=2, seed=5)
    assert [s.random_seed for s in scenarios] == [5, 5, 6, 6]
    assert [s.sleeping is None for s in scenarios] == [True, False] * 2
    assert all(len(s.objects) == 3 for s in scenarios)
    assert result.passed
    table = result.tables["trials"]
    assert table["simulated"] == [AWAKE, ASLEEP] * 2
    assert table["failure"] == ["dropped"] * 4
    assert table["moves another"] == [1] * 4
    assert len(result.figure.axes) == 1
