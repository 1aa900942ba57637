"""`make experiments`, with experiments that take no time."""

import hashlib

import pytest
from made import rows, write_result

from drake_srg.common.exceptions import ScenarioError
from experiments.runner import rerun
from experiments.runner.committed import (
    accept,
    committed_rows,
    current_stamp,
    read_stamps,
)
from experiments.runner.rerun import choose, main, run_apart, shortest

NAMES = ("carrying", "payload_wrap", "soft")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder of docs and of results, and experiments of our own."""
    docs = tmp_path / "docs"
    docs.mkdir()
    monkeypatch.setattr(rerun, "OUT", tmp_path / "out")
    monkeypatch.setattr(rerun, "find_experiments", lambda: dict.fromkeys(NAMES))
    monkeypatch.setattr(rerun, "end_on_signals", lambda: None)
    monkeypatch.setattr(rerun, "read_stamps", lambda: read_stamps(docs))
    monkeypatch.setattr(rerun, "committed_rows", lambda n: committed_rows(n, docs))
    monkeypatch.setattr(rerun, "accept", lambda made, out: accept(made, out, docs))
    return tmp_path


@pytest.fixture
def measure(folder, monkeypatch):
    """Return a function that sets what experiments measure from now on.

    Results that were made before do not count any more, as after a change of code.
    """

    def set_values(values, wall=2.0):
        def run(name, out):
            if isinstance(values.get(name), str):
                return values[name]
            write_result(out, rows(values.get(name, 1.0), wall))
            return ""

        monkeypatch.setattr(rerun, "run_apart", run)
        for stamp in folder.glob("out/*/stamp.json"):
            stamp.unlink()

    set_values({})
    return set_values


def snapshot(folder):
    return {
        path: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in (folder / "docs").rglob("*")
    }


def test_rows_are_made_accepted_and_made_again(folder, measure, capsys):
    assert main([]) == 1
    assert "no committed result yet" in capsys.readouterr().out
    assert snapshot(folder) == {}
    assert main(["--accept"]) == 0
    assert len(snapshot(folder)) == 1 + 2 * len(NAMES)
    measure({})
    assert main([]) == 0


@pytest.mark.parametrize(
    ("value", "word"), [(1.31, "moved"), (3.1, "failed"), ("no roscore", "NOT RUN")]
)
def test_whatever_is_wrong_is_told_and_changes_no_file(
    folder, measure, value, word, capsys
):
    main(["--accept"])
    before = snapshot(folder)
    capsys.readouterr()
    measure({"soft": value})
    assert main([]) == 1
    printed = capsys.readouterr().out
    assert [line for line in printed.splitlines() if "soft" in line and word in line]
    assert snapshot(folder) == before


def test_a_moved_row_can_be_accepted(folder, measure):
    main(["--accept"])
    measure({"soft": 1.5})
    assert main(["--accept"]) == 0
    assert main([]) == 0
    assert committed_rows("soft", folder / "docs")[0].measured == 1.5


def test_accepting_keeps_the_rows_of_what_did_not_run(folder, measure):
    main(["--accept"])
    before = snapshot(folder)
    measure({"soft": "no roscore"})
    assert main(["--accept", "--only", "soft"]) == 1
    assert snapshot(folder) == before


def test_some_can_be_chosen_or_left_out(folder, measure, capsys):
    measure({"soft": "no roscore"})
    assert main(["--accept", "--except", "soft"]) == 0
    assert "2 of 2 experiments ran" in capsys.readouterr().out
    assert main(["--only", "carrying"]) == 0
    assert "1 of 1 experiments ran" in capsys.readouterr().out
    assert choose(NAMES, ["soft", "carrying"], ["carrying"]) == ["soft"]


def test_an_unknown_name_is_bad_input(folder, measure, capsys):
    for option in ("--only", "--except"):
        assert main([option, "sotf"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "did you mean 'soft'?" in line
    with pytest.raises(ScenarioError, match="--except: unknown 'nothing'"):
        choose(NAMES, [], ["nothing"])


def test_a_broken_committed_file_is_bad_input_before_anything_runs(
    folder, measure, capsys
):
    main(["--accept"])
    measure({})
    (folder / "docs/soft.json").write_text("[")
    capsys.readouterr()
    assert main([]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "soft.json: invalid content" in line


def test_an_interrupt_keeps_what_was_made(folder, measure, monkeypatch):
    run = rerun.run_apart

    def interrupted(name, out):
        if name == "soft":
            raise KeyboardInterrupt
        return run(name, out)

    monkeypatch.setattr(rerun, "run_apart", interrupted)
    assert main([]) == 130
    made = [name for name in NAMES if current_stamp(folder / "out" / name)]
    assert made == ["carrying", "payload_wrap"]


def test_other_versions_of_drake_are_told(folder, measure, monkeypatch, capsys):
    main(["--accept"])
    measure({})
    capsys.readouterr()
    monkeypatch.setattr(rerun, "drake_version", lambda: "9.9.9")
    assert main([]) == 0
    assert "Drake 9.9.9; rows are of Drake " in capsys.readouterr().err


def test_the_quick_ones_are_the_shortest(folder, measure, capsys):
    durations = {"a": 30.0, "b": 5.0, "c": 26.0, "d": 24.0}
    assert shortest("abcde", durations, 60.0) == ["b", "c", "d"]
    assert shortest("ae", durations, 60.0) == ["a"]
    assert shortest("e", durations, 60.0) == []
    assert main(["--quick"]) == 2
    assert "no experiment to run" in capsys.readouterr().err
    main(["--accept"])
    assert main(["--quick"]) == 0


def test_the_quick_ones_hold_on_a_busy_machine(folder, measure, capsys):
    main(["--accept"])
    measure({"soft": 1.5}, wall=-1.0)  # so wrong that no correction helps
    assert main(["--quick"]) == 1
    table = capsys.readouterr().out
    assert "slip" in table
    assert "duration" not in table
    assert main([]) == 1
    assert "duration" in capsys.readouterr().out


@pytest.mark.slow
def test_an_experiment_that_cannot_run_says_why(tmp_path):
    assert "unknown experiment 'sotf'" in run_apart("sotf", tmp_path)
