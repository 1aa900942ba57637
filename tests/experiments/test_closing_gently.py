import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.experiments import closing_gently
from drake_srg.experiments.closing_gently import (
    APPROACH,
    CASES,
    FREEZE,
    RAMP,
    STEP,
    Closing,
    close,
    compare,
    judge,
    ramp,
)
from drake_srg.experiments.registry import quiet

TIME = np.arange(0.0, 2.0, 0.002)


def pressing(start, peak, end):
    """A force from a time on: a peak of 10 ms, then a steady value."""
    return np.where(start > TIME, 0.0, np.where(start + 0.01 > TIME, peak, end))


def made_up(impact=0.2, steady=20.0, shift=0.001, tip=1.0, **changes):
    """A hand whose bases touch at 0.5 s and whose tips close at `tip` [s]."""
    base = pressing(0.5, impact, impact)
    base = np.where(tip <= TIME, steady, base)
    return dc.replace(
        Closing(
            time=TIME,
            proximity=np.full((len(TIME), 4), 0.001),
            touch=np.stack([base, base, *2 * [pressing(tip, 30.0, 15.0)]], axis=1),
            shift=shift * np.clip(TIME, 0.0, 1.0),
            slip=0.0005,
        ),
        **changes,
    )


def failed(rows):
    return {row.quantity for row in rows if not row.passed}


def test_the_impact_is_what_happens_before_a_tip_touches():
    closing = made_up(impact=80.0, steady=100.0)
    assert closing.impact == 80.0
    assert closing.steady == 100.0
    assert closing.grasped == pytest.approx(1.0)
    assert closing.largest_shift == pytest.approx(0.001)


@pytest.mark.parametrize("name", CASES)
def test_only_bases_that_promise_to_stop_fail_by_touching_first(name):
    promised = name in (RAMP, FREEZE)
    assert bool(failed(judge(name, made_up(impact=5.0)))) == promised
    assert failed(judge(name, made_up())) == set()


@pytest.mark.parametrize(
    ("changes", "quantity"),
    [
        ({"slip": 0.006}, "slip in the hand that lifts the can"),
        ({"touch": np.zeros((len(TIME), 4))}, "both tips touch after"),
    ],
)
def test_a_can_that_is_not_held_fails(changes, quantity):
    assert quantity in failed(judge(STEP, made_up(**changes)))


@pytest.mark.parametrize(
    ("changes", "quantity"),
    [
        ({"impact": 90.0}, "base force, impact"),
        ({"steady": 60.0}, "base force at the end"),
        ({"shift": 0.003}, "largest shift of the can"),
        ({"tip": 1.11}, "both tips touch after, up to 0.1 s later"),
    ],
)
def test_gentle_must_be_better_in_all(changes, quantity):
    step = made_up(impact=80.0, steady=50.0, shift=0.002)
    assert failed(compare(step, made_up())) == set()
    assert failed(compare(step, made_up(**changes))) == {quantity}


@given(st.integers(0, 1100))
def test_the_ramp_is_that_of_the_client(message):
    assert ramp(message / 25.0) == min(message, 1000) // 10 / 100.0


@pytest.mark.slow
def test_the_hand_closes_gently_and_holds_the_can():
    closing = close(dc.replace(CASES[APPROACH], duration=1.7), 0.002)
    assert failed(judge(APPROACH, closing)) == set()
    assert closing.impact < 40.0  # 80 N and more after a step


def test_every_case_gets_a_table_and_a_column_of_the_figure(monkeypatch):
    monkeypatch.setattr(closing_gently, "close", lambda case, step: made_up())
    result = closing_gently.run(quiet)
    assert set(result.tables) == {
        "step",
        "ramp",
        "freeze",
        "freeze_at_2_mm",
        "freeze_approach",
    }
    assert len(result.figure.axes) == 3 * len(CASES)
