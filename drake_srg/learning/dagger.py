"""Behaviour cloning that also learns from its own mistakes (algorithm `dagger`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import default_rng

from drake_srg.learning.baselines import RULE
from drake_srg.learning.cloning import CloningConfig, clone
from drake_srg.learning.episodes import Episode
from drake_srg.learning.learners import CloningRounds
from drake_srg.learning.network import Array, Network
from drake_srg.learning.policy import Kind

# A quarter of the weights that `bc` has: rounds are fitted anew, each on all data.
_CONFIG = CloningConfig(hidden=(128, 128))


class DaggerRounds(CloningRounds):
    """Dataset aggregation (Ross, Gordon and Bagnell, AISTATS 2011).

    In the first round, the hand-written rule acts. Later, the policy so far acts, and
    the rule says what it would have done in each state that the policy came to.
    """

    def __init__(self, env: Any, run: int, rule: str = RULE) -> None:
        super().__init__(env, run, rule)
        self.round_steps = 4000
        self._network: Network | None = None  # of the rounds before this one

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
        """See `Learner`."""
        rng = default_rng([self._run, self.episodes])
        seen, done = np.array(self._seen), np.array(self._done)
        self._network, _ = clone(seen, done, rng, _CONFIG)
        return "actor", self._network

    def _restore(self, arrays: Mapping[str, Any]) -> None:
        super()._restore(arrays)
        self.policy()
