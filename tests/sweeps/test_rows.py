import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps import rows as rows_module
from drake_srg.sweeps.info import SweepInfo
from drake_srg.sweeps.rows import (
    TIMING_COLUMNS,
    BrokenRowsError,
    all_rows_path,
    read_file,
    read_rows,
    row_path,
    sampled_columns,
    unique_rows,
    write_row,
    write_rows,
)
from drake_srg.sweeps.trial import empty_row

from .stub import MASS

PAGE = Path(__file__).parents[2] / "docs" / "sweeps.md"
INFO = SweepInfo("kitchen", 7, 10, "none", [], "{}", {})


def make_row(trial, **values):
    return {**empty_row(7, trial, "lost"), **values}


@pytest.fixture
def folder(tmp_path):
    INFO.write(tmp_path)
    return tmp_path


def test_a_sweep_without_rows_has_the_common_columns(folder):
    rows = read_rows(folder)
    assert rows.num_rows == 0
    types = dict(zip(rows.schema.names, rows.schema.types, strict=True))
    assert types["trial"] == types["seed"] == types["attempts"] == pa.int64()
    assert types["success"] == types["claimed"] == pa.bool_()
    assert types["failure"] == types["message"] == types["worker"] == pa.string()
    assert types["cycle_time_s"] == types["memory_mb"] == pa.float64()
    assert types["placement_error_m"] == pa.list_(pa.float64())
    assert not {"scenario", "artifacts", "schema_version"} & types.keys()


def test_rows_are_in_order_and_null_where_a_trial_has_no_value(folder):
    write_row(row_path(folder, 2), make_row(2, **{MASS: 1, "a.b": "red"}))
    write_row(row_path(folder, 0), make_row(0, **{MASS: 0.5}, success=True))
    write_row(row_path(folder, 1), make_row(1, cycle_time_s=float("nan")))
    rows = read_rows(folder)
    assert rows["trial"].to_pylist() == [0, 1, 2]
    assert rows["seed"].to_pylist() == [7, 8, 9]
    assert rows["success"].to_pylist() == [True, False, False]
    assert rows["cycle_time_s"].to_pylist() == [None] * 3
    assert sampled_columns(rows) == ["a.b", MASS]
    assert rows[MASS].to_pylist() == [0.5, None, 1.0]
    assert rows["a.b"].to_pylist() == [None, None, "red"]


def test_infinite_numbers_are_null_in_vectors_too(folder):
    error = [1.0, float("inf"), 0.0]
    write_row(row_path(folder, 0), make_row(0, placement_error_m=error))
    assert read_rows(folder)["placement_error_m"].to_pylist() == [[1.0, None, 0.0]]


@pytest.mark.slow
@given(st.lists(st.lists(st.integers(0, 20), unique=True), max_size=5))
def test_each_trial_appears_once_in_order(files):
    tables = [pa.table({"trial": pa.array(t, pa.int64())}) for t in files]
    rows = unique_rows(tables)
    assert rows["trial"].to_pylist() == sorted({t for trials in files for t in trials})


def test_single_rows_and_the_file_of_all_rows_are_read_together(folder):
    for trial in range(3):
        write_row(row_path(folder, trial), make_row(trial))
    write_rows(all_rows_path(folder), read_rows(folder))
    row_path(folder, 0).unlink()
    write_row(row_path(folder, 3), make_row(3))
    assert read_rows(folder)["trial"].to_pylist() == [0, 1, 2, 3]


@pytest.mark.parametrize("read", range(4))
def test_rows_are_read_while_the_sweep_moves_them_into_one_file(
    folder, monkeypatch, read
):
    for trial in range(3):
        write_row(row_path(folder, trial), make_row(trial))
    rows = read_rows(folder)
    read_file, count = rows_module.read_file, 0

    def finishing(path, info):
        nonlocal count
        if count == read:
            write_rows(all_rows_path(folder), rows)
            for trial in range(3):
                row_path(folder, trial).unlink()
        count += 1
        return read_file(path, info)

    monkeypatch.setattr(rows_module, "read_file", finishing)
    assert read_rows(folder).equals(rows)


def test_a_dangling_link_is_named(folder):
    path = row_path(folder, 0)
    path.parent.mkdir()
    path.symlink_to("nothing")
    with pytest.raises(ScenarioError, match=f"{path}: cannot be read: No such file"):
        read_rows(folder)


def test_a_broken_file_of_all_rows_comes_with_advice(folder):
    all_rows_path(folder).write_bytes(b"PAR1")
    with pytest.raises(BrokenRowsError, match=r"trials.parquet: .*; .*move it away"):
        read_rows(folder)


@pytest.mark.parametrize("keep", [0, 10, 200, -10])
def test_a_truncated_file_is_named(folder, keep):
    path = row_path(folder, 0)
    write_row(path, make_row(0))
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(BrokenRowsError) as caught:
        read_rows(folder)
    message = str(caught.value)
    assert str(path) in message
    assert "--resume" in message
    assert "\n" not in message


@pytest.mark.slow
@pytest.mark.parametrize("write", ["row", "rows"])
def test_a_flipped_bit_is_an_error_or_changes_nothing(folder, write):
    path = row_path(folder, 0)
    row = make_row(0, **{MASS: 0.25}, placement_error_m=[0.1, 0.2, 0.3])
    write_row(path, row)
    if write == "rows":
        path, all_rows = all_rows_path(folder), read_rows(folder)
        write_rows(path, all_rows)
    whole, rows = path.read_bytes(), read_file(path, INFO)
    unseen = []
    for place in range(0, len(whole), 29):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << place % 8
        path.write_bytes(flipped)
        try:
            if not read_file(path, INFO).equals(rows):
                unseen.append(place)
        except BrokenRowsError as error:
            assert "\n" not in str(error)
    assert unseen == []


@pytest.mark.parametrize("name", ["000000 (copy)", "0", "000000.1", "1e6", "٠٠٠٠٠٠"])
def test_files_with_other_names_are_ignored(folder, name):
    write_row(row_path(folder, 0), make_row(0))
    write_row(row_path(folder, 0).with_name(f"{name}.parquet"), make_row(1))
    assert read_rows(folder)["trial"].to_pylist() == [0]


def test_rows_of_another_trial_or_sweep_are_rejected(folder):
    path = row_path(folder, 0)
    for row, words in (
        (make_row(1), r"contains trials \[1\]"),
        (make_row(0, seed=3), "seeds"),
    ):
        write_row(path, row)
        with pytest.raises(BrokenRowsError, match=words):
            read_file(path, INFO)
    pq.write_table(pa.table({"x": [1]}), path)
    with pytest.raises(BrokenRowsError, match="trial"):
        read_file(path, INFO)


def test_a_folder_without_a_sweep_says_so(tmp_path):
    with pytest.raises(
        ScenarioError, match=r"contains no sweep \(sweep.json is missing"
    ):
        read_rows(tmp_path)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"schema_version": 1}', "\0"])
def test_a_broken_sweep_file_is_named(folder, text):
    (folder / "sweep.json").write_text(text)
    with pytest.raises(ScenarioError, match=r"sweep.json: invalid content: ."):
        read_rows(folder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"trials": "ten"}, "invalid content: trials: must be .*, got"),
        ({"seed": None}, "invalid content: seed: must be .*, got"),
        ({"jobs": "2"}, "invalid content: jobs: must be .*, got"),
        ({"tree": {}}, "invalid content: tree: must be .*, got"),
        ({"schema_version": 2}, r"schema_version: got 2 \(allowed: 1\)"),
    ],
)
def test_a_sweep_file_with_a_wrong_value_names_it(folder, change, message):
    path = folder / "sweep.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(ScenarioError, match=message):
        read_rows(folder)


def test_the_columns_that_differ_between_runs_are_named_on_their_page():
    page = PAGE.read_text()
    assert [name for name in TIMING_COLUMNS if f"`{name}`" not in page] == []
