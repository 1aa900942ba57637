import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.rows import all_rows_path, read_rows, row_path
from drake_srg.sweeps.sweep import SweepFolder

from . import stub
from .stub import run

pytestmark = pytest.mark.usefixtures("unchecked")


def test_a_recording_without_its_row_is_replaced(tmp_path):
    run(tmp_path, record="failures", trials=2)
    all_rows_path(tmp_path).unlink()
    video = tmp_path / "recordings/000001/video.mp4"
    video.write_text("cut off")
    (tmp_path / "recordings/.000000.partial").mkdir()
    SweepFolder(tmp_path).add(stub.trial({}, "", 0, 0, "none"))
    run(tmp_path, record="failures", trials=2, resume=True)
    assert video.read_text() == "1"
    assert stub.names(tmp_path / "recordings") == ["000001"]


def test_a_broken_row_is_reported_and_its_trial_runs_again(tmp_path):
    run(tmp_path)
    all_rows_path(tmp_path).unlink()
    for trial in range(6):
        SweepFolder(tmp_path).add(stub.trial({}, "", 0, trial, "none"))
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


@pytest.mark.slow
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
        SweepFolder(tmp_path).add(stub.trial({}, "", 0, 3, "none"))
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
        ({"scenario": "kitchen"}, "arm.period: was 0.0234375, is "),
    ],
)
def test_another_sweep_is_not_continued(changes, words, tmp_path):
    run(tmp_path)
    before = read_rows(tmp_path)
    with pytest.raises(ScenarioError, match=f"contains another sweep: {words}"):
        run(tmp_path, resume=True, **changes)
    assert read_rows(tmp_path).equals(before)


# Which versions count is tested in test_info.py.
@pytest.mark.parametrize("version", ["other", None])
def test_rows_of_other_code_are_not_continued(version, tmp_path):
    run(tmp_path)
    path = tmp_path / "sweep.json"
    info = json.loads(path.read_text())
    info["versions"]["python"] = "4.0"  # which may differ
    path.write_text(json.dumps(info))
    assert run(tmp_path, trials=7, resume=True).num_rows == 7
    if version:
        info["versions"]["drake_srg_sources"] = version
    else:
        del info["versions"]["drake_srg_sources"]
    path.write_text(json.dumps(info | {"trials": 7}))
    words = f"contains another sweep: drake_srg_sources: was {version or 'missing'}, is"
    with pytest.raises(ScenarioError, match=words):
        run(tmp_path, trials=8, resume=True)
    assert read_rows(tmp_path).num_rows == 7


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
