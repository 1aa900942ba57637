import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import thesis_table
from drake_srg.experiments.cycles import run_cycle
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.thesis_table import (
    AT_PLACE,
    OURS,
    RULES,
    VARIANTS,
    figures,
    judge,
)
from drake_srg.scenario import load_scenario
from drake_srg.theses.taught import Taught
from experiments.made_cycles import cycle

OTHER = "ours, flat fingertips"
PRINTED = {"cycle_time_s": 23.69, "localization_error_m": [0.002, 0.002, 0.015]}
SLOW = {"time_to_placement_s": 20.0, "smoothness": -30.0}


def rows(variant, *cycles):
    others = {name: [cycle(**PRINTED, **SLOW)] for name in VARIANTS}
    return judge(variant, others | {variant: list(cycles)})


def failed(variant, *cycles):
    return [row.quantity for row in rows(variant, *cycles) if not row.passed]


def test_every_variant_has_its_own_fingertips_and_rules():
    made = {
        name: load_scenario(v.scenario, overrides=v.overrides)
        for name, v in VARIANTS.items()
    }
    for name, scenario in made.items():
        pads = [str(directive.add_model) for directive in scenario.directives]
        assert any("flat" in pad for pad in pads) == ("flat" in name)
        by_rules = name.startswith(RULES)
        assert isinstance(scenario.planner, Taught) == by_rules
        assert (scenario.localizer.thesis is not None) == by_rules
    assert made[AT_PLACE].objects["cylinder"].position == [-0.32495, -0.17498]


@pytest.mark.slow
def test_a_real_cycle_beats_the_thesis():
    variant = VARIANTS[OURS]
    assert failed(OURS, run_cycle(variant.scenario, 3, variant.overrides)) == []


def test_no_row_is_without_a_criterion():
    for name in VARIANTS:
        assert all(
            row.expected[0].isdigit() or row.expected[:2] in ("<=", ">=")
            for row in rows(name, cycle())
        )


def test_the_largest_errors_count():
    cycles = [
        cycle(localization_error_m=[1e-4, 0.0, 0.0], placement_error_m=[0.0, 1e-4, 0]),
        cycle(localization_error_m=[-2e-4, 0.0, 0.0], placement_error_m=[0, -3e-4, 0]),
        # An object that was never released has no placement error, but was seen.
        cycle(
            success=False,
            error_G=None,
            cycle_time_s=None,
            localization_error_m=[0.0, 5e-4, 0.0],
            placement_error_m=[0.3, 0.3, 0.3],
        ),
    ]
    values = figures(cycles)
    assert values["mean cycle [s]"] == 6.0
    assert values["largest localisation error, x [mm]"] == pytest.approx(0.2)
    assert values["largest localisation error, y [mm]"] == pytest.approx(0.5)
    assert values["largest placement error, x [mm]"] == 0.0
    assert values["largest placement error, y [mm]"] == pytest.approx(0.3)
    beside = cycle(success=False, placement_error_m=[0.3, 0.3, 0.3])
    values = figures([*cycles, beside])
    assert values["largest placement error, x [mm]"] == pytest.approx(300.0)


@pytest.mark.parametrize(
    ("changes", "quantity"),
    [
        ({"success": False}, "seated in the recess"),
        ({"cycle_time_s": 8.1}, "longest cycle"),
        ({"placement_error_m": [0.0006, 0.0, 0.0]}, "largest placement error, x"),
        ({"placement_error_m": [0.0, -0.0006, 0.0]}, "largest placement error, y"),
        ({"localization_error_m": [8e-5, 0.0, 0.0]}, "largest localisation error, x"),
        ({"localization_error_m": [0.0, 0.0, 4e-4]}, "largest localisation error, z"),
    ],
)
def test_our_own_variant_must_keep_our_bounds(changes, quantity):
    assert failed(OURS, cycle(), cycle(**changes)) == [quantity]


def test_ours_must_be_no_worse_than_the_thesis_s_rules_in_the_same_run():
    slower = {"time_to_placement_s": 20.1, "smoothness": -30.1}
    assert failed(OURS, cycle(**slower)) == [
        "mean time to placement; expected: by the thesis's rules",
        "mean smoothness; expected: by the thesis's rules",
    ]


def test_the_rules_must_reproduce_what_the_thesis_prints():
    assert failed(AT_PLACE, cycle(**PRINTED)) == []
    other = PRINTED | {"cycle_time_s": 23.4}
    assert failed(AT_PLACE, cycle(**other)) == ["mean cycle"]
    other = PRINTED | {"localization_error_m": [0.0, 0.0, 0.0148]}
    assert failed(AT_PLACE, cycle(**other)) == ["largest localisation error, z"]


def test_all_cylinders_must_be_lifted_by_the_rules_too():
    dropped = cycle(**PRINTED, success=False, grasp_lifted=False)
    assert failed(RULES, cycle(**PRINTED), dropped) == [
        "grasped and lifted",
        "seated in the recess",
    ]


def test_the_other_variants_must_beat_the_thesis():
    worse = {"cycle_time_s": 20.0, "placement_error_m": [0.003, 0.001, 0.0]}
    assert failed(OTHER, cycle(), cycle(**worse)) == []
    worst = {"cycle_time_s": 48.0, "placement_error_m": [0.003, 0.003, 0.0]}
    assert failed(OTHER, cycle(), cycle(**worst)) == [
        "mean cycle",
        "largest placement error, y",
    ]


def test_a_variant_that_places_nothing_fails():
    lost = cycle(success=False, cycle_time_s=None, localization_error_m=None)
    assert {"seated in the recess", "mean cycle"} < set(failed(OTHER, lost))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "count"), [({"seeds": 12}, 12), ({"quick": True}, 5)]
)
def test_every_cycle_is_in_the_table(monkeypatch, options, count):
    def pretend(scenario, seed, overrides):
        changes = PRINTED | SLOW if scenario == "assistive_arm_thesis" else {}
        placed = [1e-5 * seed, -1e-4, 0.0]
        made = cycle(placement_error_m=placed, **changes)
        return dc.replace(made, seed=seed)

    monkeypatch.setattr(thesis_table, "run_cycle", pretend)
    result = thesis_table.run(quiet, **options)
    assert result.passed
    table = result.tables["cycles"]
    assert table["seed"] == [
        seed
        for variant in VARIANTS.values()
        for seed in range(min(count, variant.most or count))
    ]
    np.testing.assert_allclose(table["placement error x [m]"][:3], [0, 1e-5, 2e-5])
    assert len(result.figure.axes) == 2
