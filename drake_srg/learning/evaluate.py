"""Evaluation of a policy in episodes that were not used in its training.

DIR/policy/     a sweep's folder with the policy's rows; see `drake_srg.sweeps.rows`
DIR/rule/       the same for the hand-written rule
DIR/random/     the same for random actions
"""

from __future__ import annotations

import functools
import json
import os
import socket
import time as wall
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.learning.episodes import (
    EVALUATION,
    Act,
    environment_id,
    make_environment,
    run_episode,
)
from drake_srg.learning.policy import Policy, check_sizes, load_policy, policy_digest
from drake_srg.learning.rules import BUILT_IN, RANDOM, random_policy, rule_of
from drake_srg.sweeps.engines import Engine
from drake_srg.sweeps.info import hash_files
from drake_srg.sweeps.sweep import run_missing_trials, sweep_info
from drake_srg.sweeps.trial import TrialResult, empty_row, resident_memory

_MOST_SEED = 2**63  # rows have 64-bit integers


def evaluate(
    policy: str,
    environment: str,
    trials: int,
    *,
    out: Path,
    engine: Engine,
    seed: int = EVALUATION,
    keywords: Mapping[str, Any] | None = None,
    resume: bool = False,
    progress: bool = False,
    tell: Callable[[str], None] = print,
) -> Any:
    """Run a policy in episodes of an environment, each exactly once.

    Args:
        policy: A policy's file or name, or one of `BUILT_IN`.
        environment: Id of the environment.
        trials: Number of episodes.
        out: Folder of the rows, as of a sweep.
        engine: Runs the episodes; entered here.
        seed: Seed of the first episode, at least `EVALUATION`: training uses lower
            ones.
        keywords: Keyword arguments of the environment, which override those of the
            policy's training.
        resume: Whether `out` may contain episodes of this evaluation.
        progress: Whether to show progress on standard error.
        tell: Receives warnings, one line each.

    Returns:
        All rows, a pyarrow.Table.

    Raises:
        ScenarioError: For bad input, before any episode runs.
        OSError: If the folder cannot be written.
        ImportError: If a package is missing.
    """
    check_seeds(trials, seed)
    environment = environment_id(environment)
    keywords = dict(keywords or {})
    # A sweep's versions do not include this folder.
    content = {"learning_sources": hash_files({"": Path(__file__).parent})}
    if policy not in BUILT_IN:
        content["policy_sha256"] = policy_digest(policy)
        info = load_policy(policy).info
        if info.environment != environment:
            raise ScenarioError(
                f"{policy}: is a policy for {info.environment}, not for {environment}"
            )
        keywords = {**info.keywords, **keywords}
    # Mistakes fail here, not in every episode.
    plain = json.dumps(keywords, sort_keys=True)
    _actor(policy, environment, plain, seed)
    overrides = [f"{key}={json.dumps(value)}" for key, value in keywords.items()]
    tree = {"environment": environment, **content, **keywords}
    sweep = sweep_info(
        environment, trials, seed, engine, overrides, tree, policy=policy
    )

    def lost(trial: int, reason: str) -> TrialResult:
        return TrialResult(empty_row(seed, trial, reason))

    def submit(trial: int) -> Future[TrialResult]:
        return engine.submit(run_trial, policy, environment, plain, seed, trial)

    return run_missing_trials(
        sweep,
        engine,
        submit,
        lost,
        out=out,
        resume=resume,
        progress=progress,
        tell=tell,
        noun="episodes",
    )


def check_seeds(trials: int, seed: int) -> None:
    """Check the number of trials, and the seed of the first trial.

    Raises:
        ScenarioError: If an argument is out of range.
    """
    if trials < 1:
        raise ScenarioError(f"--trials {trials}: must be at least 1")
    if seed < EVALUATION:
        raise ScenarioError(
            f"--seed {seed}: must be at least {EVALUATION}; training uses lower seeds"
        )
    if seed > _MOST_SEED - trials:
        raise ScenarioError(f"--seed {seed}: must be at most {_MOST_SEED - trials}")


def run_trial(
    policy: str, environment: str, keywords: str, seed: int, trial: int
) -> TrialResult:
    """Run one episode; an error counts as an outcome. `keywords` are JSON."""
    start = wall.perf_counter()
    row = empty_row(seed, trial, "")
    try:
        env, act = _actor(policy, environment, keywords, seed + trial)
        episode = run_episode(env, act, seed + trial)
        row |= {
            "success": episode.success,
            "failure": None if episode.success else episode.failure or "no_grasp",
            "message": None,
            "episode.steps": len(episode.actions),
            "episode.return": float(episode.rewards.sum()),
        }
        row |= dict(_leaves("scene", episode.scene))
    except Exception as error:
        row["message"] = f"{type(error).__name__}: {one_line(error)}"
    row["trial_time_s"] = wall.perf_counter() - start
    row["memory_mb"] = resident_memory()
    row["worker"] = f"{socket.gethostname()}:{os.getpid()}"
    return TrialResult(row)


def _leaves(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the numbers and words of a scene with dotted keys, as columns of a row."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _leaves(f"{key}.{name}", inner)
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from _leaves(f"{key}[{index}]", inner)
    elif isinstance(value, bool | int | float | str):
        yield key, float(value) if isinstance(value, int) else value


def _actor(policy: str, environment: str, keywords: str, seed: int) -> tuple[Any, Act]:
    """Return the environment, and a policy that fits it."""
    env = _environment(environment, keywords)
    if policy == RANDOM:
        return env, random_policy(env.action_space.shape[0], seed)
    if policy in BUILT_IN:
        return env, rule_of(env, policy)
    loaded = latest_policy(policy)
    observations, actions = env.observation_space.shape[0], env.action_space.shape[0]
    check_sizes(policy, loaded, observations, actions)
    return env, loaded


@functools.lru_cache(maxsize=1)
def _environment(name: str, keywords: str) -> Any:
    return make_environment(name, json.loads(keywords))


@functools.lru_cache(maxsize=1)
def latest_policy(name: str) -> Policy:
    """Return a policy; cached, so that a worker reads the file once."""
    return load_policy(name)
