import errno
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
import tqdm.std
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps import sweep
from drake_srg.sweeps.rows import all_rows_path, read_rows, row_path

from . import stub

SWEEP = {"scenario": stub.SCENARIO, "trials": 6, "trial_function": stub.trial}


@pytest.fixture(autouse=True)
def unchecked(monkeypatch):
    """Skip building the cell, which takes a second; tests of the command do it."""
    monkeypatch.setattr(sweep, "check_scenario", stub.unchecked)


def run(out, engine=None, told=None, **changes):
    return sweep.run_sweep(
        out=out,
        engine=engine or stub.StubEngine(),
        tell=(told if told is not None else []).append,
        **{**SWEEP, **changes},
    )


def values(rows):
    """The rows without the column that differs between runs."""
    return rows.drop_columns(["worker"]).to_pylist()


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
            sweep.SweepFolder(out).add(result)
        engine = stub.StubEngine()
        assert values(run(out, engine, trials=6 + more, resume=True)) == wanted
        assert sorted(engine.given) == sorted(set(range(6 + more)) - present)
        assert not (out / "trials").exists()


@pytest.mark.parametrize("after", range(4))
def test_an_interrupted_sweep_continues(after, tmp_path, monkeypatch):
    count = 0
    add = sweep.SweepFolder.add

    def interrupted(self, result):
        nonlocal count
        if count == after:
            raise KeyboardInterrupt
        count += 1
        add(self, result)

    with monkeypatch.context() as patch:
        patch.setattr(sweep.SweepFolder, "add", interrupted)
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


def test_recordings_are_kept_for_the_requested_trials(tmp_path):
    for record, kept in (("failures", {1, 4}), ("all", set(range(6)))):
        run(tmp_path / record, record=record)
        recordings = tmp_path / record / "recordings"
        assert {int(path.name) for path in recordings.iterdir()} == kept
        for trial in kept:
            assert (recordings / f"{trial:06}/video.mp4").read_text() == str(trial)


def test_a_recording_without_its_row_is_replaced(tmp_path):
    run(tmp_path, record="failures", trials=2)
    all_rows_path(tmp_path).unlink()
    video = tmp_path / "recordings/000001/video.mp4"
    video.write_text("cut off")
    (tmp_path / "recordings/.000000.partial").mkdir()
    sweep.SweepFolder(tmp_path).add(stub.trial({}, "", 0, 0, "none"))
    run(tmp_path, record="failures", trials=2, resume=True)
    assert video.read_text() == "1"
    assert stub.names(tmp_path / "recordings") == ["000001"]


def test_a_broken_row_is_reported_and_its_trial_runs_again(tmp_path):
    run(tmp_path)
    all_rows_path(tmp_path).unlink()
    for trial in range(6):
        sweep.SweepFolder(tmp_path).add(stub.trial({}, "", 0, trial, "none"))
    row_path(tmp_path, 3).write_bytes(b"PAR1")
    engine, told = stub.StubEngine(), []
    rows = run(tmp_path, engine, told, resume=True)
    assert engine.given == [3]
    assert rows["trial"].to_pylist() == list(range(6))
    (line,) = told
    assert "000003.parquet: cannot be read" in line
    assert row_path(tmp_path, 3).with_suffix(".parquet.broken").read_bytes() == b"PAR1"


def test_a_second_broken_row_does_not_overwrite_the_first(tmp_path):
    run(tmp_path)
    all_rows_path(tmp_path).unlink()
    path = row_path(tmp_path, 3)
    path.parent.mkdir()
    told = []
    for content in (b"first", b"second", b"third"):
        all_rows_path(tmp_path).unlink(missing_ok=True)
        path.write_bytes(content)
        run(tmp_path, told=told, resume=True)
    asides = [path.with_name(f"{path.name}.broken{n}") for n in ("", "-2", "-3")]
    assert [a.read_bytes() for a in asides] == [b"first", b"second", b"third"]
    for line, aside in zip(told, asides, strict=True):
        assert f"renamed to {aside.name}, its trial runs again" in line


def test_a_broken_file_of_all_rows_is_left_for_the_user(tmp_path):
    run(tmp_path)
    whole = all_rows_path(tmp_path)
    whole.write_bytes(b"")
    engine = stub.StubEngine()
    with pytest.raises(
        ScenarioError, match=r"trials.parquet: .*move it away so .*again"
    ):
        run(tmp_path, engine, resume=True)
    assert engine.given == []
    assert whole.exists()
    whole.rename(tmp_path / "trials.parquet.away")
    assert run(tmp_path, engine, resume=True).num_rows == 6
    assert engine.given == list(range(6))


@pytest.mark.parametrize("number", [errno.EACCES, errno.EIO, errno.EMFILE])
@pytest.mark.parametrize("single", [True, False])
def test_an_unreadable_file_does_not_count_as_broken(
    number, single, tmp_path, monkeypatch
):
    run(tmp_path)
    path = all_rows_path(tmp_path)
    if single:
        path.unlink()
        path = row_path(tmp_path, 3)
        sweep.SweepFolder(tmp_path).add(stub.trial({}, "", 0, 3, "none"))
    content, before = path.read_bytes(), sorted(tmp_path.rglob("*"))
    read_bytes = Path.read_bytes

    def failing(self):
        if self == path:
            raise OSError(number, os.strerror(number), str(self))
        return read_bytes(self)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "read_bytes", failing)
        with pytest.raises(ScenarioError) as caught:
            run(tmp_path, resume=True)
    assert str(caught.value) == f"{path}: cannot be read: {os.strerror(number)}"
    assert sorted(tmp_path.rglob("*")) == before
    assert path.read_bytes() == content
    assert run(tmp_path, resume=True).num_rows == 6


def test_an_unreadable_folder_does_not_count_as_empty(tmp_path, monkeypatch):
    run(tmp_path)
    whole = all_rows_path(tmp_path)
    content = whole.read_bytes()

    def failing(self):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "iterdir", failing)
        with pytest.raises(ScenarioError, match="trials: cannot be read: Permission"):
            run(tmp_path, resume=True)
    assert whole.read_bytes() == content


def test_a_sweep_does_not_overwrite_another(tmp_path):
    run(tmp_path)
    with pytest.raises(ScenarioError, match=r"continue it with --resume"):
        run(tmp_path)
    (tmp_path / "sweep.json").unlink()
    for resume in (False, True):
        with pytest.raises(ScenarioError, match=r"contains trials but no sweep.json"):
            run(tmp_path, resume=resume)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"seed": 1}, "seed: was 0, is 1"),
        ({"record": "all"}, "record: was none, is all"),
        ({"trials": 5}, "trials: was 6, is 5"),
        (
            {"overrides": ["object.mass=0.3"]},
            r"objects.soup_can.mass[^:]*: was .*, is .*",
        ),
        ({"scenario": "kitchen"}, "arm.period: was .*, is missing"),
    ],
)
def test_another_sweep_is_not_continued(changes, words, tmp_path):
    run(tmp_path)
    before = read_rows(tmp_path)
    with pytest.raises(ScenarioError, match=f"contains another sweep: {words}"):
        run(tmp_path, resume=True, **changes)
    assert read_rows(tmp_path).equals(before)


@pytest.mark.parametrize("name", ["drake_srg", "drake_srg_sources", "drake"])
def test_rows_of_other_code_are_not_continued(name, tmp_path, monkeypatch):
    run(tmp_path)
    there = sweep.current_versions()
    monkeypatch.setattr(sweep, "current_versions", lambda: {**there, name: "other"})
    words = f"contains another sweep: {name}: was {re.escape(there[name])}, is other"
    with pytest.raises(ScenarioError, match=words):
        run(tmp_path, trials=7, resume=True)
    assert read_rows(tmp_path).num_rows == 6


def test_rows_of_unknown_code_are_not_continued(tmp_path):
    run(tmp_path)
    info = json.loads((tmp_path / "sweep.json").read_text())
    del info["versions"]["drake_srg_sources"]
    (tmp_path / "sweep.json").write_text(json.dumps(info))
    with pytest.raises(ScenarioError, match="drake_srg_sources: was missing"):
        run(tmp_path, trials=7, resume=True)


def test_other_versions_may_differ(tmp_path, monkeypatch):
    run(tmp_path)
    there = sweep.current_versions()
    monkeypatch.setattr(sweep, "current_versions", lambda: {**there, "python": "4.0"})
    assert run(tmp_path, trials=7, resume=True).num_rows == 7


def test_resuming_a_finished_sweep_needs_no_engine(tmp_path):
    class Unused(stub.StubEngine):
        def __enter__(self):
            raise AssertionError

    rows = run(tmp_path)
    assert run(tmp_path, Unused(), resume=True).equals(rows)


def test_two_sweeps_do_not_share_a_folder(tmp_path):
    program = (
        "import fcntl, sys, time; f = open(sys.argv[1], 'a'); fcntl.flock(f, 2);"
        "f.write('process 7'); f.flush(); print(); sys.stdout.flush(); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, tmp_path / "lock"], stdout=subprocess.PIPE
    ) as other:
        other.stdout.readline()
        with pytest.raises(ScenarioError, match="process 7 is running a sweep there"):
            run(tmp_path)
        other.kill()
    run(tmp_path)


@pytest.mark.parametrize("trials", [0, -1])
def test_a_sweep_needs_trials(trials, tmp_path):
    with pytest.raises(ScenarioError, match=f"--trials {trials}: must be at least 1"):
        run(tmp_path / "out", trials=trials)
    assert not (tmp_path / "out").exists()


def test_warnings_of_trials_are_reported(tmp_path):
    def odd(*arguments):
        result = stub.trial(*arguments)
        return type(result)(result.row, result.files, "odd")

    told = []
    run(tmp_path, told=told, trials=1, trial_function=odd)
    assert told == ["odd"]


def test_progress_shows_success_and_the_time_left(tmp_path, monkeypatch, capsys):
    now, add = 0.0, sweep.SweepFolder.add

    def a_minute_each(self, result):
        nonlocal now
        now += 60
        add(self, result)

    monkeypatch.setattr(sweep.SweepFolder, "add", a_minute_each)
    # One after the other: if two have ended, either may come first.
    monkeypatch.setattr(stub.StubEngine, "slots", lambda _: 1)
    monkeypatch.setattr(tqdm.std, "time", lambda: now)

    def shown(trials):
        run(tmp_path, trials=trials, progress=True, resume=True)
        frames = re.split(r"[\r\n]+", capsys.readouterr().err)
        return [re.sub(r"\|.*?\|", "|", frame) for frame in frames if frame]

    # In `stub.trial`, trials 1 and 4 fail.
    assert distinct(shown(3)) == [
        "0/3 trials | [00:00 elapsed, ? left]",
        "1/3 trials | 100.0% succeeded [01:00 elapsed, 02:00 left]",
        "2/3 trials | 50.0% succeeded [02:00 elapsed, 01:00 left]",
        "3/3 trials | 66.7% succeeded [03:00 elapsed, 00:00 left]",
    ]
    # The time left is extrapolated from the trials of this run only.
    assert distinct(shown(5)) == [
        "3/5 trials | 66.7% succeeded [00:00 elapsed, ? left]",
        "4/5 trials | 75.0% succeeded [01:00 elapsed, 01:00 left]",
        "5/5 trials | 60.0% succeeded [02:00 elapsed, 00:00 left]",
    ]


def distinct(frames):
    """The frames in order, without repetitions and gaps."""
    return list(dict.fromkeys(" ".join(frame.split()) for frame in frames))


def test_nothing_is_printed_by_default(tmp_path, capsys):
    run(tmp_path)
    assert capsys.readouterr().err == ""


def test_a_folder_cannot_be_made_inside_a_file(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        run(tmp_path / "file" / "out")
    shutil.rmtree(tmp_path)
