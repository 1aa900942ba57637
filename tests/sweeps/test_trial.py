import json
import pickle
import tempfile

import pytest

from drake_srg.scenario import load_tree
from drake_srg.simulation import Result
from drake_srg.sweeps import trial as module
from drake_srg.sweeps.rows import TIMING_COLUMNS
from drake_srg.sweeps.trial import run_trial, with_contents

from . import stub

# A trial that ends within a second of simulated time, with something drawn.
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


def test_a_trial_tells_what_was_drawn_and_what_came_of_it(absent):
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
    assert 50.0 < row["memory_mb"] < 2000.0
    assert result.files == {}
    again = run_trial(absent, "kitchen_fast", 7, 0).row  # the same seed
    assert outcome({**again, "trial": 4}) == outcome(row)


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """The folder for temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_a_failed_trial_is_recorded_as_it_was(absent, scratch):
    result = run_trial(absent, "kitchen_fast", 0, 0, "failures")
    files = {"metrics.json", "log.npz", "recording.mcap", "timeline.png"}
    assert set(stub.names(result.files)) == files
    assert result.warning == ""
    metrics = json.loads((result.files / "metrics.json").read_text())
    for name in ("seed", "success", "failure", "sim_time_s"):
        assert metrics[name] == result.row[name]
    contents = {path.name: path.read_bytes() for path in result.files.iterdir()}
    assert with_contents(lambda: result).files == contents
    assert stub.names(scratch) == []


def test_what_was_recorded_before_an_error_is_kept(absent, scratch, monkeypatch):
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


def test_a_full_disk_is_told_with_its_folder(absent, scratch, monkeypatch):
    monkeypatch.setattr(module, "Simulate", stub.no_space)
    with pytest.raises(OSError, match="No space left") as caught:
        run_trial(absent, "kitchen_fast", 0, 0, "all")
    assert pickle.loads(pickle.dumps(caught.value)).filename.startswith(str(scratch))
    assert stub.names(scratch) == []


def test_a_trial_that_goes_otherwise_while_it_is_recorded_says_so(
    absent, scratch, monkeypatch
):
    runs = []

    def simulate(scenario, **options):
        runs.append(options["record"])
        return Simulate(scenario, **options)

    Simulate = module.Simulate
    monkeypatch.setattr(module, "Simulate", simulate)
    monkeypatch.setattr(
        module, "_outcome", lambda result: {"success": False, "attempts": len(runs)}
    )
    result = run_trial(absent, "kitchen_fast", 0, 0, "failures")
    assert runs == [False, True]
    assert "trial 0: recorded, it went otherwise (attempts)" in result.warning
    assert result.row["attempts"] == 1


def test_an_error_is_an_outcome(absent):
    tree = {**absent, "directives": []}
    row = run_trial(tree, "kitchen_fast", 0, 0).row
    assert (row["success"], row["failure"]) == (False, "error")
    assert "arm" in row["message"]
    assert "\n" not in row["message"]
    assert row[MASS] is not None


def test_a_varied_trial_is_the_same_after_another():
    tree = load_tree("kitchen_varied", ["planner.time_budget=1.0"])
    alone, _, after = (run_trial(tree, "kitchen_varied", s, 0).row for s in (5, 6, 5))
    assert outcome(after) == outcome(alone)
    assert alone["failure"] != "error"
    assert alone["sim_time_s"] > 0.0


@pytest.mark.parametrize("error", [OSError("full"), ImportError("no av")])
def test_what_others_would_suffer_too_is_raised(error, absent, monkeypatch):
    def simulate(*_, **__) -> Result:
        raise error

    monkeypatch.setattr(module, "Simulate", simulate)
    with pytest.raises(type(error)):
        run_trial(absent, "kitchen_fast", 0, 0)
