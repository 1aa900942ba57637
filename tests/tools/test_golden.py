"""The comparison of golden runs with the committed ones."""

import json

import pytest

from golden.__main__ import FOLDER, accept, compare
from golden.cases import QUICK, Golden, all_cases

OUTCOME = {"success": True, "failure": None, "attempts": 1}
HASHES = {"time": "1", "mode": "2"}
HERE = "a processor"
COMMITTED = {
    "processor": HERE,
    "results": {"run kitchen 0": {"outcome": OUTCOME, "hashes": HASHES}},
}


def result(outcome=OUTCOME, **hashes):
    return {"run kitchen 0": Golden(dict(outcome), HASHES | hashes)}


def test_the_same_results_differ_in_nothing():
    assert compare(result(), COMMITTED, HERE) == []


@pytest.mark.parametrize("changed", [{"mode": "3"}, {"state": "4"}])
def test_arrays_that_changed_are_named(changed):
    (line,) = compare(result(**changed), COMMITTED, HERE)
    assert line == f"run kitchen 0: other bytes: {', '.join(changed)}"


def test_a_missing_array_is_named():
    golden = Golden(OUTCOME, {"time": "1"})
    (line,) = compare({"run kitchen 0": golden}, COMMITTED, HERE)
    assert line == "run kitchen 0: other bytes: mode"


def test_another_processor_may_round_otherwise():
    assert compare(result(mode="3"), COMMITTED, "another") == []


@pytest.mark.parametrize("processor", [HERE, "another", ""])
def test_another_outcome_counts_on_every_processor(processor):
    results = result(OUTCOME | {"success": False})
    (line,) = compare(results, COMMITTED, processor)
    assert line.startswith("run kitchen 0: {'success': False")


def test_a_case_without_a_committed_result_is_named():
    (line,) = compare({"new": Golden({}, {})}, COMMITTED, HERE)
    assert line == "new: not among the committed results"


def test_a_case_may_be_accepted_on_another_processor():
    new = {"run bench 0": Golden(OUTCOME, {"time": "5"})}
    mixed = accept(new, COMMITTED, "another")
    assert compare(result() | new, mixed, HERE) == []
    assert compare(result(), mixed, "another") == []
    changed = {"run bench 0": Golden(OUTCOME, {"time": "6"})}
    assert compare(changed, mixed, HERE) == []
    assert len(compare(changed, mixed, "another")) == 1


def test_all_cases_of_one_processor_take_its_name():
    assert accept(result(mode="3"), COMMITTED, "another")["processor"] == "another"


def test_every_case_has_committed_results():
    names = {case.name for case in all_cases()}
    oldest, newest = (
        json.loads(file.read_text("utf-8"))["results"].keys()
        for file in sorted(FOLDER.glob("drake-*.json"))
    )
    assert oldest == names
    assert newest >= QUICK
