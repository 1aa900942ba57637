import os
import signal
import threading
import time

import pytest

from reproduce import runs
from reproduce.runs import in_process, remaining, run_all, run_quietly
from tools.reproduce.made_rows import rows, work_for_hours, write_result, write_stamped


@pytest.fixture
def ran(monkeypatch):
    """The names that were run; those that begin with `bad` have no result."""
    names = []

    def run(function, name, out):
        names.append(name)
        if name.startswith("bad"):
            return f"{name}: needs a roscore"
        write_result(out, rows())
        return ""

    monkeypatch.setattr(runs, "in_process", run)
    return names


def run_names(names, out, lines=None):
    say = (lines if lines is not None else []).append
    return {run.name: run for run in run_all(names, out, {}, say)}


def test_a_failure_does_not_end_the_others(ran, tmp_path):
    done = run_names(["a", "bad", "b"], tmp_path)
    assert ran == ["a", "bad", "b"]
    assert {name for name in done if done[name].stamp} == {"a", "b"}
    assert done["bad"].error == "bad: needs a roscore"


def test_finished_experiments_are_not_run_again(ran, tmp_path):
    stamp = write_stamped(tmp_path / "a", rows(), seconds=77.0)
    lines = []
    done = run_names(["a", "b"], tmp_path, lines)
    assert ran == ["b"]
    assert done["a"].stamp == stamp
    assert lines[0] == "made by this code before: a"
    assert lines[1].startswith("[1/1] b")
    assert run_names(["a", "b"], tmp_path).keys() == {"a", "b"}
    assert ran == ["b"]


def test_a_failed_run_is_tried_again(ran, tmp_path):
    run_names(["bad"], tmp_path)
    run_names(["bad"], tmp_path)
    assert ran == ["bad", "bad"]


def test_each_result_is_there_before_the_next_starts(ran, tmp_path):
    done = run_all(["a", "b"], tmp_path, {}, print)
    assert next(done).name == "a"
    assert ran == ["a"]
    assert (tmp_path / "a/stamp.json").is_file()


@pytest.mark.parametrize(
    ("durations", "text"),
    [
        ({"a": 20.0, "b": 30.0, "c": 600.0}, "about 50 s to go"),
        ({"a": 200.0}, "about 3 min and 1 of unknown duration to go"),
        ({}, "2 of unknown duration to go"),
    ],
)
def test_what_is_left_is_told(durations, text):
    assert remaining(["a", "b"], durations) == text


@pytest.mark.slow
def test_an_unknown_experiment_is_an_error_of_one_line(tmp_path):
    error = in_process(run_quietly, "fake", tmp_path / "fake")
    assert error.startswith("unknown experiment 'fake'")
    assert len(error.splitlines()) == 1


@pytest.mark.slow
def test_the_end_of_a_process_is_survived():
    assert "ended" in in_process(os._exit, 3)


@pytest.mark.slow
def test_an_interrupt_ends_the_experiment_s_process(tmp_path):
    file = tmp_path / "pid"
    # A shell's background jobs ignore interrupts, and so do these tests in one.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def interrupt():
        while not file.exists():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            in_process(work_for_hours, file)
    finally:
        signal.signal(signal.SIGINT, before)
    with pytest.raises(ProcessLookupError):
        os.kill(int(file.read_text()), 0)


def test_an_exception_has_its_type(tmp_path, monkeypatch, capsys):
    def broken(*_, **__):
        raise ZeroDivisionError("first line\nsecond")

    monkeypatch.setattr(runs, "run_experiment", broken)
    monkeypatch.setattr(runs, "end_on_sigterm", lambda: None)
    assert run_quietly("fake", tmp_path) == "ZeroDivisionError: first line second"
    assert "Traceback" in capsys.readouterr().err
