"""The experiment on visual servoing: its judgement, without its simulations."""

import dataclasses as dc
import json

import numpy as np

from drake_srg.experiments import visual_servoing
from drake_srg.experiments.registry import quiet
from drake_srg.experiments.servo_trials import METHODS, Case, Grasped
from drake_srg.experiments.visual_servoing import CASES, SERVOS

TRIALS = 20


def made(case, method, seed, overrides=()):
    """Servos miss one of 20 in every case, looking misses all but the first case."""
    if method in SERVOS:
        held = seed % TRIALS != 0
        return Grasped(held, 0.001, 0.0005, "" if held else "lost")
    if case == CASES[0]:
        return Grasped(True, 0.002, 0.001, "")
    return Grasped(False, None, None, "not reached")


def run(monkeypatch, grasp_once=made, **settings):
    monkeypatch.setattr(visual_servoing, "grasp_once", grasp_once)
    return visual_servoing.run(quiet, trials=TRIALS, first_seed=0, **settings)


def test_shares_and_errors_are_judged(monkeypatch):
    result = run(monkeypatch)
    assert result.passed
    rows = {(row.name, row.quantity): row for row in result.rows}
    assert rows["50 mm/s, ibvs", "held"].measured == 0.95
    assert rows["50 mm/s, ibvs", "held"].expected == ">= 0.95"
    assert rows["50 mm/s, look once", "held"].expected == "a number"
    assert rows["0 mm/s, look once", "held"].expected == ">= 0.95"
    assert rows["20 mm, 5 degrees off, pbvs", "grasp error"].measured == 0.001
    assert ("50 mm/s, look once", "grasp error") not in rows
    table = result.tables["trials"]
    assert len(table["held"]) == TRIALS * len(CASES) * len(METHODS)
    assert np.isnan(table["error [m]"]).sum() == TRIALS * 4 * 2


def test_a_servo_that_misses_more_fails(monkeypatch):
    def worse(case, method, seed, overrides):
        return made(case, method, 0 if seed < 2 else seed)

    result = run(monkeypatch, worse)
    failed = {row.name for row in result.rows if not row.passed}
    assert failed == {f"{case}, {method}" for case in CASES for method in SERVOS}


def test_servos_that_need_the_step_fail(monkeypatch):
    def changed(case, method, seed, overrides):
        result = made(case, method, seed)
        return dc.replace(result, error=0.002) if overrides else result

    result = run(monkeypatch, changed, half=4)
    failed = [(row.name, row.quantity) for row in result.rows if not row.passed]
    quantity = "change of the grasp error, median"
    assert failed == [(f"{servo}, half the step", quantity) for servo in SERVOS]

    def otherwise(case, method, seed, overrides):
        return dc.replace(made(case, method, seed), held=seed % 2 == 0 or not overrides)

    result = run(monkeypatch, otherwise, half=4)
    assert not result.passed
    rows = {(row.name, row.quantity): row for row in result.rows}
    row = rows["pbvs, half the step", "end otherwise, share"]
    assert (row.measured, row.passed) == (0.5, False)
    assert rows["pbvs, half the step", "trials"].measured == 4 * len(CASES)


def test_kept_trials_are_not_run_again(monkeypatch, tmp_path):
    keep = tmp_path / "keep.jsonl"
    first = run(monkeypatch, half=4, keep=str(keep))
    entries = [json.loads(line) for line in keep.read_text().splitlines() if line]
    assert len(entries) == len(CASES) * (TRIALS * len(METHODS) + 4 * len(SERVOS))

    def again(*at):
        raise AssertionError("run again")

    second = run(monkeypatch, again, half=4, keep=str(keep))
    assert [r.as_dict() for r in first.rows] == [r.as_dict() for r in second.rows]


def test_cases_name_what_makes_them_hard():
    assert str(Case(0.02)) == "20 mm/s"
    assert str(Case(distance=0.01, angle=np.deg2rad(2.5))) == "10 mm, 2.5 degrees off"
    assert len({str(case) for case in CASES}) == len(CASES)
