import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import singles
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.singles import (
    GROUPS,
    Single,
    columns,
    first,
    graspable,
    judge,
    run,
)

HELD = Single("shapes", 0, "Box", 0.05, True, 1, True, "cleared", 4.0, 3.0)
LATER = dc.replace(HELD, picks=2)
LEFT = dc.replace(HELD, cleared=False, picks=3, claimed=False, outcome="no_grasp")
WIDE = dc.replace(LEFT, width=0.14, picks=0, outcome="too_wide", pick_time=np.nan)


def rows(made):
    return {(row.name, row.quantity): row for row in judge(made)}


def test_what_is_too_wide_does_not_count():
    made = [HELD] * 9 + [WIDE]
    assert graspable(made) == [HELD] * 9
    found = rows(made)
    assert found["all", "trials"].measured == 10
    assert found["all", "counted"].measured == 9
    assert found["all", "in the bin, first grasp"].passed


def test_only_the_first_grasp_counts_as_first():
    assert first([HELD, LATER, LEFT]).value == pytest.approx(1 / 3)
    found = rows([HELD] * 96 + [LATER] * 4)
    assert not found["all", "in the bin, first grasp"].passed
    assert found["all", "in the bin, three grasps"].passed
    found = rows([HELD] * 996 + [LEFT] * 4)
    assert not found["all", "in the bin, three grasps"].passed
    assert found["not in the bin", "no_grasp"].measured == 4


def test_speed_and_claims_are_judged():
    good = rows([HELD])
    assert good["all", "picks per hour, median"].measured == pytest.approx(900.0)
    assert good["all", "claimed, not in the bin"].passed
    slow = rows([dc.replace(HELD, pick_time=6.0, time=5.0)])
    assert not slow["all", "picks per hour, median"].passed
    assert not slow["all", "processor time of a trial"].passed
    false = rows([dc.replace(LEFT, claimed=True)])
    assert not false["all", "claimed, not in the bin"].passed
    assert not rows([WIDE])["all", "picks per hour, median"].passed


def test_every_trial_is_a_line_of_the_table():
    table = columns([HELD, WIDE])
    assert table["width [m]"] == [0.05, 0.14]
    assert {len(column) for column in table.values()} == {2}


def test_trials_are_kept(monkeypatch, tmp_path):
    seeds = []

    def fake(seed, folder):
        seeds.append(seed)
        assert list(folder.glob("*.obj"))
        return dc.asdict(dc.replace(HELD, seed=seed, group=GROUPS[seed % 3]))

    monkeypatch.setattr(singles, "run_single", fake)
    for _ in range(2):
        result = run(quiet, trials=3, seed=7, keep=str(tmp_path / "keep"))
    assert seeds == [7, 8, 9]
    assert {row.name for row in result.rows} >= {"all", *GROUPS}


@pytest.mark.slow
def test_a_thing_is_cleared():
    result = run(quiet, trials=1, seed=9601)
    table = result.tables["trials"]
    assert table["group"] == ["shapes"]
    assert table["cleared"] == [True]
    assert 2.0 < table["pick [s]"][0] < 8.0
    assert table["width [m]"][0] < 0.13
