import csv
import dataclasses as dc
import json
import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.recording.figure import make_figure, style_axes

numbers = st.floats(-1e6, 1e6)


def make_result(rows=None, **columns):
    figure = make_figure(3, 2, "a figure")
    axes = figure.subplots()
    style_axes(axes, xlabel="time [s]", ylabel="q [rad]")
    axes.plot([0, 1], [0, 1])
    columns = columns or {"time [s]": [0.0, 0.1], "q [rad]": np.array([1 / 3, 2.0])}
    rows = rows or [Row.at_most("base", "drift", 3.0, 1.5, "um/s")]
    return ExperimentResult(rows, {"motion": columns}, figure)


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


@pytest.mark.parametrize("reason", ["", "the pads are too soft"])
@pytest.mark.parametrize("slip", [1.0, 5.0])
def test_a_known_reason_excuses_a_row_but_does_not_pass_it(slip, reason):
    row = Row.at_most("can", "slip", 3.0, slip, "mm").because(reason)
    result = dc.replace(make_result(), rows=[row])
    assert row.passed == (slip < 3.0)
    assert result.passed == (slip < 3.0 or bool(reason))
    word = "ok" if slip < 3.0 else "known" if reason else "FAIL"
    assert result.table().splitlines()[1].startswith(word)


def test_criteria_are_readable():
    assert Row.at_most("", "", 3.0, 1.0, "").expected == "<= 3"
    assert Row.at_least("", "", 0.145, 1.0, "").expected == ">= 0.145"
    assert Row.within("", "", 2.0, 1.0, "", relative=0.03).expected == "2 +- 0.06"


def test_files_contain_the_rows_the_table_and_the_figure(tmp_path):
    result = make_result(**{"time [s]": [0.0, 0.1], "word": ["a", "b, c"]})
    paths = result.write("fake", tmp_path / "out")
    names = ["result.json", "motion.csv", "fake.png"]
    assert paths == result.paths("fake", tmp_path / "out")
    assert [path.name for path in paths] == names
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted(names)
    assert json.loads(paths[0].read_text()) == [
        {
            "name": "base",
            "quantity": "drift",
            "expected": "<= 3",
            "measured": 1.5,
            "unit": "um/s",
            "pass": True,
            "spread": pytest.approx(0.3),
            "clock": "",
        }
    ]
    with paths[1].open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows == [
        {"time [s]": "0", "word": "a"},
        {"time [s]": "0.1", "word": "b, c"},
    ]
    assert cv2.imread(str(paths[2])).shape == (220, 330, 3)


def test_other_files_are_written_too(tmp_path):
    result = dc.replace(make_result(), files={"frame.dmd.yaml": "directives: []\n"})
    paths = result.write("thing", tmp_path)
    assert [path.name for path in paths] == [
        "result.json",
        "motion.csv",
        "frame.dmd.yaml",
        "thing.png",
    ]
    assert (tmp_path / "frame.dmd.yaml").read_text() == "directives: []\n"


def test_numbers_keep_nine_digits_in_the_csv(tmp_path):
    values = np.random.default_rng(0).normal(size=20)
    values[3] = np.nan
    path = make_result(x=values).write("fake", tmp_path)[1]
    read = np.genfromtxt(path, skip_header=1, delimiter=",")
    np.testing.assert_allclose(read, values, rtol=1e-8)


def test_equal_results_give_equal_bytes(tmp_path):
    one, two = (make_result().write("fake", tmp_path / name) for name in "ab")
    for a, b in zip(one, two, strict=True):
        assert a.read_bytes() == b.read_bytes()


def test_a_result_that_cannot_be_written_completely_is_not_written(tmp_path):
    result = make_result()
    result.figure.savefig = None  # drawing comes last and fails
    with pytest.raises(TypeError):
        result.write("fake", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_one_failing_row_fails_the_experiment():
    good = Row.at_most("a", "b", 1.0, 0.5, "m")
    bad = Row.at_most("a", "b", 1.0, 1.5, "m")
    assert make_result([good, good]).passed
    assert not make_result([good, bad]).passed
    assert [line.split()[0] for line in make_result([good, bad]).table().split("\n")][
        1:
    ] == ["ok", "FAIL"]


@pytest.mark.parametrize(
    "columns", [{"a": [1, 2], "b": [1]}, {"a": [[1], [2]]}, {"a": 1.0}]
)
def test_columns_of_a_table_must_be_equally_long(columns):
    with pytest.raises(ValueError, match="'motion': columns must have the same length"):
        make_result(**columns)


def test_an_experiment_needs_rows():
    with pytest.raises(ValueError, match="rows: must not be empty"):
        ExperimentResult([], {}, make_figure(3, 2))
