import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.algorithms import MakeLearner
from drake_srg.learning.cloning import CloningConfig, clone
from drake_srg.learning.learners import CHECKPOINT
from drake_srg.learning.network import Adam
from drake_srg.learning.policy import scaled
from drake_srg.learning.q_learner import QConfig, QLearner

from .toy import Toy

QUICK = QConfig(members=2, hidden=(32,), updates=2, warm_up=30)


def test_an_ensemble_learns_what_succeeds():
    env, rng = Toy(size=1), np.random.default_rng(0)
    space = env.observation_space
    learner = QLearner(1, 1, rng, QUICK)
    hits = []
    for seed in range(250):
        x = scaled(env.reset(seed=seed)[0], space.low, space.high)
        action = learner.explore(x)
        _, reward, *_ = env.step(action)
        learner.learn(x, action, reward)
        hits.append(reward)
    assert np.mean(hits[-50:]) > 0.8 > np.mean(hits[:30]) + 0.2


def test_a_restored_learner_goes_on_alike(tmp_path):
    whole = MakeLearner("q", Toy(), 1)
    whole.advance(120)
    begun = MakeLearner("q", Toy(), 1)
    begun.advance(110)
    begun.save(tmp_path)
    rest = MakeLearner("q", Toy(), 1)
    rest.restore(tmp_path)
    rest.advance(10)
    assert (rest.steps, rest.episodes) == (whole.steps, whole.episodes)
    for a, b in zip(
        rest.policy()[1].parameters, whole.policy()[1].parameters, strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_a_clone_does_what_was_shown():
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, (400, 2)).astype(np.float32)
    shown = np.tanh(x @ np.array([[1.0], [-0.5]])).astype(np.float32)
    network, error = clone(x, shown, rng, CloningConfig(hidden=(32,), updates=400))
    assert error < 3e-3
    assert np.abs(np.tanh(network(x)[0]) - shown).max() < 0.25


def test_a_clone_of_what_differs_from_time_to_time_does_the_mean():
    """The last batches, each with another mean, do not move it any more."""
    rng = np.random.default_rng(0)
    x = np.ones((2000, 1), np.float32)
    shown = rng.choice([-0.5, 0.5], (2000, 1)).astype(np.float32)
    config = CloningConfig(hidden=(8,), batch=8, updates=2000, rate=1e-2)
    for seed in range(3):
        network, _ = clone(x, shown, np.random.default_rng(seed), config)
        # With a constant rate, it is 0.04 away.
        assert np.tanh(network(x[:1])[0, 0, 0]) == pytest.approx(shown.mean(), abs=0.02)


@pytest.mark.parametrize(("samples", "updates"), [(10, 5), (100, 20)])
def test_many_samples_take_more_updates(monkeypatch, samples, updates):
    rates = []

    class Counted(Adam):
        def step(self, gradients):
            rates.append(self.rate)
            super().step(gradients)

    monkeypatch.setattr("drake_srg.learning.cloning.Adam", Counted)
    x = np.ones((samples, 1), np.float32)
    config = CloningConfig(hidden=(4,), batch=10, updates=5, passes=2.0, rate=1e-3)
    clone(x, x, np.random.default_rng(0), config)
    assert len(rates) == updates
    np.testing.assert_allclose(rates, 1e-3 * (1.0 - np.arange(updates) / updates))


def test_only_what_succeeded_is_cloned():
    class Misses(Toy):
        def rule(self, observation):
            return super().rule(observation) + 1.0

    learner = MakeLearner("bc", Misses(), 0)
    assert not any(learner.advance(20))
    with pytest.raises(ScenarioError, match="no demonstration succeeded"):
        learner.policy()


def test_demonstrations_are_kept(tmp_path):
    learner = MakeLearner("bc", Toy(steps=2), 0)
    assert all(learner.advance(10))
    learner.save(tmp_path)
    with np.load(tmp_path / CHECKPOINT) as file:
        assert len(file["seen"]) == len(file["done"]) == 10


def test_values_of_actions_need_episodes_of_one_step():
    with pytest.raises(ScenarioError, match="--algo q: needs episodes of one step"):
        MakeLearner("q", Toy(steps=2), 0).advance(1)
