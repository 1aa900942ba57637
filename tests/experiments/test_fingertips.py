import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import fingertips
from drake_srg.experiments.fingertips import (
    FRICTION,
    OFFSETS,
    Case,
    centered_up_to,
    fingertip_cases,
    judge,
    left,
    take,
    up_to,
)
from drake_srg.experiments.registry import quiet
from experiments.made_cycles import cycle


@pytest.mark.slow
def test_the_hand_goes_where_the_offset_says(monkeypatch):
    # Coarse steps suffice for this, until the fingers have closed.
    brief = [*fingertips._OVERRIDES, "planner.time_budget=2.0"]
    monkeypatch.setattr(fingertips, "_OVERRIDES", brief)
    case = Case("curved", "dry", "x", 6.0, step=0.005)
    result = take(case)
    assert result.p_GO_open is not None
    p_GO = take(dc.replace(case, offset=0.0)).p_GO_open
    assert result.metrics.attempts == 1
    # Inverse kinematics and servos leave some tenths of a millimetre.
    np.testing.assert_allclose(result.p_GO_open - p_GO, [6e-3, 0, 0], atol=5e-4)


def test_every_offset_is_tried_with_both_pads():
    cases = fingertip_cases()
    assert len(set(cases)) == len(cases)
    for pads in ("curved", "flat"):
        for direction in "xy":
            tried = {
                case.offset
                for case in cases
                if (case.pads, case.surface, case.direction) == (pads, "dry", direction)
            }
            assert tried >= set(OFFSETS)


def test_up_to_stops_at_the_first_case_that_is_not_good():
    cases = [Case("flat", "dry", "x", float(offset)) for offset in (0, 1, 2, 3)]
    assert up_to(cases, lambda case: case.offset != 2.0) == 1.0
    assert up_to(cases, lambda _: True) == 3.0
    assert np.isnan(up_to(cases, lambda _: False))


def test_friction_limits_the_offset_that_closing_centres():
    # The arc's half chord, 8.03 mm, without friction; nothing at the angle of its end.
    assert centered_up_to(0.0) == pytest.approx(8.03, abs=5e-3)
    assert centered_up_to(np.tan(np.deg2rad(40.0))) == pytest.approx(0.0, abs=1e-9)


def test_the_remaining_offset_counts_from_the_middle():
    shifted = cycle(p_GO_open=(0.099, 0, 0), p_GO_held=(0.096, 0, 0))
    assert left(Case("curved", "dry", "x", 4.0), shifted) == pytest.approx(1.0)
    never = dc.replace(shifted, p_GO_held=None)
    assert np.isnan(left(Case("curved", "dry", "x", 4.0), never))


def made_up(case, **changes):
    """A cycle in which curved pads centre along x like rigid ones, flat pads never."""
    offset = 1e-3 * case.offset * np.eye(3)["xyz".index(case.direction)]
    reach = centered_up_to(FRICTION[case.surface]) if case.pads == "curved" else 0.0
    centered = case.direction == "y" or case.offset <= reach
    tip = np.array([0.095, 0.0, 0.0])
    slip = 4e-4 * case.step / 1e-3
    return cycle(tip + offset, tip if centered else tip + offset, slip=slip, **changes)


def failed(change):
    """Return names and quantities that fail when some cycles are changed."""
    cycles = {case: change(case, made_up(case)) for case in fingertip_cases()}
    return {(row.name, row.quantity) for row in judge(cycles) if not row.passed}


def test_firm_grasps_pass():
    assert failed(lambda _, cycle: cycle) == set()


def test_an_object_that_is_lost_fails():
    def lose(case, cycle):
        lost = case.group == "flat, dry, along x" and case.offset == 7.0
        metrics = dc.replace(cycle.metrics, success=not lost)
        return dc.replace(cycle, metrics=metrics, slip=None if lost else cycle.slip)

    group = "flat, dry, along x"
    assert failed(lose) == {
        (group, "grasped, up to an offset of"),
        (group, "motion while carried, step 1 ms"),
    }


@pytest.mark.parametrize("centered", [0.0, 7.0])
def test_curved_pads_must_centre_more_than_flat_and_less_than_rigid_ones(centered):
    def close(case, cycle):
        if case.group != "curved, greasy, along x":
            return cycle
        held = [0.095, 0, 0] if case.offset <= centered else cycle.p_GO_open
        return dc.replace(cycle, p_GO_held=np.array(held))

    ((group, quantity),) = failed(close)
    assert group == "curved, greasy, along x"
    assert "centred" in quantity


def test_slip_that_does_not_vanish_with_the_step_fails():
    def slip(case, cycle):
        slips = case.pads == "flat" and case.step > 0.001
        return dc.replace(cycle, slip=4e-4) if slips else cycle

    names = {"flat, dry, along x, 0 mm", "flat, dry, along x, 8 mm"}
    assert failed(slip) == {(name, "slip, extrapolated to step 0") for name in names}


def test_every_case_is_in_the_table(monkeypatch):
    monkeypatch.setattr(fingertips, "take", made_up)
    result = fingertips.run(quiet)
    assert result.passed
    assert len(result.tables["grasps"]["success"]) == len(fingertip_cases())
    assert len(result.figure.axes) == 3
