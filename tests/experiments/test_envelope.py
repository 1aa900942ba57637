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
    Cell,
    Outcome,
    bisect,
    make_cases,
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


@pytest.fixture(scope="module")
def cell():
    return Cell()


@pytest.fixture(scope="module")
def cases(cell):
    return make_cases(cell, 10)


def failed(outcomes, found=EDGES):
    rows = judge(outcomes, found)
    return {(row.name, row.quantity) for row in rows if not row.passed}


@pytest.mark.parametrize(
    ("case", "claimed"),
    [
        (Case(UPRIGHT, 0.4, 0.3), True),
        (Case(LYING, RADIUS, 0.0, LIES, -OFF_RADIAL), True),
        (Case(LYING, RADIUS, 0.0, LIES, np.pi - OFF_RADIAL), True),  # its other end
        (Case(LYING, RADIUS + 1e-3, 0.0, LIES, 0.0), False),
        (Case(LYING, RADIUS, 0.0, LIES, OFF_RADIAL + 0.01), False),
        (Case(LEANING, 0.4, 0.0, np.deg2rad(30), np.deg2rad(30)), True),
        (Case(LEANING, 0.4, 0.0, np.deg2rad(30), np.pi), False),  # towards the arm
        (Case("leaning 45 degrees", 0.3, 0.0, np.deg2rad(45)), False),
    ],
)
def test_the_claimed_envelope_ends_at_its_limits(case, claimed):
    assert case.claimed == claimed


def test_cylinders_touch_the_table_within_the_region(cell, cases):
    for case in cases:
        X_WO = cell.pose(case)
        axis, p = X_WO.rotation().matrix()[:, 2], X_WO.translation()
        # The lowest point of a cylinder of 50 mm length and 12.5 mm radius.
        lowest = p[2] - 0.025 * abs(axis[2]) - 0.0125 * np.hypot(axis[0], axis[1])
        assert lowest == pytest.approx(0.1)
        assert np.all(p[:2] >= np.array(cell.region.min) - 1e-9)
        assert np.all(p[:2] <= np.array(cell.region.max) + 1e-9)
        assert axis[2] == pytest.approx(np.cos(case.lean))


def test_directions_count_from_the_line_through_joint_1(cell):
    place = np.array([-0.3, -0.1])
    away = place - cell.center
    for off in (0.0, 0.4, -2.0):
        case = cell.case(LEANING, place, 0.5, off)
        np.testing.assert_allclose(cell.place(case), place)
        assert case.radius == pytest.approx(np.linalg.norm(away))
        axis = cell.pose(case).rotation().matrix()[:2, 2]
        angle = np.arctan2(away[0] * axis[1] - away[1] * axis[0], away @ axis)
        assert angle == pytest.approx(off)


def test_simulated_cases_are_spread_over_the_claim(cases):
    runs = [case for case in cases if case.way == SIMULATED]
    assert len(runs) == 10
    assert all(case.claimed for case in runs)
    assert max(case.radius for case in runs) - min(case.radius for case in runs) > 0.02
    assert {bool(np.cos(case.off) > 0.0) for case in runs} == {True, False}


def test_the_planner_decides_without_simulation(cell):
    assert cell.plan(Case(LYING, 0.265, 0.1, LIES, 0.1)).failure is None
    outcome = cell.plan(Case(LYING, 0.265, 0.1, LIES, LIES))
    assert outcome.failure == "out_of_reach"
    assert "from above" in outcome.message


def test_a_simulated_cycle_stands_the_cylinder_up(cell):
    outcome = cell.run(Case(SIMULATED, 0.27, -0.15, LIES, 0.2), seed=3)
    assert outcome.failure is None
    assert outcome.error < 1e-3  # clearance of the recess


@pytest.mark.parametrize("edge", [-0.7, 0.3, 1.9])
def test_bisection_finds_an_edge(edge):
    found = bisect(lambda x: x <= edge, -1.0, 2.0, 1e-3)
    assert found == pytest.approx(edge, abs=1e-3)
    assert found <= edge
    assert np.isnan(bisect(lambda x: x > edge, -1.0, 2.0, 1e-3))


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


def test_every_case_and_every_reason_is_in_the_tables(monkeypatch):
    for name, value in (
        ("_STANDING", (1, 1)), ("_LYING", (2, 1)), ("_LEANING", (1, 1)),
        ("_STEP", 90), ("_LEANING_STEP", 180), ("LEANS", (30,)),
    ):  # fmt: skip
        monkeypatch.setattr(envelope_cases, name, value)
    monkeypatch.setattr(envelope, "edges", lambda cell: EDGES)
    result = envelope.run(quiet, runs=1)
    assert result.passed, result.table()
    poses, reasons = result.tables["poses"], result.tables["reasons"]
    assert poses["way"] == [UPRIGHT, *[LYING] * 4, *[LEANING] * 2, SIMULATED]
    assert sum(reasons["count"]) == len([f for f in poses["failure"] if f])
    assert all("#" in message for message in reasons["message"])
    assert len(result.figure.axes) == 2
