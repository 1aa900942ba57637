import json
import shutil

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.rows import read_rows

from . import stub
from .stub import run

pytestmark = pytest.mark.usefixtures("unchecked")


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
    shutil.rmtree(tmp_path)
