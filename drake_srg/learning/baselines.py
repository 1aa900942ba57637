"""What a policy must beat: random actions, and a rule written by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import default_rng

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import Act
from drake_srg.learning.network import Array
from drake_srg.learning.rules import RULES

RANDOM, RULE = "random", "rule"
BASELINES = (RULE, RANDOM)


def random_policy(actions: int, seed: int) -> Act:
    """Return a policy whose actions depend on the seed alone."""
    # The environment draws from `seed` itself: the same numbers would hit its targets.
    rng = default_rng([seed, 1])

    def act(_: Array) -> Array:
        return rng.uniform(-1.0, 1.0, actions).astype(np.float32)

    return act


def rule_of(env: Any) -> Act:
    """Return the hand-written policy of an environment.

    It is one of `rules.RULES`, or the method `rule` of somebody else's environment.

    Raises:
        ScenarioError: If it has none.
    """
    name = env.spec.id if env.spec else type(env).__name__
    rule: Act | None = RULES.get(name) or getattr(env.unwrapped, "rule", None)
    if rule is None:
        raise ScenarioError(f"ENV: {name}: has no hand-written rule")
    return rule
