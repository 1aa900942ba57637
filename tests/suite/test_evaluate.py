import json
from types import SimpleNamespace
from typing import ClassVar

import gymnasium
import numpy as np
import pytest
from learning.made_policies import made_policy

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import EVALUATION
from drake_srg.suite import evaluate
from drake_srg.types import Failure, Mode


class Counting(gymnasium.Env):
    """Its expert succeeds in even episodes after two steps; others never do."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    episode = SimpleNamespace(status=SimpleNamespace(mode=Mode.DONE, failure=None))
    acted: ClassVar[list] = []

    def __init__(self, task, **keywords):
        self.expert = keywords["expert"]

    def reset(self, *, seed=None, options=None):
        self.number, self.steps = seed, 0
        return {}, {"is_success": False, "failure": ""}

    def step(self, action):
        self.acted.append(action)
        self.steps += 1
        done = self.steps == 2 and self.number % 2 == 0 and np.all(action == 0.5)
        info = {"is_success": bool(done), "failure": ""}
        return {}, float(done), done, self.steps == 3, info

    def close(self):
        pass

    def expert_action(self):
        assert self.expert
        return np.full(2, 0.5, np.float32)


@pytest.fixture(autouse=True)
def counting(monkeypatch):
    monkeypatch.setattr(evaluate, "SuiteEnv", Counting)
    monkeypatch.setattr(Counting, "acted", [])


def test_rows_tell_success_and_what_the_expert_says():
    rows = list(evaluate.play_episodes("pick_can", [0, 1]))
    assert [row["success"] for row in rows] == [True, False]
    assert [row["steps"] for row in rows] == [2, 3]
    assert [row["expert"] for row in rows] == ["done", "done"]


def test_a_failure_of_the_expert_is_told_by_its_name(monkeypatch):
    status = SimpleNamespace(mode=Mode.FAILED, failure=Failure.NO_GRASP)
    monkeypatch.setattr(Counting, "episode", SimpleNamespace(status=status))
    (row,) = evaluate.play_episodes("pick_can", [1])
    assert row["expert"] == "no_grasp"


def test_random_actions_depend_on_the_episode_alone():
    played = []
    for episodes in ([0, 1], [1]):
        Counting.acted = []
        rows = list(evaluate.play_episodes("pick_can", episodes, policy="random"))
        assert not any(row["success"] or row["expert"] for row in rows)
        played.append(np.array(Counting.acted))
    np.testing.assert_array_equal(played[0][3:], played[1])
    assert len({tuple(action) for action in played[0]}) == 6


def test_the_command_goes_on_where_it_was_cut_off(tmp_path, capsys):
    out = tmp_path / "new" / "rows.jsonl"
    words = ["pick_can,place_can", "--out", str(out), "--episodes"]
    assert evaluate.main([*words, "2"]) == 0
    before = out.read_text()
    assert evaluate.main([*words, "3"]) == 0
    after = out.read_text()
    assert after.startswith(before)
    rows = [json.loads(line) for line in after.splitlines()]
    assert len(rows) == 6
    assert len({(row["task"], row["episode"]) for row in rows}) == 6
    last = capsys.readouterr().out.splitlines()[-2:]
    assert last[0].split()[:4] == ["pick_can", "2", "of", "3"]


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (["--policy", "random"], "has rows of policy 'expert', not 'random'"),
        (["--split", "training"], "has rows of split 'evaluation', not 'training'"),
        (["--episode-length", "3"], "has rows of episode_length None, not 3"),
    ],
)
def test_a_file_keeps_the_rows_of_one_setting(tmp_path, capsys, other, message):
    out = tmp_path / "rows.jsonl"
    words = ["pick_can", "--episodes", "1", "--out", str(out)]
    assert evaluate.main(words) == 0
    before = out.read_text()
    assert evaluate.main([*words, *other]) == 2
    assert message in capsys.readouterr().err
    assert out.read_text() == before


def test_only_the_episodes_asked_for_are_counted(tmp_path, capsys):
    words = ["pick_can", "--out", str(tmp_path / "rows.jsonl"), "--episodes"]
    assert evaluate.main([*words, "4"]) == evaluate.main([*words, "2"]) == 0
    assert "1 of 2" in capsys.readouterr().out.splitlines()[-1]


class Still(Counting):
    """Ends with success if nothing moves; its seeds are the scenario's."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    seeds: ClassVar[list] = []

    def __init__(self, task, **keywords):
        assert keywords == {"episode_length": 3}

    def reset(self, *, seed=None, options=None):
        self.seeds.append(seed)
        _, info = super().reset(seed=0)
        return np.zeros(2, np.float32), info

    def step(self, action):
        _, *rest = super().step(np.where(action == 0.0, 0.5, action))
        return np.zeros(2, np.float32), *rest


@pytest.mark.parametrize("kind", ["proprio", "state"])
def test_a_policy_acts_on_the_episodes_of_evaluation(
    tmp_path, monkeypatch, capsys, kind
):
    monkeypatch.setattr(evaluate, "VECTOR_ENVS", {kind: Still})
    monkeypatch.setattr(Still, "seeds", [])
    name = f"drake_srg/pick_can_{kind}-v0"
    policy = made_policy(environment=f"drake_srg.suite.envs:{name}")
    for value in policy.network.parameters:
        value[:] = 0.0
    file, out = tmp_path / "policy.npz", tmp_path / "rows.jsonl"
    policy.save(file)
    words = ["--policy", str(file), "--episodes", "2", "--out", str(out)]
    assert evaluate.main(["pick_can", *words, "--episode-length", "3"]) == 0
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert [(row["success"], row["policy"]) for row in rows] == [(True, str(file))] * 2
    assert Still.seeds == [EVALUATION, EVALUATION + 1]
    policy.network.parameters[0][:] = 0.1
    policy.save(file)
    assert evaluate.main(["pick_can", *words, "--episode-length", "3"]) == 2
    assert "has rows of digest" in capsys.readouterr().err
    other = tmp_path / "other.jsonl"
    assert evaluate.main(["pick_can,pick_box", *words[:-1], str(other)]) == 2
    assert f"is a policy for {name}, not for pick_box" in capsys.readouterr().err
    assert not other.exists()


def test_training_has_more_episodes_than_evaluation(tmp_path, capsys):
    words = ["pick_can", "--split", "training", "--episodes", "201"]
    assert evaluate.main([*words, "--out", str(tmp_path / "rows.jsonl")]) == 0
    assert "101 of 201" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["pick_can", "--policy", "none.npz"], "none.npz: cannot be read"),
        (["pick_can", "--policy", "rule"], "must be expert, random or a .npz file"),
        (["pick_can", "--policy", ""], "must be expert, random or a .npz file, got ''"),
        (["pick_can", "--episode-length", "0"], "--episode-length: must be at least 1"),
        (["pick_cn"], "task: unknown 'pick_cn'"),
        (["pick_can", "--episodes", "201"], "--episodes: must be 1 to 200, got 201"),
    ],
)
def test_bad_input_is_one_line_and_ends_with_2(tmp_path, capsys, words, message):
    out = ["--out", str(tmp_path / "rows.jsonl")]
    try:
        code = evaluate.main([*words, *out])
    except SystemExit as error:  # argparse
        code = error.code
    assert code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "rows.jsonl").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            b'{"task": "a", "episode": 0, "policy": "random", "success": true}\n{"ta',
            ":2: is no row",
        ),
        (
            b'{"task": "pick_can", "episode": 0, "policy": "random", "success": "yes"}',
            ":1: is no row",
        ),
        (b"[]", ":1: is no row"),
        (b"PK\x03\x04\xff", ": is no file of rows"),
    ],
)
def test_a_damaged_file_of_rows_is_named(tmp_path, content, message):
    path = tmp_path / "rows.jsonl"
    path.write_bytes(content)
    with pytest.raises(ScenarioError, match=f"rows.jsonl{message}"):
        evaluate.read_rows(path)
