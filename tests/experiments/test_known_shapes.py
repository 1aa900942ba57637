import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import known_shapes
from drake_srg.experiments.known_shapes import (
    CASES,
    LEAST,
    SCENARIO,
    columns,
    distances,
    judge,
    run,
)
from drake_srg.experiments.registry import quiet
from drake_srg.scenario import load_scenario
from drake_srg.simulation.metrics import Metrics
from experiments.made_cycles import metrics

PLACED = metrics()
LOST = metrics(success=False, failure="no_grasp", attempts=3)


def rows(*outcomes):
    return {row.quantity: row for row in judge({"box": dict(enumerate(outcomes))})}


def test_a_case_passes_if_most_are_placed():
    assert LEAST == 0.95
    good, bad = rows(*[PLACED] * 19, LOST), rows(*[PLACED] * 18, LOST, LOST)
    assert good["placed"].passed
    assert not bad["placed"].passed
    assert bad["no_grasp"].measured == 2
    assert good["placed, at least"].measured < 0.95 < good["placed, at most"].measured


def test_only_what_is_placed_has_a_distance():
    apart = distances({0: PLACED, 1: LOST})
    assert apart == pytest.approx([1e3 * np.linalg.norm(PLACED.placement_error_m[:2])])
    assert "distance from the goal, median" not in rows(LOST)


def test_every_trial_is_a_line_of_the_table():
    table = columns({"box": {3: PLACED}, "ball": {3: LOST, 4: PLACED}})
    assert table["case"] == ["box", "ball", "ball"]
    assert table["seed"] == [3, 3, 4]
    assert table["placed"] == [1, 0, 1]
    assert {len(column) for column in table.values()} == {3}


@pytest.mark.parametrize("case", CASES)
def test_a_case_draws_its_things_from_the_seed(case):
    overrides = ("object.model=null", *CASES[case])
    first, second = (
        load_scenario(SCENARIO, seed=seed, overrides=overrides) for seed in (1, 2)
    )
    pick = first.task.pick
    poses = [
        s.objects[pick].pose.GetDeterministicValue().translation()
        if s.objects[pick].pose
        else s.objects[pick].position
        for s in (first, second)
    ]
    assert not np.allclose(*poses)


def test_unknown_cases_are_named():
    with pytest.raises(ScenarioError, match="unknown 'cone'"):
        run(quiet, cases=["cone"])


def test_trials_are_kept_and_judged(monkeypatch, tmp_path):
    calls = []

    def fake(scenario, overrides, seed):
        calls.append((scenario, seed))
        return vars(PLACED)

    monkeypatch.setattr(known_shapes, "run_trial", fake)
    keep = str(tmp_path / "keep")
    for _ in range(2):
        result = run(quiet, trials=2, cases=["box", "ball"], keep=keep)
    assert len(calls) == 4  # once each
    assert {scenario for scenario, _ in calls} == {SCENARIO}
    assert all(row.passed for row in result.rows)
    assert isinstance(PLACED, Metrics)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["box", "lying can"])
def test_the_kitchen_places_it(case):
    result = run(quiet, trials=1, seed=100, cases=[case])
    assert all(row.passed for row in result.rows)
