"""Learns which action succeeds: an ensemble of value networks, for one-step episodes.

Each network predicts the reward of an action. The next action to try is the best one of
a network drawn at random (Osband et al., NeurIPS 2016: bootstrapped exploration). With
one step an episode, no value of a next state is needed.
"""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np
from numpy.random import Generator

from drake_srg.learning.cross_entropy import best_action
from drake_srg.learning.network import Adam, Array, Network


@dc.dataclass(frozen=True, kw_only=True)
class QConfig:
    """Numbers of the learner, chosen on the one-shot grasp's training seeds."""

    members: int = 5
    hidden: tuple[int, ...] = (128, 128)
    rate: float = 1e-3  # of Adam
    decay: float = 1e-2  # of its weights
    batch: int = 256
    # Gradient steps per episode, and episodes with random actions at first.
    updates: int = 4
    warm_up: int = 100
    # Share of later episodes with random actions.
    random: float = 0.05


class QLearner:
    """Chooses actions and learns from their rewards.

    Args:
        observations: Number of entries of an observation.
        actions: Number of entries of an action.
        rng: For all draws.
        config: Numbers; None for the defaults.
    """

    def __init__(
        self,
        observations: int,
        actions: int,
        rng: Generator,
        config: QConfig | None = None,
    ) -> None:
        self._config, self._rng = config or QConfig(), rng
        self._actions = actions
        sizes = (observations + actions, *self._config.hidden, 1)
        self.network = Network.random(sizes, rng, self._config.members)
        self._adam = Adam(
            self.network.parameters, self._config.rate, self._config.decay
        )
        self._inputs: list[Array] = []
        self._rewards: list[float] = []

    def explore(self, x: Array) -> Array:
        """Return the action to try for a scaled observation (n,)."""
        few = len(self._inputs) < self._config.warm_up
        if few or self._rng.random() < self._config.random:
            return self._rng.uniform(-1.0, 1.0, self._actions).astype(np.float32)
        member = self.network.member(int(self._rng.integers(self.network.members)))
        seed = int(self._rng.integers(2**31))
        return best_action(member, x, self._actions, seed=seed)

    def learn(self, x: Array, action: Array, reward: float) -> float:
        """Remember what an action gave, and learn from all that was remembered.

        Args:
            x: Scaled observation, shape (n,).
            action: Shape (actions,).
            reward: What it gave.

        Returns:
            The mean square error of the predictions.
        """
        self._inputs.append(np.concatenate([x, action]).astype(np.float32))
        self._rewards.append(reward)
        if len(self._inputs) < self._config.warm_up:
            return float("nan")
        inputs, rewards = np.array(self._inputs), np.array(self._rewards, np.float32)
        error = float("nan")
        for _ in range(self._config.updates):
            # Members see samples of their own.
            shape = (self.network.members, self._config.batch)
            chosen = self._rng.integers(len(inputs), size=shape)
            layers = self.network.layers(inputs[chosen])
            off = layers[-1] - rewards[chosen][..., None]
            slope = 2.0 * off / self._config.batch
            self._adam.step(self.network.gradients(layers, slope))
            error = float(np.mean(off**2))
        return error

    def state(self) -> dict[str, Any]:
        """Return all that `restore` needs, as arrays by name."""
        arrays = {
            "inputs": np.array(self._inputs, np.float32),
            "rewards": np.array(self._rewards, np.float32),
            "adam_steps": np.array(self._adam.steps),
        }
        for name, values in self._learned().items():
            arrays |= {f"{name}_{k}": value for k, value in enumerate(values)}
        return arrays

    def restore(self, arrays: dict[str, Any]) -> None:
        """Go on from a `state`.

        Raises:
            KeyError: If an array is missing.
            ValueError: If a size does not fit.
        """
        self._inputs = list(arrays["inputs"])
        self._rewards = [float(r) for r in arrays["rewards"]]
        self._adam.steps = int(arrays["adam_steps"])
        for name, values in self._learned().items():
            for k, value in enumerate(values):
                value[...] = arrays[f"{name}_{k}"]

    def _learned(self) -> dict[str, list[Array]]:
        return {
            "parameter": self.network.parameters,
            "mean": self._adam.means,
            "square": self._adam.squares,
        }
