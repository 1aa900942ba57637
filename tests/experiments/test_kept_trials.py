import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.kept_trials import KeptTrials


def test_a_trial_runs_once(tmp_path):
    path, runs = str(tmp_path / "kept.jsonl"), []

    def run():
        runs.append(1)
        return {"value": [1.5, None]}

    for _ in range(2):
        assert KeptTrials(path)("a", run) == {"value": [1.5, None]}
    assert KeptTrials(path)("b", run)
    assert len(runs) == 2


def test_a_line_that_was_cut_off_runs_again(tmp_path):
    path = tmp_path / "kept.jsonl"
    path.write_text('{"trial": "a", "result": {"x": 1}}\n{"trial": "b", "res')
    kept = KeptTrials(str(path))
    assert kept("a", dict) == {"x": 1}
    assert kept("b", lambda: {"x": 2}) == {"x": 2}
    assert KeptTrials(str(path))("b", dict) == {"x": 2}


def test_without_a_file_nothing_is_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert KeptTrials("")("a", lambda: {"x": 1}) == {"x": 1}
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_be_used_is_one_line(tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(ScenarioError, match=r"keep: .*cannot be read"):
        KeptTrials(str(tmp_path / "folder"))
    with pytest.raises(ScenarioError, match="cannot be written"):
        KeptTrials(str(tmp_path / "none" / "x"))("a", dict)
