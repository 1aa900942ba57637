"""The action that networks think best."""

from __future__ import annotations

import numpy as np
from numpy.random import default_rng

from drake_srg.learning.network import Array, Network

# The cross-entropy method (Rubinstein, 1999), as QT-Opt uses it for grasps (Kalashnikov
# et al., CoRL 2018): rounds, actions in each, the best of which shape the next.
_ROUNDS, _TRIED, _BEST = 3, 64, 6
# How many standard deviations between the members count against an action.
_CAUTION = 0.5


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
