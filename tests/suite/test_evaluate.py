import gymnasium
import numpy as np
import pytest
from learning.made_policies import made_policy
from sweeps.stub import InlineEngine

from drake_srg.learning.episodes import EVALUATION
from drake_srg.suite import evaluate

ID = "drake_srg.suite.envs:drake_srg/{}_{}-v0"


class Still(gymnasium.Env):
    """Succeeds in even episodes if nothing moves; its rule is the expert's."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def __init__(self, expert, episode_length=2):
        self.expert, self.episode_length = expert, episode_length

    def reset(self, *, seed=None, options=None):
        self.number, self.steps, self.still = seed - EVALUATION, 0, True
        return np.zeros(2, np.float32), {}

    def step(self, action):
        self.steps += 1
        self.still &= not np.any(action)
        success = self.still and self.number % 2 == 0
        ended = self.steps == self.episode_length
        info = {"success": success}
        return np.zeros(2, np.float32), float(success), ended, False, info

    def rule(self, observation):
        assert self.expert
        return np.zeros(2, np.float32)


@pytest.fixture(autouse=True)
def still(monkeypatch):
    """Let nothing be simulated."""
    monkeypatch.setattr(
        "drake_srg.learning.evaluate.make_environment",
        lambda name, keywords: Still(**keywords),
    )
    monkeypatch.setattr(evaluate, "JoblibEngine", lambda jobs: InlineEngine())


def play(out, *words):
    return evaluate.main(["pick_can", "--out", str(out), *map(str, words)])


def told(capsys):
    return [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]


@pytest.mark.parametrize(("policy", "done"), [("expert", 2), ("random", 0)])
def test_the_expert_or_chance_plays_the_episodes_of_evaluation(
    tmp_path, capsys, policy, done
):
    assert play(tmp_path, "--episodes", 3, "--policy", policy) == 0
    (line,) = told(capsys)
    assert line.startswith(f"pick_can {done} of 3 (")
    rows = evaluate.play_episodes(
        "pick_can", 3, out=tmp_path / "pick_can", engine=InlineEngine(), policy=policy
    )
    assert rows["seed"].to_pylist() == [EVALUATION + k for k in range(3)]
    assert rows["episode.steps"].to_pylist() == [2.0] * 3


def test_the_command_goes_on_where_it_was_cut_off(tmp_path, capsys):
    for episodes in (2, 3):
        words = ["pick_can,place_can", "--out", str(tmp_path), "--episodes"]
        assert evaluate.main([*words, str(episodes)]) == 0
    assert [line.split()[:4] for line in told(capsys)[2:]] == [
        ["pick_can", "2", "of", "3"],
        ["place_can", "2", "of", "3"],
    ]


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (["--policy", "random"], "contains another sweep: policy: was rule, is random"),
        (["--episode-length", "3"], "contains another sweep: episode_length"),
    ],
)
def test_a_folder_keeps_the_rows_of_one_setting(tmp_path, capsys, other, message):
    assert play(tmp_path, "--episodes", 1) == 0
    assert play(tmp_path, "--episodes", 1, *other) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["proprio", "state"])
def test_a_policy_plays_the_task_of_its_training(tmp_path, capsys, kind):
    policy = made_policy(environment=ID.format("pick_can", kind))
    policy = policy_that_stays(policy)
    policy.save(tmp_path / "policy.npz")
    words = ["--policy", tmp_path / "policy.npz", "--episodes", 2]
    assert play(tmp_path / "out", *words) == 0
    assert told(capsys)[0].startswith("pick_can 1 of 2 (")
    made_policy(environment=ID.format("pick_box", kind)).save(tmp_path / "policy.npz")
    assert play(tmp_path / "other", *words) == 2
    said = f"is a policy for drake_srg/pick_box_{kind}-v0, not for pick_can"
    assert said in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def policy_that_stays(policy):
    for values in policy.network.parameters:
        values[:] = 0.0
    policy.info.keywords.clear()
    return policy


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["pick_can", "--policy", "none.npz"], "none.npz: cannot be read"),
        (["pick_can", "--policy", "rule"], "must be expert, random or a .npz file"),
        (["pick_can", "--policy", ""], "must be expert, random or a .npz file, got ''"),
        (["pick_can", "--episode-length", "0"], "--episode-length: must be at least 1"),
        (["pick_can", "--jobs", "0"], "--jobs: must be at least 1"),
        (["pick_cn"], "task: unknown 'pick_cn'"),
        (["pick_can", "--episodes", "201"], "--episodes: must be 1 to 200, got 201"),
    ],
)
def test_bad_input_is_one_line_and_ends_with_2(tmp_path, capsys, words, message):
    try:
        code = evaluate.main([*words, "--out", str(tmp_path / "out")])
    except SystemExit as error:  # argparse
        code = error.code
    assert code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "out").exists()
