import numpy as np
import pytest

from drake_srg.experiments.envelope_cases import (
    LYING,
    OFF_RADIAL,
    RADIUS,
    SIMULATED,
    UPRIGHT,
    Case,
    Cell,
    bisect,
    make_cases,
)

LIES = 0.5 * np.pi
LEANING = "leaning 30 degrees"


@pytest.fixture(scope="module")
def cell():
    return Cell()


@pytest.fixture(scope="module")
def cases(cell):
    return make_cases(cell, 10)


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


@pytest.mark.slow
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
