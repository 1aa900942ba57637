"""Behaviour cloning: a network that imitates demonstrated actions (algorithm `bc`)."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from numpy.random import Generator

from drake_srg.learning.network import Adam, Array, Network


@dc.dataclass(frozen=True, kw_only=True)
class CloningConfig:
    """Numbers of the learner."""

    hidden: tuple[int, ...] = (256, 256)
    rate: float = 1e-3  # of Adam, at first
    decay: float = 1e-2  # of its weights
    batch: int = 256
    # Gradient steps: so many at least, and so many passes over the samples. At 16
    # passes over 80,000 of `pick_by_touch`, the error is twice that of 64.
    updates: int = 5000
    passes: float = 64.0
    # Largest action that is imitated: tanh reaches 1 only at infinity.
    most: float = 0.98


def clone(
    x: Array,
    actions: Array,
    rng: Generator,
    config: CloningConfig | None = None,
) -> tuple[Network, float]:
    """Fit a network, the tanh of which is the action, to demonstrations.

    The rate falls evenly to zero. At a constant rate, the last batches shake the
    network to the end, and which step it stops at decides how well it acts.

    Args:
        x: Scaled observations, shape (samples, n).
        actions: What was done, shape (samples, m), each in -1 .. 1.
        rng: For all draws.
        config: Numbers; None for the defaults.

    Returns:
        The network, and its mean square error over all samples.
    """
    config = config or CloningConfig()
    target = np.clip(actions, -config.most, config.most).astype(np.float32)
    network = Network.random((x.shape[1], *config.hidden, actions.shape[1]), rng)
    adam = Adam(network.parameters, config.rate, config.decay)
    updates = max(config.updates, round(config.passes * len(x) / config.batch))
    for k in range(updates):
        adam.rate = config.rate * (1.0 - k / updates)
        chosen = rng.integers(len(x), size=config.batch)
        layers = network.layers(x[chosen][None])
        action = np.tanh(layers[-1])
        slope = 2.0 * (action - target[chosen]) * (1.0 - action**2) / config.batch
        adam.step(network.gradients(layers, slope))
    error = float(np.mean((np.tanh(network(x)[0]) - target) ** 2))
    return network, error
