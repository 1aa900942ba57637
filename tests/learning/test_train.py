import json

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.policy import load_policy
from drake_srg.learning.train import LOG, POLICY, MakeLearner, Training, train

HIT = "tests.learning.toy:toy/Hit-v0"


def training(**changes):
    values = {"environment": HIT, "steps": 130, "validation": 10, **changes}
    return Training(**values)


@pytest.mark.learn
def test_training_writes_a_policy_and_how_it_went(tmp_path):
    policy = train(training(command="a command"), tmp_path)
    again = load_policy(tmp_path / POLICY)
    assert again.info == policy.info
    assert (again.info.environment, again.info.command) == (HIT, "a command")
    log = json.loads((tmp_path / LOG).read_text())
    assert log["history"][-1][:2] == [130, 130]
    assert any(path.name.startswith("events.") for path in tmp_path.iterdir())


@pytest.mark.learn
def test_it_trains_with_one_thread(tmp_path, monkeypatch):
    import torch

    threads = []

    def validate(*_):
        threads.extend(pool["num_threads"] for pool in threadpool_info())
        threads.append(torch.get_num_threads())
        return 1.0

    monkeypatch.setattr("drake_srg.learning.train.validate", validate)
    with threadpool_limits(2):
        train(training(), tmp_path)
    assert len(threads) > 1
    assert set(threads) == {1}


@pytest.mark.learn
@pytest.mark.parametrize(
    ("scores", "chosen"),
    [
        ([0.2, 0.8, 0.8], 3),
        ([0.2, 0.8, 0.7], 3),  # within 0.13, the standard error of 0.8 in 10 episodes
        ([0.2, 0.8, 0.6], 2),
        ([0.2, 0.8, 0.7, 0.6], 3),
        ([1.0, 0.9, 0.9], 1),
    ],
)
def test_of_equals_the_latest_policy_counts(tmp_path, monkeypatch, scores, chosen):

    def make(*arguments):
        learner = MakeLearner(*arguments)
        learner.round_steps = 10
        return learner

    left = list(scores)
    monkeypatch.setattr("drake_srg.learning.train.MakeLearner", make)
    monkeypatch.setattr("drake_srg.learning.train.validate", lambda *_: left.pop(0))
    policy = train(training(steps=10 * len(scores)), tmp_path)
    assert policy.info.steps == 10 * chosen
    assert load_policy(tmp_path / POLICY).info == policy.info


@pytest.mark.learn
def test_the_same_training_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        train(training(), tmp_path / name)
    a, b = ((tmp_path / name / POLICY).read_bytes() for name in ("a", "b"))
    assert a == b


@pytest.mark.learn
def test_training_goes_on_only_where_asked_and_only_as_begun(tmp_path):
    train(training(steps=110), tmp_path)
    with pytest.raises(ScenarioError, match="--resume"):
        train(training(), tmp_path)
    with pytest.raises(ScenarioError, match="seed: was 0, is 1"):
        train(training(seed=1), tmp_path, resume=True)
    train(training(), tmp_path, resume=True)
    history = json.loads((tmp_path / LOG).read_text())["history"]
    assert [row[0] for row in history] == [110, 130]


@pytest.mark.learn
def test_a_clone_of_the_rule_succeeds(tmp_path, monkeypatch):
    from drake_srg.learning import learners

    quick = learners.CloningConfig(hidden=(32,), updates=300)
    monkeypatch.setattr(learners, "CLONING", quick)
    policy = train(training(algorithm="bc", steps=200), tmp_path)
    assert policy.kind == "actor"
    assert policy.info.scores["validation"] > 0.8
    assert np.isfinite(policy.network(np.zeros((1, 2), np.float32))).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"algorithm": "x"}, "--algo x"),
        ({"steps": 0}, "--steps 0"),
        ({"seed": -1}, "--seed -1"),
    ],
)
def test_bad_input_is_refused_before_anything_is_written(tmp_path, changes, message):
    with pytest.raises(ScenarioError, match=message):
        train(training(**changes), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_broken_log_is_one_line(tmp_path):
    (tmp_path / LOG).write_text("{")
    with pytest.raises(ScenarioError, match="invalid content"):
        train(training(), tmp_path, resume=True)


@pytest.mark.learn
def test_a_broken_checkpoint_is_one_line(tmp_path):
    train(training(steps=20), tmp_path)
    (tmp_path / "checkpoint.pt").write_bytes(b"PK")
    with pytest.raises(ScenarioError, match="--resume: cannot be read"):
        train(training(), tmp_path, resume=True)
