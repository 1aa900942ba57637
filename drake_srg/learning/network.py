"""Multilayer perceptrons that act, in NumPy, and the action that they think best."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import numpy.typing as npt
from numpy.random import default_rng

Array = npt.NDArray[np.floating]

# The cross-entropy method (Rubinstein, 1999), as QT-Opt uses it for grasps (Kalashnikov
# et al., CoRL 2018): rounds, actions in each, the best of which shape the next.
_ROUNDS, _TRIED, _BEST = 3, 64, 6
# How many standard deviations between the members count against an action.
_CAUTION = 0.5


@dc.dataclass(frozen=True, eq=False)
class Network:
    """An ensemble of perceptrons with ReLU between linear layers.

    Attributes:
        weights: Of each layer, shape (members, inputs, outputs).
        biases: Of each layer, shape (members, 1, outputs).
    """

    weights: list[Array]
    biases: list[Array]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Sizes of the input, the hidden layers and the output."""
        return (self.weights[0].shape[1], *(w.shape[2] for w in self.weights))

    @property
    def members(self) -> int:
        """Number of networks."""
        return int(self.weights[0].shape[0])

    @property
    def parameters(self) -> list[Array]:
        """All weights and biases: the arrays themselves."""
        return [*self.weights, *self.biases]

    def member(self, index: int) -> Network:
        """Return one of the networks, which shares its parameters with this one."""
        one = slice(index, index + 1)
        return Network([w[one] for w in self.weights], [b[one] for b in self.biases])

    def __call__(self, x: Array) -> Array:
        """Return the outputs, shape (members, n, outputs).

        Args:
            x: Shape (n, inputs) for all, or (members, n, inputs).
        """
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = x @ weight + bias
            if k < last:
                x = np.maximum(x, 0.0)
        return x


def best_action(
    network: Network,
    x: Array,
    actions: int,
    *,
    caution: float = _CAUTION,
    seed: int = 0,
) -> Array:
    """Return the action to which networks give the greatest value.

    The same arguments give the same action.

    Args:
        network: Judges (observation, action); several judge by their mean.
        x: Scaled observation, shape (n,).
        actions: Number of entries of an action.
        caution: How many standard deviations between members count against an action.
        seed: Of the search.

    Returns:
        Shape (actions,), each in -1 .. 1.
    """
    rng = default_rng(seed)
    mean, spread = np.zeros(actions), np.ones(actions)
    tried = rng.uniform(-1.0, 1.0, size=(4 * _TRIED, actions))
    for _ in range(_ROUNDS):
        inputs = np.concatenate([np.broadcast_to(x, (len(tried), len(x))), tried], 1)
        values = network(inputs.astype(np.float32))[:, :, 0]
        value = values.mean(axis=0) - caution * values.std(axis=0)
        best = tried[np.argsort(-value, kind="stable")[:_BEST]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02
        drawn = mean + spread * rng.normal(size=(_TRIED, actions))
        tried = np.clip(np.concatenate([best, drawn]), -1.0, 1.0)
    return np.asarray(best[0], np.float32)
