import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import before_modification
from drake_srg.experiments.before_modification import (
    AS_DRAWN,
    CORRECTED,
    FRICTION,
    SCENARIO,
    TIPS,
    all_cases,
    by_group,
    distances,
    judge,
    levels,
    overrides,
)
from drake_srg.experiments.linkage_pads import write_model
from drake_srg.experiments.registry import quiet
from drake_srg.scenario import load_scenario
from experiments.made_cycles import cycle

MISSED = {"success": False, "grasp_lifted": True}


def made(placed):
    """Ten trials of each case; `placed` says how many place the cylinder, by group."""
    return {
        case: [cycle()] * placed(case.group)
        + [cycle(**MISSED)] * (10 - placed(case.group))
        for case in all_cases()
    }


def mended(group):
    return 10 if group[2] == CORRECTED else 5


def test_every_combination_is_a_case_of_its_own():
    cases = all_cases()
    assert len(set(cases)) == len(cases) == 2 * 2 * 2 * len(FRICTION)
    groups = by_group(made(mended))
    assert {len(cycles) for cycles in groups.values()} == {10 * len(FRICTION)}
    assert len(groups) == 8


def test_every_trial_is_at_one_level_of_each_factor():
    runs = made(mended)
    total = sum(map(len, runs.values()))
    for cycles_at in levels(runs).values():
        counts = {len(cycles) for cycles in cycles_at.values()}
        assert counts == {total // len(cycles_at)}


@pytest.mark.parametrize("tip", TIPS)
def test_a_case_follows_the_rules_of_its_tip_s_scenario(tip, tmp_path):
    case = next(case for case in all_cases() if case.tip == tip)
    model = tmp_path / "gripper.sdf"
    write_model(case.pads, 0.65, model)
    ours = load_scenario(SCENARIO, seed=3, overrides=overrides(case, 3, model))
    rules = load_scenario(TIPS[tip])
    assert ours.arm.home == rules.arm.home
    for key in ("approach", "lift", "place", "grasp", "tip_limits"):
        assert getattr(ours.planner, key) == getattr(rules.planner, key)
    assert ours.localizer.thesis is not None
    (frames,) = (d.add_directives for d in ours.directives if d.add_directives)
    assert ("nominal" in frames.file) == (tip == AS_DRAWN)
    assert ours.plant_config.time_step == 0.0
    above = ours.cameras["ceiling"].X_PB.translation
    assert list(above[:2]) == ours.objects["cylinder"].position


def failed(placed):
    return [row.name for row in judge(made(placed)) if not row.passed]


def test_the_corrected_tip_must_pay_beyond_doubt():
    assert failed(mended) == []
    assert failed(lambda group: 5) == [f"tip {CORRECTED}"]
    assert failed(lambda group: 10 if group[0] == "curved" else 0) == [
        f"tip {CORRECTED}"
    ]


def test_distances_are_in_the_plane_and_of_cylinders_that_are_there():
    off = cycle(placement_error_m=[3e-3, -4e-3, 0.1])
    np.testing.assert_allclose(distances([off, cycle(placement_error_m=None)]), [5.0])


@pytest.mark.parametrize(
    ("options", "count"), [({"trials": 3}, 3), ({"quick": True}, 1)]
)
def test_every_trial_is_in_the_table(monkeypatch, options, count):
    monkeypatch.setattr(
        before_modification,
        "run_cycle",
        lambda scenario, seed, overrides: dc.replace(cycle(), seed=seed),
    )
    result = before_modification.run(quiet, **options)
    table = result.tables["trials"]
    assert table["seed"] == len(all_cases()) * list(range(count))
    assert set(table["tip"]) == set(TIPS)
    assert len(result.figure.axes) == 3
