import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import adaptation
from drake_srg.experiments.adaptation import (
    ANYWHERE,
    AS_TAUGHT,
    FIXED,
    LOOKS,
    METHODS,
    ONE_LOOK,
    PUSHED,
    SCENARIO,
    SITUATIONS,
    judge,
    situation_overrides,
)
from drake_srg.experiments.registry import quiet
from drake_srg.scenario import load_scenario
from drake_srg.theses.taught import Taught
from experiments.made_cycles import cycle

MISSED = {"success": False, "grasp_lifted": False, "cycle_time_s": None}
# Of 20 trials: those in which the cylinder is placed.
EXPECTED = {
    FIXED: {AS_TAUGHT: 20, ANYWHERE: 2, PUSHED: 3},
    ONE_LOOK: {AS_TAUGHT: 20, ANYWHERE: 20, PUSHED: 3},
    LOOKS: {AS_TAUGHT: 20, ANYWHERE: 20, PUSHED: 19},
}


def runs(placed=EXPECTED):
    return {
        (method, situation): [cycle()] * count + [cycle(**MISSED)] * (20 - count)
        for method, counts in placed.items()
        for situation, count in counts.items()
    }


def failed(placed):
    return [
        (row.name, row.quantity.partition(";")[0].removeprefix("placed: least share "))
        for row in judge(runs(placed))
        if not row.passed
    ]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("situation", SITUATIONS)
def test_every_case_is_a_valid_scenario(method, situation):
    overrides = (*METHODS[method], *situation_overrides(situation, 3))
    scenario = load_scenario(SCENARIO, seed=3, overrides=overrides)
    assert isinstance(scenario.planner, Taught) == (method == FIXED)
    assert scenario.planner.look_before_grasp == (method == LOOKS)
    assert bool(scenario.disturbances) == (situation == PUSHED)
    position = scenario.objects["cylinder"].position
    assert (position == [-0.32495, -0.17498]) == (situation != ANYWHERE)


def test_pushes_differ_and_leave_the_open_fingers():
    pushes = []
    for seed in range(20):
        overrides = situation_overrides(PUSHED, seed)
        (push,) = load_scenario(SCENARIO, overrides=overrides).disturbances
        pushes.append(push.displacement)
    distances = np.linalg.norm(pushes, axis=1)
    assert 0.01 <= distances.min() < 0.02
    assert 0.03 < distances.max() <= 0.04


def test_looking_must_pay_where_the_cylinder_is_elsewhere():
    assert failed(EXPECTED) == []
    blind = EXPECTED | {LOOKS: EXPECTED[LOOKS] | {PUSHED: 8}}
    assert failed(blind) == [(PUSHED, f"with {LOOKS}")] * 2
    lucky = EXPECTED | {FIXED: EXPECTED[FIXED] | {ANYWHERE: 18}}
    assert failed(lucky) == [(ANYWHERE, f"with {m}") for m in (ONE_LOOK, LOOKS)]


def test_shares_have_intervals_and_figures_are_of_placed_cylinders():
    rows = {
        (row.name, row.quantity): row.measured
        for row in judge(runs())
        if row.name == f"{PUSHED}: {LOOKS}"
    }
    case = f"{PUSHED}: {LOOKS}"
    low, share, high = (
        rows[case, f"placed, {what}"] for what in ("at least", "share", "at most")
    )
    assert share == pytest.approx(0.95)
    assert low < share < high
    assert rows[case, "cycle, median"] == 6.0


@pytest.mark.parametrize(
    ("options", "count"), [({"trials": 2}, 2), ({"quick": True}, 10)]
)
def test_every_trial_is_in_the_table(monkeypatch, options, count):
    monkeypatch.setattr(
        adaptation,
        "run_cycle",
        lambda scenario, seed, overrides: dc.replace(cycle(), seed=seed),
    )
    result = adaptation.run(quiet, **options)
    table = result.tables["trials"]
    assert table["seed"] == 9 * list(range(count))
    assert list(dict.fromkeys(table["method"])) == list(METHODS)
    assert len(result.figure.axes) == 3
