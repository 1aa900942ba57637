"""Learners in PyTorch (extra `learn`); see `drake_srg.learning.train.Learner`."""

from __future__ import annotations

import dataclasses as dc
import io
import itertools
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.random import Generator, default_rng
from stable_baselines3 import SAC
from torch import Tensor, nn
from torch.optim import AdamW
from torch.optim.lr_scheduler import LinearLR

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.learning.demonstrations import read_demonstrations
from drake_srg.learning.episodes import Episode, run_episode, training_seed
from drake_srg.learning.policy import Array, Kind, Network, best_action, scaled
from drake_srg.learning.rules import RULE, rule_of
from drake_srg.recording.output import OutputFile
from drake_srg.sweeps.files import write_file

CHECKPOINT = "checkpoint.pt"


class Perceptrons(nn.Module):
    """An ensemble of perceptrons that learn side by side; see `Network`.

    Args:
        sizes: Sizes of the input, the hidden layers and the output.
        rng: For the random weights (He et al., ICCV 2015).
        members: Number of the ensemble's members.
    """

    def __init__(self, sizes: Sequence[int], rng: Generator, members: int = 1) -> None:
        super().__init__()
        self.weights = nn.ParameterList(
            _tensor(np.sqrt(2.0 / inputs) * rng.normal(size=(members, inputs, outputs)))
            for inputs, outputs in itertools.pairwise(sizes)
        )
        self.biases = nn.ParameterList(torch.zeros(members, 1, n) for n in sizes[1:])

    def forward(self, x: Tensor) -> Tensor:
        """Return the outputs (members, n, outputs) for inputs (members, n, inputs)."""
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = torch.baddbmm(bias, torch.relu(x) if k else x, weight)
        return x

    def network(self) -> Network:
        """Return a copy that acts without PyTorch."""
        weights, biases = (
            [p.detach().numpy().copy() for p in parameters]
            for parameters in (self.weights, self.biases)
        )
        return Network(weights, biases)


@dc.dataclass(frozen=True, kw_only=True)
class CloningConfig:
    """Hyperparameters of behaviour cloning."""

    hidden: tuple[int, ...] = (256, 256)
    rate: float = 1e-3  # of Adam, at first
    decay: float = 1e-2  # of its weights
    batch: int = 256
    # Least number of gradient steps, and of passes over the samples. On the 80,000
    # samples of `pick_by_touch`, 16 passes leave twice the error of 64.
    updates: int = 5000
    passes: float = 64.0
    # Larger actions are clipped to this, because tanh reaches 1 only at infinity.
    most: float = 0.98


CLONING = CloningConfig()
# A quarter of the weights: each round of DAgger fits a new network to all data.
DAGGER = CloningConfig(hidden=(128, 128))


def clone(
    x: Array, actions: Array, rng: Generator, config: CloningConfig = CLONING
) -> Network:
    """Fit a network to demonstrations; the tanh of its output is the action.

    The learning rate falls linearly to zero. At a constant rate, the quality of the
    network would depend on the last few batches.

    Args:
        x: Scaled observations, shape (samples, n).
        actions: Actions taken, shape (samples, m), each in -1 .. 1.
        rng: For all draws.
        config: Hyperparameters.
    """
    seen, target = _tensor(x), _tensor(np.clip(actions, -config.most, config.most))
    sizes = (x.shape[1], *config.hidden, actions.shape[1])
    perceptron = Perceptrons(sizes, rng)
    optimizer = AdamW(
        perceptron.parameters(), lr=config.rate, weight_decay=config.decay
    )
    updates = max(config.updates, round(config.passes * len(x) / config.batch))
    schedule = LinearLR(optimizer, 1.0, 0.0, updates)
    for _ in range(updates):
        chosen = torch.from_numpy(rng.integers(len(x), size=config.batch))
        action = torch.tanh(perceptron(seen[None, chosen])[0])
        loss = ((action - target[chosen]) ** 2).sum(dim=1).mean()
        _descend(optimizer, loss)
        schedule.step()
    return perceptron.network()


class _Rounds:
    """Base class of learners that learn after each episode and save one checkpoint."""

    def __init__(self, env: Any, run: int) -> None:
        self.steps, self.episodes, self.round_steps = 0, 0, 250
        self._env, self._run = env, run
        space = env.observation_space
        self._low, self._high = space.low, space.high
        self._rng = default_rng(run)

    def advance(self, steps: int) -> list[bool]:
        """Run at least a number of steps; return the success of each episode."""
        end, done = self.steps + steps, []
        while self.steps < end:
            seed = training_seed(self._run, self.episodes)
            episode = run_episode(self._env, self._act, seed)
            self.steps += len(episode.actions)
            self.episodes += 1
            self._learn(episode)
            done.append(episode.success)
        return done

    def _scaled(self, observation: Array) -> Array:
        return scaled(observation, self._low, self._high)

    def _act(self, observation: Array) -> Array:
        raise NotImplementedError

    def _learn(self, episode: Episode) -> None:
        raise NotImplementedError

    def _state(self) -> dict[str, Any]:
        raise NotImplementedError

    def _restore(self, state: Mapping[str, Any]) -> None:
        raise NotImplementedError

    def save(self, folder: Path) -> None:
        """Write the state that `restore` reads."""
        counts = {"steps": self.steps, "episodes": self.episodes}
        draws = {"rng": json.dumps(self._rng.bit_generator.state)}
        file = io.BytesIO()
        torch.save(self._state() | counts | draws, file)
        write_file(folder / CHECKPOINT, file.getvalue())

    def restore(self, folder: Path) -> None:
        """Continue from the files of `save`."""
        path = folder / CHECKPOINT
        try:
            state = torch.load(path, weights_only=True)  # runs no code of the file
            self.steps, self.episodes = state["steps"], state["episodes"]
            self._rng.bit_generator.state = json.loads(state["rng"])
            self._restore(state)
        except Exception as error:  # damaged archives raise a dozen kinds
            raise ScenarioError(
                f"{path}: --resume: cannot be read: {one_line(error)}"
            ) from None


@dc.dataclass(frozen=True, kw_only=True)
class QConfig:
    """Hyperparameters of `QRounds`, chosen on the one-shot grasp's training seeds."""

    members: int = 5
    hidden: tuple[int, ...] = (128, 128)
    rate: float = 1e-3  # of Adam
    decay: float = 1e-2  # of its weights: it keeps them smooth between few episodes
    batch: int = 256
    # Gradient steps per episode, and episodes with random actions at first.
    updates: int = 4
    warm_up: int = 100
    # Share of later episodes with random actions.
    random: float = 0.05


Q = QConfig()


class QRounds(_Rounds):
    """Learns an ensemble of action values, for one-step episodes.

    Each network predicts the reward of an action. The next action to try is the best
    one according to a randomly chosen network (bootstrapped exploration: Osband et al.,
    NeurIPS 2016). Episodes have one step, so no value of a next state is needed. The
    DQN of Stable-Baselines3 would need discrete actions.
    """

    def __init__(self, env: Any, run: int, config: QConfig = Q) -> None:
        super().__init__(env, run)
        self._config, self._actions = config, env.action_space.shape[0]
        sizes = (env.observation_space.shape[0] + self._actions, *config.hidden, 1)
        self._perceptrons = Perceptrons(sizes, self._rng, config.members)
        self._optimizer = AdamW(
            self._perceptrons.parameters(), lr=config.rate, weight_decay=config.decay
        )
        self._inputs: list[Array] = []
        self._rewards: list[float] = []

    def _act(self, observation: Array) -> Array:
        """Return the action to try."""
        few = len(self._inputs) < self._config.warm_up
        if few or self._rng.random() < self._config.random:
            return self._rng.uniform(-1.0, 1.0, self._actions).astype(np.float32)
        member = int(self._rng.integers(self._config.members))
        network = self._perceptrons.network().member(member)
        seed = int(self._rng.integers(2**31))
        return best_action(network, self._scaled(observation), self._actions, seed=seed)

    def _learn(self, episode: Episode) -> None:
        if len(episode.actions) != 1:
            raise ScenarioError(
                "--algo q: needs episodes of one step, such as those of GraspOneShot "
                "(allowed here: sac, bc, dagger)"
            )
        x = self._scaled(episode.observations[0])
        self._inputs.append(np.concatenate([x, episode.actions[0]]))
        self._rewards.append(float(episode.rewards[0]))
        if len(self._inputs) < self._config.warm_up:
            return
        inputs, rewards = _tensor(self._inputs), _tensor(self._rewards)
        for _ in range(self._config.updates):
            # Each member gets its own samples.
            shape = (self._config.members, self._config.batch)
            chosen = torch.from_numpy(self._rng.integers(len(inputs), size=shape))
            off = self._perceptrons(inputs[chosen])[..., 0] - rewards[chosen]
            _descend(self._optimizer, (off**2).mean(dim=1).sum())

    def policy(self) -> tuple[Kind, Network]:
        """Return the present policy: its kind and its network."""
        return "q", self._perceptrons.network()

    def _state(self) -> dict[str, Any]:
        return {
            "inputs": _tensor(self._inputs),
            "rewards": _tensor(self._rewards),
            "perceptrons": self._perceptrons.state_dict(),
            "optimizer": self._optimizer.state_dict(),
        }

    def _restore(self, state: Mapping[str, Any]) -> None:
        self._inputs = list(state["inputs"].numpy())
        self._rewards = state["rewards"].tolist()
        self._perceptrons.load_state_dict(state["perceptrons"])
        self._optimizer.load_state_dict(state["optimizer"])


class CloningRounds(_Rounds):
    """Clones a hand-written rule, from episodes in which the rule succeeds."""

    def __init__(self, env: Any, run: int, rule: str = RULE) -> None:
        super().__init__(env, run)
        self.round_steps = sys.maxsize  # fitting takes longer than demonstrating
        self._rule = rule_of(env, rule)
        self._seen: list[Array] = []
        self._done: list[Array] = []

    def _act(self, observation: Array) -> Array:
        return self._rule(observation)

    def _learn(self, episode: Episode) -> None:
        if episode.success:
            self._seen.extend(self._scaled(episode.observations[:-1]))
            self._done.extend(episode.actions)

    def policy(self) -> tuple[Kind, Network]:
        """Return the present policy: its kind and its network."""
        if not self._seen:
            raise ScenarioError("--algo bc: no demonstration succeeded; add --steps")
        return "actor", self._fit(CLONING)

    def _fit(self, config: CloningConfig) -> Network:
        # A separate generator, so that the number of calls changes nothing.
        rng = default_rng([self._run, self.episodes])
        return clone(np.array(self._seen), np.array(self._done), rng, config)

    def _state(self) -> dict[str, Any]:
        return {"seen": _tensor(self._seen), "done": _tensor(self._done)}

    def _restore(self, state: Mapping[str, Any]) -> None:
        self._seen, self._done = (
            list(state["seen"].numpy()),
            list(state["done"].numpy()),
        )


class DataRounds(CloningRounds):
    """Clones the grasps of a data set; each grasp counts as one step and one episode.

    Args:
        env: The environment.
        run: Seed of training.
        data: Folder of the data set.
    """

    def __init__(self, env: Any, run: int, data: Path) -> None:
        super().__init__(env, run)
        self._shown = read_demonstrations(data, env)

    def advance(self, steps: int) -> list[bool]:
        """Take a number of demonstrations, or all that are left; see `Learner`."""
        new = self._shown[self.episodes : self.episodes + steps]
        self._seen.extend(self._scaled(x) for x, _ in new)
        self._done.extend(action for _, action in new)
        self.steps += steps
        self.episodes += len(new)
        return [True] * len(new)


class DaggerRounds(CloningRounds):
    """Dataset aggregation (Ross, Gordon and Bagnell, AISTATS 2011).

    In the first round, the hand-written rule acts. Later, the current policy acts, and
    the rule labels each visited state with its own action.
    """

    def __init__(self, env: Any, run: int, rule: str = RULE) -> None:
        super().__init__(env, run, rule)
        self.round_steps = 4000
        self._network: Network | None = None  # from the previous rounds

    def _act(self, observation: Array) -> Array:
        if self._network is None:
            return super()._act(observation)
        action: Array = np.tanh(self._network(self._scaled(observation)[None])[0, 0])
        return action

    def _learn(self, episode: Episode) -> None:
        for observation in episode.observations[:-1]:
            self._seen.append(self._scaled(observation))
            self._done.append(self._rule(observation))

    def policy(self) -> tuple[Kind, Network]:
        """Return the present policy: its kind and its network."""
        self._network = self._fit(DAGGER)
        return "actor", self._network

    def _restore(self, state: Mapping[str, Any]) -> None:
        super()._restore(state)
        self.policy()


_MODEL, _BUFFER, _COUNTS = "sac.zip", "replay.pkl", "counts.npz"
# Settings of soft actor-critic (Haarnoja et al., ICML 2018), except for learning rate
# and discount: these episodes have a few dozen steps and end in one reward.
SAC_OPTIONS = {
    "learning_rate": 1e-3,
    "gamma": 0.98,
    "batch_size": 256,
    "learning_starts": 500,
    "buffer_size": 200_000,
}
_SAC_HIDDEN = [256, 256]


class SacRounds:
    """Soft actor-critic by Stable-Baselines3."""

    def __init__(self, env: Any, run: int) -> None:
        self.steps, self.episodes, self.round_steps = 0, 0, 1000
        self.run = run
        self._env = _Seeded(env, self)
        self._model = SAC(
            "MlpPolicy",
            _scaled(self._env),
            seed=run,
            device="cpu",
            policy_kwargs={"net_arch": _SAC_HIDDEN},
            **SAC_OPTIONS,
        )
        self.done: list[bool] = []

    def advance(self, steps: int) -> list[bool]:
        """Run at least a number of steps; return the success of each episode."""
        self.done = []
        begun = self._model.num_timesteps == 0
        # Validation has used the environment since, so a new episode must begin.
        self._model.set_env(self._model.get_env(), force_reset=True)
        self._model.learn(steps, reset_num_timesteps=begun)
        self.steps = int(self._model.num_timesteps)
        return self.done

    def policy(self) -> tuple[Kind, Network]:
        """Return the actor's mean as a network."""
        actor = self._model.policy.actor
        layers = [*actor.latent_pi, actor.mu]
        arrays = [
            (
                layer.weight.detach().numpy().T[None],
                layer.bias.detach().numpy()[None, None],
            )
            for layer in layers
            if hasattr(layer, "weight")
        ]
        weights, biases = zip(*arrays, strict=True)
        return "actor", Network(
            [np.array(w, np.float32) for w in weights],
            [np.array(b, np.float32) for b in biases],
        )

    def save(self, folder: Path) -> None:
        """Write the model and the replay buffer, a pickle of Stable-Baselines3.

        The files replace the previous ones once all of them are complete.
        """
        model, buffer, counts = (
            OutputFile(folder / name) for name in (_MODEL, _BUFFER, _COUNTS)
        )
        self._model.save(model.path)
        self._model.save_replay_buffer(buffer.path)
        np.savez(counts.path, episodes=self.episodes)
        for file in (model, buffer, counts):
            file.commit()

    def restore(self, folder: Path) -> None:
        """Continue from the files of `save`; pickles run code, so trust them first.

        Raises:
            ScenarioError: If the files are missing or broken.
        """
        try:
            self._model = SAC.load(
                folder / _MODEL, env=_scaled(self._env), device="cpu"
            )
            self._model.load_replay_buffer(folder / _BUFFER)
            with np.load(folder / _COUNTS) as counts:
                self.episodes = int(counts["episodes"])
        except Exception as error:  # unpickling may raise anything
            raise ScenarioError(
                f"{folder}: --resume: cannot be read: {one_line(error)}"
            ) from None
        self.steps = int(self._model.num_timesteps)


class _Seeded(gymnasium.Wrapper):
    """An environment that takes its seeds from a learner and reports episodes to it."""

    def __init__(self, env: Any, learner: SacRounds) -> None:
        super().__init__(env)
        self._learner = learner

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        """Begin the learner's next episode; its seed replaces `seed`."""
        wanted = training_seed(self._learner.run, self._learner.episodes)
        return self.env.reset(seed=wanted, options=options)

    def step(self, action: Any) -> Any:
        """Take a step, and report ended episodes to the learner."""
        result = self.env.step(action)
        if result[2] or result[3]:
            self._learner.episodes += 1
            self._learner.done.append(bool(result[4].get("success", False)))
        return result


def _scaled(env: Any) -> Any:
    """Return an environment whose observations are scaled as a `Policy` scales them."""
    return gymnasium.wrappers.RescaleObservation(env, np.float32(-1.0), np.float32(1.0))


def _descend(optimizer: AdamW, loss: Tensor) -> None:
    """Take one gradient step that reduces a loss."""
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


def _tensor(values: Any) -> Tensor:
    return torch.from_numpy(np.array(values, np.float32))
