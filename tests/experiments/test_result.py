import csv
import dataclasses as dc
import json

import cv2
import numpy as np
import pytest
from hypothesis import strategies as st

from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import make_figure, style_axes

numbers = st.floats(-1e6, 1e6)


def make_result(rows=None, **columns):
    figure = make_figure(3, 2, "a figure")
    axes = figure.subplots()
    style_axes(axes, xlabel="time [s]", ylabel="q [rad]")
    axes.plot([0, 1], [0, 1])
    columns = columns or {"time [s]": [0.0, 0.1], "q [rad]": np.array([1 / 3, 2.0])}
    rows = rows or [Row.at_most("base", "drift", 3.0, 1.5, "um/s")]
    return ExperimentResult(rows, {"motion": columns}, figure)


@pytest.mark.parametrize("reason", ["", "the pads are too soft"])
@pytest.mark.parametrize("slip", [1.0, 5.0])
def test_a_known_reason_excuses_a_row_but_does_not_pass_it(slip, reason):
    row = Row.at_most("can", "slip", 3.0, slip, "mm").because(reason)
    result = dc.replace(make_result(), rows=[row])
    assert row.passed == (slip < 3.0)
    assert result.passed == (slip < 3.0 or bool(reason))
    word = "ok" if slip < 3.0 else "known" if reason else "FAIL"
    assert result.table().splitlines()[1].startswith(word)


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
