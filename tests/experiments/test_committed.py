"""The committed results, and how new ones take their place."""

import json
import re
from pathlib import Path

import pytest
from made import rows, write_result, write_stamped
from PIL import Image

from drake_srg.common.exceptions import ScenarioError
from experiments import find_experiments
from experiments.runner import committed
from experiments.runner.claims import Trials
from experiments.runner.committed import (
    COMMITTED,
    LARGEST,
    accept,
    committed_rows,
    current_stamp,
    read_rows,
    read_stamps,
)
from experiments.runner.run import find_experiment

BEFORE = json.loads((Path(__file__).parent / "rows_before.json").read_text())


@pytest.mark.parametrize("name", sorted(BEFORE))
def test_no_row_is_lost(name):
    """Every row of today, by name and bound, was there before: none went."""
    found = [
        (row.name, f"{row.quantity} [{row.unit}] {row.expected}")
        for row in committed_rows(name) or ()
    ]
    kept = [(n, what) for names, whats in BEFORE[name] for what in whats for n in names]
    assert sorted(set(kept) - set(found)) == []
    assert name in find_experiments()


@pytest.mark.parametrize("name", sorted(find_experiments()))
def test_every_experiment_has_rows_and_a_small_picture(name):
    assert committed_rows(name), f"{name}: no committed result yet: make experiments"
    assert (COMMITTED / f"{name}.png").stat().st_size < LARGEST
    assert name in read_stamps()


@pytest.mark.parametrize("name", sorted(find_experiments()))
def test_trials_that_have_a_name_are_judged_by_it(name):
    """Cases may list other axes first: rows must not get their values as names."""
    experiment = find_experiment(name)
    cases = Trials(list(experiment.cases(**experiment.values(name, ()))))
    if "name" in cases[0]:
        names = {row.name for row in committed_rows(name) or ()}
        assert names & set(cases.groups(*experiment.axes(cases)))


def test_accepted_results_are_the_committed_ones(tmp_path):
    folder = tmp_path / "docs"
    made = {
        name: write_stamped(tmp_path / "out" / name, rows(value))
        for name, value in (("one", 1.0), ("two", 2.0))
    }
    accept({"one": made["one"]}, tmp_path / "out", folder)
    assert committed_rows("one", folder) == rows(1.0)
    assert committed_rows("two", folder) is None
    assert read_stamps(folder) == {"one": made["one"]}
    accept({"two": made["two"]}, tmp_path / "out", folder)
    assert read_stamps(folder) == made
    with Image.open(folder / "two.png") as picture:
        assert picture.size == (20, 10)


@pytest.mark.parametrize("content", ["[", "[1]", '[{"name": "can"}]', "3"])
def test_a_broken_result_is_named(content, tmp_path):
    path = tmp_path / "one.json"
    path.write_text(content)
    with pytest.raises(ScenarioError, match=re.escape(f"{path}: invalid content")):
        read_rows(path)


@pytest.mark.parametrize("content", ["[", "[1]", '{"one": {}}'])
def test_broken_stamps_are_named(content, tmp_path):
    path = tmp_path / "stamps.json"
    path.write_text(content)
    with pytest.raises(ScenarioError, match=re.escape(f"{path}: invalid content")):
        read_stamps(tmp_path)


def test_a_result_of_the_same_code_is_current(tmp_path):
    folder = tmp_path / "fake"
    assert current_stamp(folder) is None
    stamp = write_stamped(folder, rows())
    assert current_stamp(folder) == stamp


@pytest.mark.parametrize(
    "change", [("code_of", lambda name: "other"), ("drake_version", lambda: "other")]
)
def test_a_result_of_other_code_is_not(tmp_path, change, monkeypatch):
    write_stamped(tmp_path / "fake", rows())
    monkeypatch.setattr(committed, *change)
    assert current_stamp(tmp_path / "fake") is None


def test_a_result_of_other_parameters_is_not(tmp_path):
    write_stamped(tmp_path / "fake", rows())
    write_result(tmp_path / "fake", rows(2.0))  # without a stamp: `--set`
    assert current_stamp(tmp_path / "fake") is None


@pytest.mark.parametrize("file", ["result.json", "stamp.json", "fake.png"])
def test_an_incomplete_result_is_not(tmp_path, file):
    write_stamped(tmp_path / "fake", rows())
    (tmp_path / "fake" / file).unlink()
    assert current_stamp(tmp_path / "fake") is None


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"seconds": 1}'])
def test_a_stamp_that_was_cut_off_does_not_count(tmp_path, content):
    write_stamped(tmp_path / "fake", rows())
    (tmp_path / "fake/stamp.json").write_text(content)
    assert current_stamp(tmp_path / "fake") is None
