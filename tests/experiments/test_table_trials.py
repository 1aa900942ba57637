"""Shares and claims of made-up tables."""

import dataclasses as dc
import types

import pytest

from drake_srg.experiments import table_trials, whole_run
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.table_trials import (
    Case,
    Limits,
    judge,
    object_columns,
    run_tables,
    trial_columns,
)
from drake_srg.planning.grasps.top_grasps import Reach
from drake_srg.simulation.metrics import Metrics
from drake_srg.simulation.simulate import STOPPED_BY_USER
from drake_srg.types import Mode, PlannerStatus
from experiments.made_tables import table

PLACE = "in the bin"
FIT = f"objects in reach that fit the hand {PLACE}"
SCENES = {
    "spread": ("clear_table_fast", ("clutter.count=2",)),
    "sorted": ("sort_table", ()),
}


def rows(*tables, limits=None):
    runs = {Case("spread", i): metrics for i, metrics in enumerate(tables)}
    return {row.quantity: row for row in judge(runs, PLACE, limits)}


def test_reasons_and_picks_are_counted():
    found = rows(table(), table())
    assert found["too_wide"].measured == 2
    assert found["picks"].measured == 16


def test_what_is_too_wide_for_the_hand_is_not_asked_for():
    limits = {"spread": Limits(cleared=0.99)}
    assert rows(table(), limits=limits)[FIT].passed
    left = rows(table(outcome="no_grasp"), limits=limits)
    assert left[FIT].measured == pytest.approx(5 / 6)
    assert not left[FIT].passed
    assert rows(table(outcome="no_grasp"))[FIT].passed  # then nothing is asked


def test_what_lay_out_of_reach_is_counted():
    runs = {Case("spread", 0): table(lay_at=(0.9, 0.0))}
    reach = {"spread": Reach((0.0, 0.0), 0.4, 0.8)}
    found = {row.quantity: row for row in judge(runs, PLACE, None, reach)}
    assert found["lay out of reach"].measured == 6


def test_picks_and_rates_are_asked_for():
    for limits, passed in (
        (Limits(delivered=0.6, rate=600.0), True),
        (Limits(0, 0.63, 601.0), False),
    ):
        found = rows(table(), limits={"spread": limits})
        assert found["picks that delivered"].passed == passed
        assert found["picks held"].expected == "a number"
        assert found["picks held per hour, median"].passed == passed


def test_a_claim_too_many_fails():
    claim = "claimed, not in the bin"
    assert rows(table())[claim].passed
    assert not rows(table(), table(cleared=2, held=4))[claim].passed


def test_a_line_for_each_table_and_object():
    runs = {Case("spread", 0): table(total=2, cleared=2)}
    runs[Case("spread", 1)] = table(total=1, cleared=1)
    assert {len(column) for column in trial_columns(runs, PLACE).values()} == {2}
    objects = object_columns(runs, SCENES)
    assert {len(column) for column in objects.values()} == {3}
    assert "None" not in objects["object"]


@pytest.mark.parametrize("scene", SCENES)
def test_scenes_run_once_and_in_turn(monkeypatch, tmp_path, scene):
    seen = []

    def simulate(scenario, *, name):
        seen.append((name, scenario.random_seed))
        things = {n: {"cleared": True} for n in list(scenario.objects)[:1]}
        for thing in things.values():
            thing |= {
                "outcome": "cleared",
                "attempts": 1,
                "width_m": 0.06,
                "lay_at_m": (0.6, 0.0),
                "moved_m": 1.0,
                "under": "",
            }
        values = dict.fromkeys(field.name for field in dc.fields(Metrics))
        values |= vars(table(total=1, cleared=1, picks=1, held=1)) | {"objects": things}
        return types.SimpleNamespace(
            metrics=Metrics(**values), status=PlannerStatus(mode=Mode.DONE)
        )

    monkeypatch.setattr(table_trials, "simulate_whole", simulate)
    for _ in range(2):
        made = run_tables(
            quiet,
            {scene: SCENES[scene]},
            2,
            5,
            str(tmp_path / "kept"),
            place=PLACE,
            title="Tables",
        )
        assert made.passed
    assert seen == [(SCENES[scene][0], 5), (SCENES[scene][0], 6)]


def test_an_interrupted_trial_is_no_result(monkeypatch, tmp_path):
    stopped = PlannerStatus(mode=Mode.FAILED, message=STOPPED_BY_USER)
    monkeypatch.setattr(
        whole_run, "Simulate", lambda *_, **__: types.SimpleNamespace(status=stopped)
    )
    kept = tmp_path / "kept"
    with pytest.raises(KeyboardInterrupt):
        run_tables(quiet, SCENES, 1, 5, str(kept), place=PLACE, title="Tables")
    assert not kept.exists()
