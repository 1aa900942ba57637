"""`make experiments`, with experiments that take no time."""

import hashlib

import pytest

from drake_srg.common.exceptions import ScenarioError
from reproduce import __main__ as command
from reproduce import runs
from reproduce.__main__ import choose, main, shortest
from tools.reproduce.made_rows import rows, write_result

NAMES = ("carrying", "payload_wrap", "soft")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder of docs and of results, and experiments of our own."""
    monkeypatch.setattr(command, "DOCS", tmp_path / "docs")
    monkeypatch.setattr(command, "OUT", tmp_path / "out")
    monkeypatch.setattr(command, "list_experiments", lambda: dict.fromkeys(NAMES, "A."))
    monkeypatch.setattr(command, "list_measurements", dict)
    monkeypatch.setattr(command, "end_on_sigterm", lambda: None)
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs/experiments.md").write_text("# Page\n")
    return tmp_path


@pytest.fixture
def measure(folder, monkeypatch):
    """Return a function that sets what experiments measure from now on.

    Results that were made before do not count any more, as after a change of code.
    """

    def set_values(values):
        def run(function, name, out):
            if isinstance(values.get(name), str):
                return values[name]
            write_result(out, rows(values.get(name, 1.0)))
            return ""

        monkeypatch.setattr(runs, "in_process", run)
        for stamp in folder.glob("out/*/stamp.json"):
            stamp.unlink()

    set_values({})
    return set_values


def snapshot(folder):
    return {
        path: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in (folder / "docs").rglob("*")
        if path.is_file()
    }


def test_figures_are_made_accepted_and_made_again(folder, measure, capsys):
    before = snapshot(folder)
    assert main([]) == 1
    assert "no committed result yet" in capsys.readouterr().out
    assert snapshot(folder) == before
    assert main(["--accept"]) == 0
    assert "made by this code before" in capsys.readouterr().err
    assert len(snapshot(folder)) == 2 + 2 * len(NAMES)
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


def test_a_moved_figure_can_be_accepted(folder, measure):
    main(["--accept"])
    measure({"soft": 1.5})
    assert main(["--accept"]) == 0
    assert main([]) == 0
    assert "| can | slip | 1.5 |" in (folder / "docs/experiments.md").read_text()


def test_accepting_keeps_the_figures_of_what_did_not_run(folder, measure):
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


def test_a_broken_committed_file_is_bad_input_before_anything_runs(
    folder, measure, capsys
):
    main(["--accept"])
    measure({})
    (folder / "docs/experiments/soft.json").write_text("[")
    capsys.readouterr()
    assert main([]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "soft.json: invalid content" in line


def test_an_interrupt_keeps_what_was_made(folder, measure, monkeypatch, capsys):
    run = runs.in_process

    def interrupted(function, name, out):
        if name == "soft":
            raise KeyboardInterrupt
        return run(function, name, out)

    monkeypatch.setattr(runs, "in_process", interrupted)
    assert main([]) == 130
    monkeypatch.setattr(runs, "in_process", run)
    capsys.readouterr()
    main([])
    first = capsys.readouterr().err.splitlines()[0]
    assert first == "made by this code before: carrying, payload_wrap"


def test_other_versions_of_drake_are_told(folder, measure, monkeypatch, capsys):
    main(["--accept"])
    measure({})
    capsys.readouterr()
    monkeypatch.setattr(command, "drake_version", lambda: "9.9.9")
    assert main([]) == 0
    assert "Drake 9.9.9; figures are of Drake " in capsys.readouterr().err


def test_the_quick_ones_are_the_shortest(folder, measure):
    durations = {"a": 30.0, "b": 5.0, "c": 26.0, "d": 24.0}
    assert shortest("abcde", durations, 60.0) == ["b", "c", "d"]
    assert shortest("ae", durations, 60.0) == ["a"]
    assert shortest("e", durations, 60.0) == []


def test_without_committed_figures_none_is_quick(folder, measure, capsys):
    assert main(["--quick"]) == 2
    assert "no experiment to run" in capsys.readouterr().err
    main(["--accept"])
    assert main(["--quick"]) == 0


def test_choosing_rejects_unknown_names():
    with pytest.raises(ScenarioError, match="unknown experiment"):
        choose(NAMES, [], ["nothing"])
