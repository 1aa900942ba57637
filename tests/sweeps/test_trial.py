import dataclasses as dc
import json
import pickle
import tempfile

import pytest
from simulation.made_logs import judge, make_log

from drake_srg.scenario import load_tree
from drake_srg.simulation import Result
from drake_srg.sweeps import trial as module
from drake_srg.sweeps.rows import TIMING_COLUMNS
from drake_srg.sweeps.trial import resident_memory, run_trial, with_contents
from drake_srg.types import PlannerStatus

from . import stub

# A trial that ends within a second of simulated time, with a drawn value.
ABSENT = [
    "object.present=false",
    "object.mass=!Uniform {min: 0.2, max: 0.3}",
    "recording.video_camera=''",
]
MASS, POSITION = "objects.soup_can.mass", "objects.soup_can.position[0]"


def outcome(row):
    return {name: x for name, x in row.items() if name not in TIMING_COLUMNS}


@pytest.fixture(scope="module")
def absent():
    return load_tree("kitchen_fast", ABSENT)


@pytest.mark.slow
def test_a_row_contains_drawn_values_and_the_outcome(absent):
    result = run_trial(absent, "kitchen_fast", 3, 4)
    row = result.row
    assert (row["trial"], row["seed"]) == (4, 7)
    assert (row["success"], row["claimed"]) == (False, False)
    assert row["failure"] == "not_seen"
    assert row["message"]
    assert 0.2 <= row[MASS] <= 0.3
    assert isinstance(row[POSITION], float)
    assert row["sim_time_s"] > 0.0
    assert row["trial_time_s"] > row["wall_time_s"]
    assert row["memory_mb"] == pytest.approx(resident_memory(), rel=0.2)
    assert result.files == {}
    again = run_trial(absent, "kitchen_fast", 7, 0).row  # the same seed
    assert outcome({**again, "trial": 4}) == outcome(row)


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """The folder for temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


@pytest.mark.slow
def test_the_recording_of_a_failed_trial_matches_its_row(absent, scratch, leaked):
    result = run_trial(absent, "kitchen_fast", 0, 0, "failures")
    assert leaked() == []  # of the trial, and of its recording
    files = {"metrics.json", "log.npz", "recording.mcap", "timeline.png"}
    files |= {"replay.html", "replay.glb"}
    assert set(stub.names(result.files)) == files
    assert result.warning == ""
    metrics = json.loads((result.files / "metrics.json").read_text())
    for name in ("seed", "success", "failure", "sim_time_s"):
        assert metrics[name] == result.row[name]
    contents = {path.name: path.read_bytes() for path in result.files.iterdir()}
    assert with_contents(lambda: result).files == contents
    assert stub.names(scratch) == []


@pytest.mark.slow
def test_a_recording_up_to_an_error_is_kept(absent, scratch, monkeypatch):
    def simulate(scenario, *, out, **_):
        if scenario.random_seed == 1:
            (out / "video.mp4").touch()
        raise RuntimeError("no metrics")

    monkeypatch.setattr(module, "Simulate", simulate)
    result = run_trial(absent, "kitchen_fast", 0, 1, "all")
    assert result.row["failure"] == "error"
    assert stub.names(result.files) == ["video.mp4"]
    assert stub.names(scratch) == [result.files.name]
    assert run_trial(absent, "kitchen_fast", 0, 2, "all").files == {}
    assert stub.names(scratch) == [result.files.name]


def test_an_error_on_a_full_disk_names_the_folder(absent, scratch, monkeypatch):
    monkeypatch.setattr(module, "Simulate", stub.no_space)
    with pytest.raises(OSError, match="No space left") as caught:
        run_trial(absent, "kitchen_fast", 0, 0, "all")
    assert pickle.loads(pickle.dumps(caught.value)).filename.startswith(str(scratch))
    assert stub.names(scratch) == []


def test_a_recording_that_differs_from_its_row_gives_a_warning(
    absent, scratch, monkeypatch
):
    runs = []

    def simulate(scenario, *, record, warm_up, **_):
        runs.append(record)
        assert not warm_up  # it would be one more image per trial
        metrics = dc.replace(judge(make_log()), success=False, attempts=len(runs))
        return Result(metrics, {}, PlannerStatus())

    monkeypatch.setattr(module, "Simulate", simulate)
    result = run_trial(absent, "kitchen_fast", 0, 0, "failures")
    assert runs == [False, True]
    assert "trial 0: its recording differs from its row (attempts)" in result.warning
    assert result.row["attempts"] == 1


@pytest.mark.slow
def test_an_error_is_an_outcome(absent):
    tree = {**absent, "directives": []}
    row = run_trial(tree, "kitchen_fast", 0, 0).row
    assert (row["success"], row["failure"]) == (False, "error")
    assert "arm" in row["message"]
    assert "\n" not in row["message"]
    assert row[MASS] is not None


@pytest.mark.slow
def test_a_trial_does_not_depend_on_the_one_before():
    tree = load_tree("kitchen_varied", ["planner.time_budget=1.0"])
    alone, _, after = (run_trial(tree, "kitchen_varied", s, 0).row for s in (5, 6, 5))
    assert outcome(after) == outcome(alone)
    assert alone["failure"] != "error"
    assert alone["sim_time_s"] > 0.0


@pytest.mark.parametrize("error", [OSError("full"), ImportError("no av")])
def test_errors_that_would_fail_all_trials_are_raised(error, absent, monkeypatch):
    def simulate(*_, **__) -> Result:
        raise error

    monkeypatch.setattr(module, "Simulate", simulate)
    with pytest.raises(type(error)):
        run_trial(absent, "kitchen_fast", 0, 0)
