"""Multilayer perceptrons in NumPy, several of the same size at once."""

from __future__ import annotations

import dataclasses as dc
import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from numpy.random import Generator

Array = npt.NDArray[np.floating]

# Adam's own recommendations (Kingma and Ba, ICLR 2015).
_DECAY, _SQUARE_DECAY, _TINY = 0.9, 0.999, 1e-8


@dc.dataclass(frozen=True, eq=False)
class Network:
    """An ensemble of perceptrons with ReLU between linear layers.

    Attributes:
        weights: Of each layer, shape (members, inputs, outputs).
        biases: Of each layer, shape (members, 1, outputs).
    """

    weights: list[Array]
    biases: list[Array]

    @classmethod
    def random(cls, sizes: Sequence[int], rng: Generator, members: int = 1) -> Network:
        """Return networks with random weights (He et al., ICCV 2015).

        Args:
            sizes: Of the input, the hidden layers and the output.
            rng: For the draws.
            members: Of the ensemble.
        """
        weights = []
        for inputs, outputs in itertools.pairwise(sizes):
            scale = np.sqrt(2.0 / inputs)
            drawn = scale * rng.normal(size=(members, inputs, outputs))
            weights.append(drawn.astype(np.float32))
        return cls(weights, [np.zeros((members, 1, n), np.float32) for n in sizes[1:]])

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

    def copy(self) -> Network:
        """Return an independent copy."""
        return Network(
            [w.copy() for w in self.weights], [b.copy() for b in self.biases]
        )

    def __call__(self, x: Array) -> Array:
        """Return the outputs (members, n, outputs) for inputs (n, inputs)."""
        return self.layers(x)[-1]

    def layers(self, x: Array) -> list[Array]:
        """Return the input and the output of every layer.

        Args:
            x: Shape (n, inputs) for all, or (members, n, inputs).
        """
        values = [x]
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            y = values[-1] @ weight + bias
            values.append(y if k == last else np.maximum(y, 0.0))
        return values

    def gradients(self, layers: Sequence[Array], slope: Array) -> list[Array]:
        """Return the gradients of a loss, in the order of `parameters`.

        Args:
            layers: From `layers`, of inputs with shape (members, n, inputs).
            slope: Derivatives of the loss by the outputs (members, n, outputs).
        """
        weights: list[Array] = []
        biases: list[Array] = []
        for k in reversed(range(len(self.weights))):
            weights.append(layers[k].swapaxes(1, 2) @ slope)
            biases.append(slope.sum(axis=1, keepdims=True))
            if k:
                slope = (slope @ self.weights[k].swapaxes(1, 2)) * (layers[k] > 0.0)
        return [*weights[::-1], *biases[::-1]]


class Adam:
    """Changes parameters against their gradients (Kingma and Ba, ICLR 2015).

    Args:
        parameters: Arrays, changed in place.
        rate: Of learning; the attribute may change between steps.
        decay: Weight decay per unit of learning rate (Loshchilov and Hutter, ICLR
            2019); it keeps the networks smooth between few episodes.
    """

    def __init__(
        self, parameters: Sequence[Array], rate: float = 1e-3, decay: float = 0.0
    ) -> None:
        self._parameters, self.rate, self._decay = list(parameters), rate, decay
        self.steps = 0
        self.means = [np.zeros_like(p) for p in self._parameters]
        self.squares = [np.zeros_like(p) for p in self._parameters]

    def step(self, gradients: Sequence[Array]) -> None:
        """Change the parameters once."""
        self.steps += 1
        size = self.rate * np.sqrt(1.0 - _SQUARE_DECAY**self.steps)
        size /= 1.0 - _DECAY**self.steps
        for p, g, mean, square in zip(
            self._parameters, gradients, self.means, self.squares, strict=True
        ):
            mean[...] += (1.0 - _DECAY) * (g - mean)
            square[...] += (1.0 - _SQUARE_DECAY) * (g * g - square)
            change = size * mean / (np.sqrt(square) + _TINY)
            p[...] -= change + self.rate * self._decay * p
