import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.experiments.row import Row

numbers = st.floats(-1e6, 1e6)


@given(limit=numbers, measured=numbers)
def test_bounds_are_inclusive(limit, measured):
    assert Row.at_most("", "", limit, measured, "").passed == (measured <= limit)
    assert Row.at_least("", "", limit, measured, "").passed == (measured >= limit)
    assert Row.at_most("", "", limit, limit, "").passed
    assert Row.at_least("", "", limit, limit, "").passed


@given(expected=numbers, share=st.floats(0, 2), inside=st.floats(0, 0.999))
def test_a_relative_deviation_is_a_share_of_the_expected_value(expected, share, inside):
    deviation = share * abs(expected)
    near, far = expected + inside * deviation, expected + 1.01 * deviation + 1e-6
    assert Row.within("", "", expected, near, "", relative=share, absolute=1e-9).passed
    assert not Row.within("", "", expected, far, "", relative=share).passed


def test_the_larger_of_two_deviations_counts():
    for measured, passed in ((2.4, True), (2.6, False)):
        row = Row.within("", "", 2.0, measured, "", relative=0.1, absolute=0.5)
        assert row.passed == passed


@pytest.mark.parametrize("measured", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_fail_and_become_null(measured):
    rows = [
        Row.at_most("", "", 1.0, measured, ""),
        Row.at_least("", "", 1.0, measured, ""),
        Row.within("", "", 1.0, measured, "", relative=math.inf),
        Row.info("", "", measured, ""),
    ]
    for row in rows:
        assert not row.passed
        assert row.as_dict()["measured"] is None


@given(limit=numbers, measured=numbers)
def test_far_below_a_limit_a_tenth_of_the_limit_means_nothing(limit, measured):
    tenth = 0.1 * max(abs(limit), abs(measured))
    for make in (Row.at_most, Row.at_least):
        row = make("", "", limit, measured, "")
        assert row.spread == pytest.approx(max(tenth, 1e-6))


@given(expected=numbers, measured=numbers, share=st.floats(0, 2))
def test_the_allowed_deviation_bounds_the_spread(expected, measured, share):
    row = Row.within("", "", expected, measured, "", relative=share)
    tenth = 0.1 * max(abs(expected), abs(measured))
    assert row.spread <= max(min(share * abs(expected), tenth), 1e-6) * (1 + 1e-9)


def test_around_zero_the_spread_is_the_allowed_deviation():
    assert Row.within("", "", 0.0, 0.01, "", absolute=0.5).spread == 0.5


@given(measured=numbers)
def test_a_spread_is_never_zero(measured):
    assert Row.info("", "", measured, "").spread >= max(0.1 * abs(measured), 1e-6)


@given(measured=numbers, clock=st.sampled_from(["time", "rate"]))
def test_wall_clock_values_may_move_by_half(measured, clock):
    half = max(0.5 * abs(measured), 1e-6)
    assert Row.info("", "", measured, "", clock=clock).spread == pytest.approx(half)


@given(spread=st.floats(1e-3, 1e3))
def test_the_maker_of_a_row_may_state_its_spread(spread):
    rows = [
        Row.at_most("", "", 1.0, 0.5, "", spread=spread),
        Row.at_least("", "", 1.0, 1.5, "", spread=spread, clock="time"),
        Row.within("", "", 1.0, 1.0, "", spread=spread),
        Row.info("", "", 1.0, "", spread=spread),
    ]
    assert {row.spread for row in rows} == {spread}


@given(
    measured=st.floats(),
    limit=numbers,
    clock=st.sampled_from(["", "time", "rate"]),
    reason=st.text(),
)
def test_rows_survive_json(measured, limit, clock, reason):
    row = Row.at_most("can", "slip", limit, measured, "mm", clock=clock)
    row = row.because(reason)
    text = json.dumps(row.as_dict(), allow_nan=False)
    read = Row.from_dict(json.loads(text))
    assert read.as_dict() == row.as_dict()
    assert math.isfinite(read.measured) == math.isfinite(measured)


def test_criteria_are_readable():
    assert Row.at_most("", "", 3.0, 1.0, "").expected == "<= 3"
    assert Row.at_least("", "", 0.145, 1.0, "").expected == ">= 0.145"
    assert Row.within("", "", 2.0, 1.0, "", relative=0.03).expected == "2 +- 0.06"
