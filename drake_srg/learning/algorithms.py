"""The learners by the name of their algorithm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.baselines import RULE
from drake_srg.learning.dagger import DaggerRounds
from drake_srg.learning.learners import CloningRounds, DataRounds, Learner, QRounds
from drake_srg.learning.sac import SacRounds


def MakeLearner(
    algorithm: str, env: Any, run: int, data: str = "", rule: str = RULE
) -> Learner:
    """Make the learner of an algorithm.

    Args:
        algorithm: `q`, `sac`, `bc` or `dagger`.
        env: The environment.
        run: Seed of training.
        data: Folder of a data set, for `bc`; "" for a hand-written rule.
        rule: Which one `bc` and `dagger` imitate; see `baselines.rule_of`.

    Raises:
        ScenarioError: If the algorithm does not fit the environment, or `data` does not
            fit either.
        ImportError: If `sac` lacks its packages.
    """
    if data and algorithm != "bc":
        raise ScenarioError(f"--data: needs --algo bc, got {algorithm}")
    if rule != RULE and algorithm not in ("bc", "dagger"):
        raise ScenarioError(
            f"--rule {rule}: needs --algo bc or dagger, got {algorithm}"
        )
    if rule != RULE and data:
        raise ScenarioError(f"--rule {rule}: imitates no --data; give one of the two")
    if algorithm == "q":
        return QRounds(env, run)
    if algorithm == "bc" and data:
        return DataRounds(env, run, Path(data))
    if algorithm == "bc":
        return CloningRounds(env, run, rule)
    if algorithm == "dagger":
        return DaggerRounds(env, run, rule)
    return SacRounds(env, run)
