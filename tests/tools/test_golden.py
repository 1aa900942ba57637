"""The comparison of golden runs with the committed ones."""

import json

import pytest

from golden.__main__ import FOLDER, compare
from golden.cases import QUICK, Golden, all_cases

OUTCOME = {"success": True, "failure": None, "attempts": 1}
HASHES = {"time": "1", "mode": "2"}
COMMITTED = {"run kitchen 0": {"outcome": OUTCOME, "hashes": HASHES}}


def result(outcome=OUTCOME, **hashes):
    return {"run kitchen 0": Golden(dict(outcome), HASHES | hashes)}


def test_the_same_results_differ_in_nothing():
    assert compare(result(), COMMITTED, same_processor=True) == []


@pytest.mark.parametrize("changed", [{"mode": "3"}, {"state": "4"}])
def test_arrays_that_changed_are_named(changed):
    (line,) = compare(result(**changed), COMMITTED, same_processor=True)
    assert line == f"run kitchen 0: other bytes: {', '.join(changed)}"


def test_a_missing_array_is_named():
    golden = Golden(OUTCOME, {"time": "1"})
    (line,) = compare({"run kitchen 0": golden}, COMMITTED, same_processor=True)
    assert line == "run kitchen 0: other bytes: mode"


def test_another_processor_may_round_otherwise():
    assert compare(result(mode="3"), COMMITTED, same_processor=False) == []


@pytest.mark.parametrize("same_processor", [True, False])
def test_another_outcome_counts_on_every_processor(same_processor):
    results = result(OUTCOME | {"success": False})
    (line,) = compare(results, COMMITTED, same_processor)
    assert line.startswith("run kitchen 0: {'success': False")


def test_a_case_without_a_committed_result_is_named():
    (line,) = compare({"new": Golden({}, {})}, COMMITTED, same_processor=True)
    assert line == "new: not among the committed results"


def test_every_case_has_committed_results():
    names = {case.name for case in all_cases()}
    oldest, newest = (
        json.loads(file.read_text("utf-8"))["results"].keys()
        for file in sorted(FOLDER.glob("drake-*.json"))
    )
    assert oldest == names
    assert newest >= QUICK
