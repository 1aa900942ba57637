"""The experiment on servoing through the wire: its judgement."""

import dataclasses as dc
import json

import pytest

from drake_srg.experiments import served_servoing
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.served_servoing import CASES, SERVOS
from drake_srg.experiments.served_trials import Served

TRIALS = 20


def made(case, method, seed, late):
    held = seed % TRIALS != 0
    return Served(held, 0.001, 0.0005, "" if held else "lost")


def run(monkeypatch, grasp=made, **settings):
    monkeypatch.setattr(served_servoing, "grasp_served", grasp)
    result = served_servoing.run(quiet, trials=TRIALS, first_seed=0, **settings)
    return result, {(row.name, row.quantity): row for row in result.rows}


def test_shares_and_errors_are_judged(monkeypatch):
    result, rows = run(monkeypatch)
    assert result.passed
    assert rows["50 mm/s, ibvs", "held"].measured == 0.95
    assert rows["50 mm/s, ibvs", "grasp error"].expected == "<= 0.003"
    assert rows["0 mm/s, pbvs", "grasp error, worst"].measured == 0.001
    assert len(result.tables["trials"]["held"]) == TRIALS * len(CASES) * len(SERVOS)


@pytest.mark.parametrize(
    ("change", "quantity"),
    [
        ({"held": False, "reason": "lost"}, "held"),
        ({"error": 0.004}, "grasp error"),
        ({"stopped": "acceleration"}, "stopped by the safety monitor"),
    ],
)
def test_what_is_wrong_fails(monkeypatch, change, quantity):
    def wrong(case, method, seed, late):
        grasped = made(case, method, seed, late)
        bad = (str(case), method) == ("20 mm/s", "ibvs") and seed < 12
        return dc.replace(grasped, **change) if bad else grasped

    result, _ = run(monkeypatch, wrong)
    failed = [(row.name, row.quantity) for row in result.rows if not row.passed]
    assert failed == [("20 mm/s, ibvs", quantity)]


def test_kept_trials_are_not_run_again(monkeypatch, tmp_path):
    keep = tmp_path / "keep.jsonl"
    first, _ = run(monkeypatch, keep=str(keep))
    entries = [json.loads(line) for line in keep.read_text().splitlines() if line]
    assert len(entries) == TRIALS * len(CASES) * len(SERVOS)

    def again(*at):
        raise AssertionError("run again")

    second, _ = run(monkeypatch, again, keep=str(keep))
    assert [r.as_dict() for r in first.rows] == [r.as_dict() for r in second.rows]
