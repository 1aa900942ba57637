import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import experiments.runner as ex
from drake_srg.common.exceptions import ScenarioError
from experiments.runner.claims import Row, row, rows_of

numbers = st.floats(-1e6, 1e6)


@given(limit=numbers, measured=numbers)
def test_bounds_are_inclusive(limit, measured):
    assert row("", "", measured, "", ex.at_most(limit)).passed == (measured <= limit)
    assert row("", "", measured, "", ex.at_least(limit)).passed == (measured >= limit)
    assert row("", "", limit, "", ex.at_most(limit)).passed
    assert row("", "", limit, "", ex.at_least(limit)).passed


@given(expected=numbers, share=st.floats(0, 2), inside=st.floats(0, 0.999))
def test_a_relative_deviation_is_a_share_of_the_expected_value(expected, share, inside):
    deviation = share * abs(expected)
    near, far = expected + inside * deviation, expected + 1.01 * deviation + 1e-6
    bound = ex.within(expected, relative=share, absolute=1e-9)
    assert row("", "", near, "", bound).passed
    assert not row("", "", far, "", ex.within(expected, relative=share)).passed


def test_the_larger_of_two_deviations_counts():
    for measured, passed in ((2.4, True), (2.6, False)):
        bound = ex.within(2.0, relative=0.1, absolute=0.5)
        assert row("", "", measured, "", bound).passed == passed


@pytest.mark.parametrize("measured", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("bound", [ex.at_most(1.0), ex.at_least(1.0), ex.number()])
def test_values_that_are_not_finite_fail_and_become_null(measured, bound):
    made = row("", "", measured, "", bound)
    assert not made.passed
    assert made.as_dict()["measured"] is None


@given(limit=numbers, measured=numbers)
def test_far_below_a_limit_a_tenth_of_the_limit_means_nothing(limit, measured):
    tenth = 0.1 * max(abs(limit), abs(measured))
    for bound in (ex.at_most(limit), ex.at_least(limit)):
        assert row("", "", measured, "", bound).spread == pytest.approx(
            max(tenth, 1e-6)
        )


@given(expected=numbers, measured=numbers, share=st.floats(0, 2))
def test_the_allowed_deviation_bounds_the_spread(expected, measured, share):
    made = row("", "", measured, "", ex.within(expected, relative=share))
    tenth = 0.1 * max(abs(expected), abs(measured))
    assert made.spread <= max(min(share * abs(expected), tenth), 1e-6) * (1 + 1e-9)


def test_around_zero_the_spread_is_the_allowed_deviation():
    assert row("", "", 0.01, "", ex.within(0.0, absolute=0.5)).spread == 0.5


@given(measured=numbers, clock=st.sampled_from(["time", "rate"]))
def test_wall_clock_values_may_move_by_half(measured, clock):
    half = max(0.5 * abs(measured), 1e-6)
    assert row("", "", measured, "", ex.number(clock=clock)).spread == pytest.approx(
        half
    )


@given(spread=st.floats(1e-3, 1e3))
def test_a_bound_may_state_its_spread(spread):
    bounds = [
        ex.at_most(1.0, spread=spread),
        ex.at_least(1.0, spread=lambda value: spread, clock="time"),
        ex.within(1.0, spread=spread),
        ex.number(spread=spread),
    ]
    assert {row("", "", 1.0, "", bound).spread for bound in bounds} == {spread}


@given(
    measured=st.floats(),
    limit=numbers,
    clock=st.sampled_from(["", "time", "rate"]),
    reason=st.text(),
)
def test_rows_survive_json(measured, limit, clock, reason):
    bound = ex.at_most(limit, clock=clock, known=reason, source="thesis")
    made = row("can", "slip", measured, "mm", bound)
    read = Row.from_dict(json.loads(json.dumps(made.as_dict(), allow_nan=False)))
    assert read.as_dict() == made.as_dict()
    assert made.fails == (not made.passed and not reason)


def test_criteria_are_readable():
    assert ex.at_most(3.0).text == "<= 3"
    assert ex.at_least(0.145).text == ">= 0.145"
    assert ex.within(2.0, relative=0.03).text == "2 +- 0.06"


def rows(values, claims=None):
    return list(rows_of("can", values, claims or {}, ex.Trials([{}])))


def test_numbers_with_a_unit_are_rows():
    values = {"slip [mm]": 1.0, "time [s]": np.zeros(3), "slip": 2.0, "seen [mm]": None}
    values["note [mm]"] = "text"
    (made,) = rows(values)
    assert (made.name, made.quantity, made.unit) == ("can", "slip", "mm")
    assert made.expected == "a number"


def test_claims_give_bounds_by_quantity_or_name_or_as_a_function():
    for claim in (
        ex.at_most(3.0),
        {"can": ex.at_most(3.0)},
        lambda own: ex.at_most(3.0),
    ):
        (made,) = rows({"slip [mm]": 1.0}, {"slip": claim})
        assert made.expected == "<= 3"
    (other,) = rows({"slip [mm]": 1.0}, {"slip": {"box": ex.at_most(3.0)}})
    assert other.expected == "a number"


def test_a_quantity_may_have_several_bounds():
    two = [ex.at_least(0.0), ex.at_most(3.0)]
    assert [r.expected for r in rows({"x []": 1.0}, {"x": two})] == [">= 0", "<= 3"]
    pairs = {"x []": [(1.0, bound) for bound in two]}
    assert [r.expected for r in rows(pairs)] == [">= 0", "<= 3"]


def test_a_share_has_its_interval():
    values = ex.share("held", 9, 10, ex.at_least(0.95), spread=0.1, first=", share")
    share, low, high = rows(values)
    assert (share.quantity, share.measured) == ("held, share", 0.9)
    assert not share.passed
    # E. B. Wilson, J. Am. Stat. Assoc. 22:209, 1927.
    assert low.measured == pytest.approx(0.5958, abs=1e-4)
    assert high.measured == pytest.approx(0.9821, abs=1e-4)
    assert {r.spread for r in (share, low, high)} == {0.1}
    assert ex.wilson(0, 0) == (0.0, 1.0)


def test_quantiles_need_values():
    assert ex.quantiles("time", "s", np.zeros(0)) == {}
    assert ex.quantiles("time", "s", np.arange(101.0))["time, 5 % quantile [s]"] == 5.0


def trials():
    return ex.Trials(
        [
            {"thing": thing, "seed": seed, "slip": slip}
            for thing, seed, slip in (
                ("can", 0, 1.0),
                ("can", 1, None),
                ("box", 0, 3.0),
            )
        ]
    )


def test_trials_are_grouped_and_chosen():
    groups = trials().groups("thing", "seed")
    assert list(groups) == ["can, 0", "can, 1", "box, 0"]
    can = trials().where(thing="can")
    assert list(can["seed"]) == [0, 1]
    assert len(can.whole) == 3
    assert list(can.known("slip")) == [1.0]
    assert np.isnan(can["slip"][1])
    assert trials().where(thing="box").one("slip") == 3.0
    with pytest.raises(ValueError, match="needs one trial, got 2"):
        can.one("slip")


@pytest.mark.parametrize(
    ("bound", "source"),
    [
        (ex.at_most(3.0), "own"),
        (ex.at_most(3.0, source="thesis"), "thesis"),
        (ex.number(), ""),
    ],
)
def test_every_criterion_has_a_source(bound, source):
    made = row("can", "slip", 1.0, "mm", bound)
    assert made.source == source
    assert Row.from_dict(made.as_dict()) == made
    assert ("source" in made.as_dict()) == (source == "thesis")


def test_reasons_are_counted():
    found = ex.counts(["slipped", "lost", "slipped"], "trials", least=2.0)
    slipped, lost = rows_of("all", found, {}, ex.Trials([]))
    assert (slipped.quantity, slipped.measured, slipped.unit) == (
        "slipped",
        2,
        "trials",
    )
    assert (lost.measured, lost.spread) == (1, 2.3)


def test_names_are_chosen_or_all_of_them():
    assert ex.chosen("objects", [], ["mug", "can"]) == ["mug", "can"]
    assert ex.chosen("objects", ["can"], ["mug", "can"]) == ["can"]
    with pytest.raises(ScenarioError, match=r"^objects: unknown 'cna' .*'can'"):
        ex.chosen("objects", ["cna"], ["mug", "can"])
