import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import envelope, envelope_cases
from drake_srg.experiments.envelope import judge
from drake_srg.experiments.envelope_cases import (
    LYING,
    OFF_RADIAL,
    RADIUS,
    SIMULATED,
    UPRIGHT,
    Case,
    Outcome,
)
from drake_srg.experiments.registry import quiet

LIES = 0.5 * np.pi
LEANING = "leaning 30 degrees"
EDGES = (RADIUS + 0.001, OFF_RADIAL + 0.01, OFF_RADIAL + 0.01)
GOOD = [
    Outcome(Case(UPRIGHT, 0.3, 0.0), None),
    Outcome(Case(LYING, RADIUS, 0.0, LIES, OFF_RADIAL), None),
    Outcome(Case(LYING, 0.3, 0.0, LIES), "out_of_reach", "no nearer than 9.0 mm"),
    Outcome(Case(LEANING, 0.3, 0.0, np.deg2rad(30), np.deg2rad(-30)), None),
    Outcome(Case(LEANING, 0.3, 0.0, np.deg2rad(30), np.pi), "blocked", "a and b are"),
    Outcome(Case(SIMULATED, 0.26, 0.1, LIES), None, error=2e-4),
]


def failed(outcomes, found=EDGES):
    rows = judge(outcomes, found)
    return {(row.name, row.quantity) for row in rows if not row.passed}


def test_cases_beyond_the_claim_may_fail():
    assert failed(GOOD) == set()


@pytest.mark.parametrize(
    ("index", "quantity"),
    [(0, "planned"), (1, "planned"), (3, "planned"), (5, "stood")],
)
def test_claimed_cases_must_not_fail(index, quantity):
    outcomes = list(GOOD)
    outcomes[index] = dc.replace(GOOD[index], failure="blocked", error=np.nan)
    names = {(name, quantity in what) for name, what in failed(outcomes)}
    assert (GOOD[index].case.way, True) in names


def test_a_simulated_cylinder_must_be_seated():
    outcomes = [*GOOD[:-1], dc.replace(GOOD[-1], error=1.1e-3)]
    assert failed(outcomes) == {(SIMULATED, "largest error in x or y")}


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("value", [0.2, np.nan])
def test_the_edges_must_be_beyond_the_claim(index, value):
    found = list(EDGES)
    found[index] = value
    [(name, quantity)] = failed(GOOD, tuple(found))
    assert name == LYING
    assert quantity.startswith("largest")


def seated(cell, case, seed):
    return Outcome(case, None, error=2e-4)


@pytest.mark.slow
def test_every_case_and_every_reason_is_in_the_tables(monkeypatch):
    for name, value in (
        ("_STANDING", (1, 1)), ("_LYING", (2, 1)), ("_LEANING", (1, 1)),
        ("_STEP", 90), ("_LEANING_STEP", 180), ("LEANS", (30,)),
    ):  # fmt: skip
        monkeypatch.setattr(envelope_cases, name, value)
    monkeypatch.setattr(envelope, "edges", lambda cell: EDGES)
    monkeypatch.setattr(envelope.Cell, "run", seated)  # see test_envelope_cases.py
    result = envelope.run(quiet, runs=1)
    assert result.passed, result.table()
    poses, reasons = result.tables["poses"], result.tables["reasons"]
    assert poses["way"] == [UPRIGHT, *[LYING] * 4, *[LEANING] * 2, SIMULATED]
    assert sum(reasons["count"]) == len([f for f in poses["failure"] if f])
    assert all("#" in message for message in reasons["message"])
    assert len(result.figure.axes) == 2
