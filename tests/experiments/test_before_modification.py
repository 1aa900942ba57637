import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import before_modification
from drake_srg.experiments.before_modification import (
    AS_DRAWN,
    CORRECTED,
    FRICTION,
    SCENARIO,
    STEPS,
    TIPS,
    all_cases,
    by_group,
    judge,
    offsets,
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
    return 10 if group[2] == CORRECTED else 1


def test_every_combination_is_a_case_of_its_own():
    cases = all_cases()
    assert len(set(cases)) == len(cases) == 2 * 2 * 2 * len(FRICTION)
    groups = by_group(made(mended))
    assert set(STEPS.values()) <= groups.keys()
    assert {len(cycles) for cycles in groups.values()} == {10 * len(FRICTION)}


@pytest.mark.parametrize("tip", TIPS)
def test_a_case_follows_the_rules_of_its_tip_s_scenario(tip, tmp_path):
    case = next(case for case in all_cases() if case.tip == tip)
    model = tmp_path / "gripper.sdf"
    write_model(case.pads, 0.65, model)
    ours = load_scenario(SCENARIO, seed=3, overrides=overrides(case, 3, model))
    rules = load_scenario(TIPS[tip])
    assert (ours.taught, ours.arm.home) == (rules.taught, rules.arm.home)
    assert ours.localizer == rules.localizer
    assert dc.replace(ours.planner, period=0.0) == dc.replace(rules.planner, period=0.0)
    (frames,) = (d.add_directives for d in ours.directives if d.add_directives)
    assert ("nominal" in frames.file) == (tip == AS_DRAWN)
    assert ours.plant_config.time_step == 0.0
    above = ours.cameras["ceiling"].X_PB.translation
    assert list(above[:2]) == ours.objects["cylinder"].position


def failed(placed):
    return [row.name for row in judge(made(placed)) if not row.passed]


def test_both_modifications_must_mend_it_beyond_doubt():
    assert failed(mended) == []
    assert failed(lambda group: 5) == ["both"]
    assert failed(lambda group: 1 if group == STEPS["both"] else 0) == ["both"]


def test_offsets_are_of_cylinders_that_were_lifted_and_released():
    good = cycle(error_G=np.array([1e-3, -2e-3, 5e-3]))
    lost = cycle(grasp_lifted=False, error_G=np.array([1.0, 1.0, 0.0]))
    held = dc.replace(good, error_G=None)
    np.testing.assert_allclose(offsets([good, lost, held]), [[1.0, -2.0]])
    assert offsets([held]).shape == (0, 2)


@pytest.mark.parametrize(
    ("options", "count"), [({"trials": 3}, 3), ({"quick": True}, 2)]
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
