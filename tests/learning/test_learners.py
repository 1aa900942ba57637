"""Learners in PyTorch: `make test-learn` runs this in an environment with it."""

import json

import numpy as np
import pytest

pytest.importorskip("torch", reason="the extra `learn` is not installed")
from onnx.reference import ReferenceEvaluator

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning import learners
from drake_srg.learning.episodes import make_environment
from drake_srg.learning.learners import CHECKPOINT, CloningConfig, QConfig, QRounds
from drake_srg.learning.policy import load_policy
from drake_srg.learning.rules import TOUCH, pick, pick_by_touch
from drake_srg.learning.train import LOG, ONNX, POLICY, MakeLearner, Training, train

from .toy import Toy

pytestmark = pytest.mark.learn
HITS = "tests.learning.toy:toy/Hits-v0"


def test_an_ensemble_learns_what_succeeds():
    quick = QConfig(members=2, hidden=(32,), updates=2, warm_up=30)
    hits = QRounds(Toy(size=1), 0, quick).advance(250)
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


def clone_of(x, shown, **numbers):
    rng = np.random.default_rng(0)
    network = learners.clone(x, shown, rng, CloningConfig(**numbers))
    return np.tanh(network(x)[0])


def test_a_clone_does_what_was_shown():
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (400, 2)).astype(np.float32)
    shown = np.tanh(x @ np.array([[1.0], [-0.5]])).astype(np.float32)
    done = clone_of(x, shown, hidden=(32,), updates=1500)
    assert np.mean((done - shown) ** 2) < 3e-3
    assert np.abs(done - shown).max() < 0.25


def test_a_clone_of_what_differs_from_time_to_time_does_the_mean():
    """The last batches, each with another mean, do not move it any more."""
    x = np.ones((2000, 1), np.float32)
    rng = np.random.default_rng(0)
    shown = rng.choice([-0.5, 0.5], (2000, 1)).astype(np.float32)
    numbers = {"hidden": (8,), "batch": 8, "updates": 2000, "rate": 1e-2}
    done = clone_of(x, shown, **numbers)
    # With a constant rate, it is 0.04 away.
    assert done[0, 0] == pytest.approx(shown.mean(), abs=0.02)


@pytest.mark.parametrize(("samples", "updates"), [(10, 5), (100, 20)])
def test_many_samples_take_more_updates(monkeypatch, samples, updates):
    rates = []

    class Counted(learners.AdamW):
        def step(self, *arguments):
            rates.append(self.param_groups[0]["lr"])
            return super().step(*arguments)

    monkeypatch.setattr(learners, "AdamW", Counted)
    x = np.ones((samples, 1), np.float32)
    clone_of(x, x, hidden=(4,), batch=10, updates=5, passes=2.0, rate=1e-3)
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


@pytest.mark.parametrize("algorithm", ["bc", "dagger"])
def test_clones_imitate_the_rule_of_their_choice(algorithm):
    env = make_environment("Pick")
    assert MakeLearner(algorithm, env, 0)._rule is pick
    assert MakeLearner(algorithm, env, 0, "", TOUCH)._rule is pick_by_touch


def test_values_of_actions_need_episodes_of_one_step():
    with pytest.raises(ScenarioError, match="--algo q: needs episodes of one step"):
        MakeLearner("q", Toy(steps=2), 0).advance(1)


class Drifts(Toy):
    """The observation depends on the last action: mistakes lead to other states."""

    def reset(self, *, seed=None, options=None):
        self.acted = []
        return super().reset(seed=seed)

    def step(self, action):
        self.acted.append(np.array(action))
        result = super().step(action)
        self._target = np.clip(action, -0.8, 0.8)
        return self._observed(), *result[1:]


@pytest.fixture
def quick_dagger(monkeypatch):
    config = CloningConfig(hidden=(16,), updates=50)
    monkeypatch.setattr(learners, "DAGGER", config)


def contents(learner, folder):
    learner.save(folder)
    state = learners.torch.load(folder / CHECKPOINT, weights_only=True)
    return state["seen"].numpy(), state["done"].numpy()


def test_demonstrations_are_kept(tmp_path):
    learner = MakeLearner("bc", Toy(steps=2), 0)
    assert all(learner.advance(10))
    seen, done = contents(learner, tmp_path)
    assert len(seen) == len(done) == 10


@pytest.mark.usefixtures("quick_dagger")
def test_the_rule_acts_first_then_the_policy(tmp_path):
    env = Drifts(steps=2)
    learner = MakeLearner("dagger", env, 0)
    assert all(learner.advance(20))
    _, network = learner.policy()
    learner.advance(2)
    seen, done = contents(learner, tmp_path)
    # Single precision rounds sums of numbers near 1 by 1e-7, as the processor likes.
    np.testing.assert_allclose(np.tanh(network(seen[-2:])[0]), env.acted, atol=1e-6)
    # The label is what the rule does there: in this toy, what is observed.
    np.testing.assert_allclose(done, seen, atol=1e-6)
    assert not np.allclose(done[-2:], env.acted, atol=1e-3)


@pytest.mark.usefixtures("quick_dagger")
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


def sac(steps):
    return Training(environment=HITS, algorithm="sac", steps=steps, validation=20)


@pytest.fixture
def early_sac(monkeypatch):
    """Learns before 500 steps, which are many of a toy's."""
    options = {"learning_starts": 100, "learning_rate": 3e-3}
    monkeypatch.setattr(learners, "SAC_OPTIONS", options)


@pytest.mark.usefixtures("early_sac")
def test_sac_learns_to_hit_and_the_file_acts_like_the_model(tmp_path):
    policy = train(sac(1500), tmp_path)
    assert policy.info.scores["validation"] > 0.6
    again = load_policy(tmp_path / POLICY)
    x = np.array([1.0, 2.0], np.float32)
    np.testing.assert_array_equal(again(x), policy(x))
    session = ReferenceEvaluator(str(tmp_path / ONNX))
    (action,) = session.run(None, {"observation": x[None]})
    np.testing.assert_allclose(action[0], policy(x), atol=1e-5)


@pytest.mark.usefixtures("early_sac")
def test_training_by_sac_goes_on(tmp_path):
    train(sac(200), tmp_path)
    train(sac(300), tmp_path, resume=True)
    history = json.loads((tmp_path / LOG).read_text())["history"]
    assert [row[0] for row in history] == [200, 300]
    # Episodes of three steps; the one that was cut off does not count.
    assert history[-1][1] == 200 // 3 + 100 // 3


@pytest.mark.usefixtures("early_sac")
def test_a_replay_buffer_that_cannot_be_restored_is_one_line(tmp_path):
    train(sac(150), tmp_path)
    (tmp_path / "replay.pkl").write_bytes(b"no pickle")
    with pytest.raises(ScenarioError, match="--resume: cannot be read"):
        train(sac(200), tmp_path, resume=True)
