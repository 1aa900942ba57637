"""Soft actor-critic: `make test-learn` runs this in an environment with PyTorch."""

import json

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.policy import load_policy
from drake_srg.learning.train import LOG, ONNX, POLICY, Training, train

pytest.importorskip("torch", reason="the extra `learn` is not installed")

from onnx.reference import ReferenceEvaluator

pytestmark = pytest.mark.learn
HITS = "tests.learning.toy:toy/Hits-v0"


def training(steps):
    return Training(environment=HITS, algorithm="sac", steps=steps, validation=20)


@pytest.fixture(autouse=True)
def early(monkeypatch):
    """Learns before 500 steps, which are many of a toy's."""
    options = {"learning_starts": 100, "learning_rate": 3e-3}
    monkeypatch.setattr("drake_srg.learning.sac.OPTIONS", options)


def test_it_learns_to_hit_and_the_file_acts_like_the_model(tmp_path):
    policy = train(training(1500), tmp_path)
    assert policy.info.scores["validation"] > 0.6
    again = load_policy(tmp_path / POLICY)
    x = np.array([1.0, 2.0], np.float32)
    np.testing.assert_array_equal(again(x), policy(x))
    session = ReferenceEvaluator(str(tmp_path / ONNX))
    (action,) = session.run(None, {"observation": x[None]})
    np.testing.assert_allclose(action[0], policy(x), atol=1e-5)


def test_training_goes_on(tmp_path):
    train(training(200), tmp_path)
    train(
        Training(environment=HITS, algorithm="sac", steps=300, validation=20),
        tmp_path,
        resume=True,
    )
    history = json.loads((tmp_path / LOG).read_text())["history"]
    assert [row[0] for row in history] == [200, 300]
    # Episodes of three steps; the one that was cut off does not count.
    assert history[-1][1] == 200 // 3 + 100 // 3


def test_what_cannot_be_restored_is_one_line(tmp_path):
    train(training(150), tmp_path)
    (tmp_path / "replay.pkl").write_bytes(b"no pickle")
    with pytest.raises(ScenarioError, match="--resume: cannot be read"):
        train(training(200), tmp_path, resume=True)
