import dataclasses as dc
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import experiments.runner as ex
from experiments.runner.claims import row
from experiments.runner.committed import compare, slowdown

sizes = st.floats(1e-3, 1e3)
values = st.floats(-1e3, 1e3)


@st.composite
def passing(draw):
    value = draw(values)
    name = draw(st.sampled_from(["can", "box"]))
    return draw(
        st.sampled_from(
            [
                row(name, "slip", value, "mm", ex.at_most(value + 1.0)),
                row(name, "slip", value, "mm", ex.at_least(value - 1.0)),
                row(name, "force", value, "N", ex.within(value, relative=0.1)),
                row(name, "slip", value, "mm"),
                row(name, "duration", abs(value), "s", ex.number(clock="time")),
            ]
        )
    )


def whats(old, new):
    return [change.what for change in compare(old, new)]


@given(st.lists(passing()))
def test_the_same_rows_are_no_change(rows):
    assert compare(rows, rows) == []


@given(value=values, spread=sizes, share=st.floats(0.0, 0.99))
def test_a_row_moves_by_more_than_its_spread_or_not_at_all(value, spread, share):
    old = row("can", "slip", value, "mm", ex.number(spread=spread))
    for sign in (-1.0, 1.0):
        near, far = (value + sign * spread * k for k in (share, 2.0 - share))
        assert whats([old], [row("can", "slip", near, "mm")]) == []
        assert whats([old], [row("can", "slip", far, "mm")]) == ["moved"]


def test_the_committed_spread_counts():
    old = row("can", "slip", 1.0, "mm", ex.number(spread=0.1))
    new = row("can", "slip", 1.5, "mm", ex.number(spread=9.0))
    (change,) = compare([old], [new])
    assert (change.row, change.old, change.new) == (old, 1.0, 1.5)


def test_a_drift_within_the_criterion_is_noticed():
    # As happened to fingers that press on each other.
    old, new = (
        row("fingers", "contact force, mean", force, "N", ex.at_least(0.5))
        for force in (11.25, 8.36)
    )
    assert new.passed
    assert whats([old], [new]) == ["moved"]


@pytest.mark.parametrize("noise", [0.0, 1e-12, 5e-5])
def test_noise_far_below_a_limit_is_no_change(noise):
    old = row("fingers", "speed", 8.7e-11, "rad/s", ex.at_most(1.5e-3))
    new = row("fingers", "speed", noise, "rad/s", ex.at_most(1.5e-3))
    assert compare([old], [new]) == []


def test_a_row_that_fails_is_reported_once_even_if_it_moved():
    old = row("can", "slip", 1.0, "mm", ex.at_most(3.0))
    new = row("can", "slip", 5.0, "mm", ex.at_most(3.0))
    for committed in ([old], [new], None):
        assert whats(committed, [new]) == ["failed"]


def test_a_known_miss_must_stay_where_it_is():
    small, large, met = (
        row("can", "slip", slip, "mm", ex.at_most(3.0, known="soft pads"))
        for slip in (5.0, 8.0, 2.0)
    )
    assert whats([small], [small]) == []
    assert whats([small], [large]) == ["moved"]
    assert whats([small], [met]) == ["moved"]


def test_a_value_that_is_not_finite_any_more_fails():
    old, new = (row("can", "slip", v, "mm") for v in (1.0, math.nan))
    assert whats([old], [new]) == ["failed"]
    assert whats([new], [old]) == ["moved"]


@pytest.mark.parametrize("change", [{"name": "b"}, {"quantity": "b"}, {"unit": "b"}])
def test_rows_appear_and_vanish(change):
    own = row("can", "slip", 1.0, "mm")
    other = dc.replace(own, **change)
    assert whats([own], [own, other]) == ["appeared"]
    assert whats([own, other], [own]) == ["vanished"]
    assert sorted(whats([own], [other])) == ["appeared", "vanished"]


def test_of_equal_names_the_first_belongs_to_the_first():
    one, two = (row("worker", "memory", m, "MB") for m in (400.0, 500.0))
    assert whats([one, two], [one, two]) == []
    assert whats([one, two], [two, one]) == ["moved", "moved"]
    assert whats([one, two], [one]) == ["vanished"]


def test_without_committed_rows_nothing_has_changed():
    assert compare(None, [row("can", "slip", 1.0, "mm")]) == []


def clocked(times, rates, ratio=1.0):
    return [
        *(
            row(f"{i}", "time", t, "s", ex.number(clock="time"))
            for i, t in enumerate(times)
        ),
        *(
            row(f"{i}", "rate", r, "", ex.number(clock="rate"))
            for i, r in enumerate(rates)
        ),
        row("2 : 1", "ratio", ratio, ""),
    ]


@given(
    times=st.lists(sizes, min_size=2, max_size=4),
    rates=st.lists(sizes, max_size=3),
    slower=st.floats(0.1, 10.0),
)
def test_another_machine_changes_no_wall_clock_row(times, rates, slower):
    old = clocked(times, rates)
    new = clocked([slower * t for t in times], [r / slower for r in rates])
    assert slowdown(old, new) == pytest.approx(slower)
    assert compare(old, new) == []


@given(slower=st.floats(0.1, 10.0), worse=st.floats(1.6, 10.0))
def test_a_row_that_got_slower_than_the_others_has_moved(slower, worse):
    old = clocked([1.0, 2.0, 3.0], [4.0])
    times = [slower, 2.0 * slower, 3.0 * slower * worse]
    (change,) = compare(old, clocked(times, [4.0 / slower]))
    assert (change.what, change.row.name) == ("moved", "2")
    assert change.new == pytest.approx(3.0 * worse)


def test_a_ratio_of_two_times_is_compared_as_it_is():
    old, new = clocked([1.0, 2.0], [], 2.0), clocked([3.0, 6.0], [], 1.0)
    (change,) = compare(old, new)
    assert (change.row.name, change.new) == ("2 : 1", 1.0)


def test_times_of_zero_tell_nothing_about_the_machine():
    old, new = clocked([0.0, 1.0], []), clocked([0.0, 2.0], [])
    assert slowdown(old, new) == 2.0
