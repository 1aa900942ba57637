import argparse
import fcntl
import os
from pathlib import Path

import pytest

from drake_srg.cli import results
from drake_srg.cli.results import RUN, SWEEP, find, new_folder, remove, results_folder
from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.train import LOG, ONNX, POLICY
from drake_srg.simulation.recorders import FILES
from drake_srg.sweeps.info import FILE
from drake_srg.sweeps.rows import all_rows_path, row_path
from drake_srg.sweeps.sweep import RECORDINGS


def options(out=None, replace=False, **more):
    return argparse.Namespace(out=out, replace=replace, **more)


def run(given, default, names=RUN):
    """Write results as a command does; return the folder."""
    with results_folder(given, default, names) as out:
        (out / "metrics.json").write_text(f"run in {out.name}")
    return out


def test_without_out_each_run_has_a_folder_of_its_own(tmp_path):
    default = tmp_path / "out" / "kitchen"
    made = [run(options(), default).name for _ in range(3)]
    assert made == ["kitchen", "kitchen-2", "kitchen-3"]
    for name in made:
        text = (default.with_name(name) / "metrics.json").read_text()
        assert text == f"run in {name}"


def test_with_out_results_are_kept_unless_they_are_to_be_replaced(tmp_path):
    out = tmp_path / "mine"
    run(options(out), tmp_path)
    for name in ("video.mp4", "replay.html", "notes.txt"):
        (out / name).touch()
    message = r"^--out .*mine: already has results \(metrics.json\); .*--replace$"
    with pytest.raises(ScenarioError, match=message):
        run(options(out), tmp_path)
    assert len(list(out.iterdir())) == 4
    run(options(out, replace=True), tmp_path)
    assert sorted(path.name for path in out.iterdir()) == ["metrics.json", "notes.txt"]


def test_files_of_others_are_in_nobodys_way(tmp_path):
    (tmp_path / "notes.txt").touch()
    run(options(tmp_path), tmp_path)


def test_of_two_runs_at_a_time_the_second_is_refused(tmp_path):
    out = tmp_path / "mine"
    with (
        results_folder(options(out), tmp_path, RUN),
        pytest.raises(ScenarioError, match=r"mine: another process is writing there$"),
    ):
        run(options(out, replace=True), tmp_path)
    default = tmp_path / "kitchen"
    with results_folder(options(), default, RUN) as first:
        assert first == default
        assert run(options(), default).name == "kitchen-2"


def test_a_file_system_without_locks_does(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError("no locks here")

    monkeypatch.setattr(fcntl, "flock", refuse)
    assert run(options(tmp_path), tmp_path) == tmp_path


def test_an_error_before_the_first_file_leaves_no_folder(tmp_path):
    out = tmp_path / "deep" / "mine"
    with pytest.raises(ZeroDivisionError), results_folder(options(out), out, RUN):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_what_is_resumed_is_the_last_one(tmp_path):
    default = tmp_path / "kitchen"
    assert run(options(resume=True), default) == default
    assert run(options(resume=False), default).name == "kitchen-2"
    assert run(options(resume=True), default).name == "kitchen-2"
    with pytest.raises(ScenarioError, match="continue them with --resume"):
        run(options(default, resume=False), default)
    assert run(options(default, resume=True), default) == default


def make(given, default, content="new"):
    """Make a folder as `import` does; return it."""
    with new_folder(given, default, ("model.sdf",)) as out:
        assert not out.exists() or not any(out.iterdir())
        out.mkdir(exist_ok=True)
        (out / "model.sdf").write_text(content)
    return out


def test_a_folder_that_is_made_in_one_step_is_new(tmp_path):
    default = tmp_path / "cup"
    assert [make(options(), default).name for _ in range(2)] == ["cup", "cup-2"]
    with pytest.raises(ScenarioError, match=r"already has results \(model.sdf\)"):
        make(options(default), default)
    assert make(options(default, replace=True), tmp_path, "newer") == default
    assert (default / "model.sdf").read_text() == "newer"
    (default / "notes.txt").touch()
    with pytest.raises(ScenarioError, match=r"already has results \(notes.txt\)"):
        make(options(default, replace=True), tmp_path, "newest")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cup", "cup-2"]


def test_what_was_to_be_replaced_comes_back_after_an_error(tmp_path):
    out = make(options(), tmp_path / "cup", "old")
    with (
        pytest.raises(ZeroDivisionError),
        new_folder(options(out, replace=True), out, ("model.sdf",)),
    ):
        raise ZeroDivisionError
    assert (out / "model.sdf").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["cup"]


def test_nothing_but_results_is_removed(tmp_path):
    mine = [tmp_path / "recordings" / "notes.txt", tmp_path / "trials" / "mine.csv"]
    theirs = [
        tmp_path / "sweep.json",
        tmp_path / "recordings" / "000001" / "video.mp4",
        tmp_path / "trials" / "000001.parquet",
    ]
    for path in (*mine, *theirs):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    remove(tmp_path, SWEEP)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == mine
    assert not (tmp_path / "recordings" / "000001").exists()


@pytest.mark.parametrize(
    ("names", "path"),
    [
        *((RUN, Path(file)) for file in (*FILES.values(), "metrics.json")),
        (SWEEP, Path(FILE)),
        (SWEEP, all_rows_path(Path())),
        (SWEEP, row_path(Path(), 17)),
        *((SWEEP, Path(RECORDINGS, "000017", file)) for file in FILES.values()),
        *((results.TRAINING, Path(name)) for name in (POLICY, ONNX, LOG)),
        (results.TRAINING, Path("events.out.tfevents.1")),
    ],
)
def test_what_commands_write_is_known(tmp_path, names, path):
    (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / path).touch()
    assert find(tmp_path, names) == tmp_path / path


def test_the_folder_is_free_again_after_an_error(tmp_path):
    out = tmp_path / "mine"
    for _ in range(2):
        with pytest.raises(ScenarioError), results_folder(options(out), out, RUN):
            raise OSError(28, os.strerror(28))
    assert not out.exists()
