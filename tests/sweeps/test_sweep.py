import errno
import functools
import json
import os
import re
import tempfile
from pathlib import Path

import pytest
from common.test_status_line import Terminal
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.status_line import StatusLine
from drake_srg.sweeps import sweep
from drake_srg.sweeps.rows import all_rows_path, read_rows
from drake_srg.sweeps.sweep import SweepFolder

from . import stub
from .stub import run

pytestmark = pytest.mark.usefixtures("unchecked")


def values(rows):
    """The rows without the column that differs between runs."""
    return rows.drop_columns(["worker"]).to_pylist()


@pytest.mark.slow
@settings(max_examples=12)
@given(
    single=st.sets(st.integers(0, 5)),
    whole=st.none() | st.integers(1, 6),
    more=st.integers(0, 2),
)
def test_resuming_runs_each_missing_trial_exactly_once(single, whole, more):
    with tempfile.TemporaryDirectory() as folder:
        out, full = Path(folder) / "out", Path(folder) / "full"
        wanted = values(run(full, trials=6 + more))
        present = set(single)
        if whole is not None:  # a sweep of so many trials, extended since then
            run(out, trials=whole)
            present |= set(range(whole))
        else:
            run(out)
            all_rows_path(out).unlink()
        for trial in single:
            (out / "trials").mkdir(exist_ok=True)
            result = stub.trial({}, "", 0, trial, "none")
            SweepFolder(out).add(result)
        engine = stub.StubEngine()
        assert values(run(out, engine, trials=6 + more, resume=True)) == wanted
        assert sorted(engine.given) == sorted(set(range(6 + more)) - present)
        assert not (out / "trials").exists()


@pytest.mark.parametrize("after", range(4))
def test_an_interrupted_sweep_continues(after, tmp_path, monkeypatch):
    count = 0
    add = SweepFolder.add

    def interrupted(self, result):
        nonlocal count
        if count == after:
            raise KeyboardInterrupt
        count += 1
        add(self, result)

    with monkeypatch.context() as patch:
        patch.setattr(SweepFolder, "add", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(tmp_path, record="failures")
    assert read_rows(tmp_path).num_rows == after
    rows = run(tmp_path, record="failures", resume=True)
    assert rows["trial"].to_pylist() == list(range(6))


@pytest.mark.parametrize("after", range(0, 12, 3))
def test_a_full_disk_loses_no_finished_trial(after, tmp_path, monkeypatch):
    fsync, count = os.fsync, 0

    def filling(descriptor):
        nonlocal count
        count += 1
        if count > 2 + after:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", filling)
    with pytest.raises(OSError, match="No space left"):
        run(tmp_path)
    monkeypatch.undo()
    monkeypatch.setattr(sweep, "check_scenario", stub.unchecked)
    done = read_rows(tmp_path)["trial"].to_pylist()
    engine = stub.StubEngine()
    rows = run(tmp_path, engine, resume=True)
    assert rows["trial"].to_pylist() == list(range(6))
    assert sorted(engine.given + done) == list(range(6))


def test_resuming_a_finished_sweep_needs_no_engine(tmp_path):
    class Unused(stub.StubEngine):
        def __enter__(self):
            raise AssertionError

    rows = run(tmp_path)
    assert run(tmp_path, Unused(), resume=True).equals(rows)


def test_warnings_of_trials_are_reported(tmp_path):
    def odd(*arguments):
        result = stub.trial(*arguments)
        return type(result)(result.row, result.files, "odd")

    told = []
    run(tmp_path, told=told, trials=1, trial_function=odd)
    assert told == ["odd"]


def test_progress_shows_success_and_the_time_left(tmp_path, monkeypatch, capsys):
    now, add = 0.0, SweepFolder.add

    def a_minute_each(self, result):
        nonlocal now
        now += 60
        add(self, result)

    monkeypatch.setattr(SweepFolder, "add", a_minute_each)
    # One after the other: if two have ended, either may come first.
    monkeypatch.setattr(stub.StubEngine, "slots", lambda _: 1)
    stream = Terminal()
    monkeypatch.setattr("sys.stderr", stream)
    line = functools.partial(StatusLine, clock=lambda: now)
    monkeypatch.setattr(sweep, "StatusLine", line)

    def shown(sweep):
        stream.seek(0)
        stream.truncate()
        run(tmp_path, trials=sweep, progress=True, resume=True)
        return re.findall(r"\r(.*?)\x1b", stream.getvalue())

    # In `stub.trial`, trials 1 and 4 fail.
    assert shown(3) == [
        "1/3 trials, 100.0% succeeded [1:00 elapsed, 2:00 left]",
        "2/3 trials, 50.0% succeeded [2:00 elapsed, 1:00 left]",
        "3/3 trials, 66.7% succeeded [3:00 elapsed]",
    ]
    # The time left is extrapolated from the trials of this run only.
    assert shown(5) == [
        "4/5 trials, 75.0% succeeded [1:00 elapsed, 1:00 left]",
        "5/5 trials, 60.0% succeeded [2:00 elapsed]",
    ]


def test_a_sweep_ends_with_all_rows_in_one_file(tmp_path):
    rows = run(tmp_path, seed=5)
    assert rows["trial"].to_pylist() == list(range(6))
    assert rows["seed"].to_pylist() == list(range(5, 11))
    assert read_rows(tmp_path).equals(rows)
    assert stub.names(tmp_path) == ["lock", "sweep.json", "trials.parquet"]


def test_the_sweep_file_identifies_the_sweep(tmp_path):
    run(tmp_path, seed=5, overrides=["object.mass=0.3"])
    info = json.loads((tmp_path / "sweep.json").read_text())
    assert info["scenario"] == stub.SCENARIO
    assert (info["seed"], info["trials"], info["record"]) == (5, 6, "none")
    assert info["overrides"] == ["object.mass=0.3"]
    assert "mass: 0.3" in info["tree"]
    assert {"drake_srg", "drake", "python", "platform"} <= info["versions"].keys()
    assert (info["engine"], info["jobs"]) == ("stub", 2)
    assert info["schema_version"] == 1
    run(tmp_path, seed=5, overrides=["object.mass=0.3"], trials=7, resume=True)
    extended = json.loads((tmp_path / "sweep.json").read_text())
    assert extended == {**info, "trials": 7}


def test_recordings_are_kept_for_the_requested_trials(tmp_path):
    for record, kept in (("failures", {1, 4}), ("all", set(range(6)))):
        run(tmp_path / record, record=record)
        recordings = tmp_path / record / "recordings"
        assert {int(path.name) for path in recordings.iterdir()} == kept
        for trial in kept:
            assert (recordings / f"{trial:06}/video.mp4").read_text() == str(trial)


@pytest.mark.parametrize("trials", [0, -1])
def test_a_sweep_needs_trials(trials, tmp_path):
    with pytest.raises(ScenarioError, match=f"--trials {trials}: must be at least 1"):
        run(tmp_path / "out", trials=trials)
    assert not (tmp_path / "out").exists()


def test_nothing_is_printed_by_default(tmp_path, capsys):
    run(tmp_path)
    assert capsys.readouterr().err == ""


def test_a_folder_cannot_be_made_inside_a_file(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        run(tmp_path / "file" / "out")
