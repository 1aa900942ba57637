import json
from types import SimpleNamespace
from typing import ClassVar

import gymnasium
import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.suite import evaluate


class Counting(gymnasium.Env):
    """Its expert succeeds in even episodes after two steps; others never do."""

    actions = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    episode = SimpleNamespace(status=SimpleNamespace(mode="done", failure=None))
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

    def expert_action(self):
        assert self.expert
        return np.full(2, 0.5, np.float32)


@pytest.fixture(autouse=True)
def counting(monkeypatch):
    monkeypatch.setattr(evaluate, "SuiteEnv", Counting)
    monkeypatch.setattr(Counting, "acted", [])


def test_rows_tell_success_and_what_the_expert_says():
    rows = list(evaluate.evaluate_expert("pick_can", [0, 1]))
    assert [row["success"] for row in rows] == [True, False]
    assert [row["steps"] for row in rows] == [2, 3]
    assert [row["expert"] for row in rows] == ["done", "done"]


def test_random_actions_depend_on_the_episode_alone():
    played = []
    for episodes in ([0, 1], [1]):
        Counting.acted = []
        rows = list(evaluate.evaluate_expert("pick_can", episodes, policy="random"))
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
    ("words", "message"),
    [
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


def test_a_damaged_file_of_rows_is_named(tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text('{"task": "pick_can", "episode": 0, "success": true}\n{"ta\n')
    with pytest.raises(ScenarioError, match=r"rows.jsonl:2: is no row"):
        evaluate.read_rows(path)
