import numpy as np
import pytest

from drake_srg.learning.algorithms import MakeLearner
from drake_srg.learning.cloning import CloningConfig
from drake_srg.learning.learners import CHECKPOINT

from .toy import Toy


class Drifts(Toy):
    """The observation is what the last action made of it: mistakes lead elsewhere."""

    def reset(self, *, seed=None, options=None):
        self.acted = []
        return super().reset(seed=seed)

    def step(self, action):
        self.acted.append(np.array(action))
        result = super().step(action)
        self._target = np.clip(action, -0.8, 0.8)
        return self._observed(), *result[1:]


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    config = CloningConfig(hidden=(16,), updates=50)
    monkeypatch.setattr("drake_srg.learning.dagger._CONFIG", config)


def contents(learner, folder):
    learner.save(folder)
    with np.load(folder / CHECKPOINT) as file:
        return file["seen"], file["done"]


def test_the_rule_acts_first_then_the_policy(tmp_path):
    env = Drifts(steps=2)
    learner = MakeLearner("dagger", env, 0)
    assert all(learner.advance(20))
    _, network = learner.policy()
    learner.advance(2)
    seen, done = contents(learner, tmp_path)
    np.testing.assert_allclose(np.tanh(network(seen[-2:])[0]), env.acted, rtol=1e-6)
    # The label is what the rule does there: in this toy, what is observed.
    np.testing.assert_allclose(done, seen, atol=1e-6)
    assert not np.allclose(done[-2:], env.acted, atol=1e-3)


def test_it_goes_on_alike_after_an_interruption(tmp_path):
    whole = MakeLearner("dagger", Drifts(steps=2), 3)
    whole.advance(20)
    whole.policy()
    whole.save(tmp_path)
    rest = MakeLearner("dagger", Drifts(steps=2), 3)
    rest.restore(tmp_path)
    for learner in (whole, rest):
        learner.advance(10)
    for a, b in zip(
        rest.policy()[1].parameters, whole.policy()[1].parameters, strict=True
    ):
        np.testing.assert_array_equal(a, b)
