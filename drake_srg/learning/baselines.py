"""Policies without a file: random actions, and rules written by hand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import default_rng

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import Act
from drake_srg.learning.network import Array
from drake_srg.learning.rules import RULES
from drake_srg.learning.touch_rule import TOUCH_RULES

RANDOM, RULE, TOUCH = "random", "rule", "touch"
# What every policy is compared with, and all that need no file.
BASELINES = (RULE, RANDOM)
BUILT_IN = (RULE, TOUCH, RANDOM)
_RULES: dict[str, Mapping[str, Act]] = {RULE: RULES, TOUCH: TOUCH_RULES}
RULE_NAMES = tuple(_RULES)


def random_policy(actions: int, seed: int) -> Act:
    """Return a policy whose actions depend on the seed alone."""
    # The environment draws from `seed` itself: the same numbers would hit its targets.
    rng = default_rng([seed, 1])

    def act(_: Array) -> Array:
        return rng.uniform(-1.0, 1.0, actions).astype(np.float32)

    return act


def rule_of(env: Any, rule: str = RULE) -> Act:
    """Return a hand-written policy of an environment.

    Args:
        env: The environment. Somebody else's may have its rule as the method `rule`.
        rule: `rule`, or `touch` for the one that finds objects by touch.

    Raises:
        ScenarioError: If it has none.
    """
    name = env.spec.id if env.spec else type(env).__name__
    found = named_rule(name, rule)
    if found is None and rule == RULE:
        found = getattr(env.unwrapped, "rule", None)
    if found is None:
        which = "rule" if rule == RULE else f"rule `{rule}`"
        raise ScenarioError(f"ENV: {name}: has no hand-written {which}")
    return found


def named_rule(environment: str, rule: str) -> Act | None:
    """Return a hand-written policy of one of our environments, None without one."""
    return _RULES[rule].get(environment)
