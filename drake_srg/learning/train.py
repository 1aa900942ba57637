"""Trains a policy, and keeps the latest of the best ones.

DIR/policy.npz       the policy, chosen by validation episodes
DIR/policy.onnx      the same for other programs, with the extra `learn`
DIR/training.json    what is trained, and how it went
DIR/events.*         the same for TensorBoard
DIR/checkpoint.npz   for --resume
"""

from __future__ import annotations

import dataclasses as dc
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.status_line import StatusLine
from drake_srg.learning.algorithms import MakeLearner
from drake_srg.learning.baselines import RULE, RULE_NAMES
from drake_srg.learning.episodes import (
    VALIDATION,
    environment_id,
    make_environment,
    run_episode,
    training_seed,
)
from drake_srg.learning.event_log import EventLog
from drake_srg.learning.learners import Learner
from drake_srg.learning.onnx_file import can_write_onnx, write_onnx
from drake_srg.learning.policy import Policy, PolicyInfo, check_sizes, load_policy
from drake_srg.sweeps.files import write_file

ALGORITHMS = ("q", "sac", "bc", "dagger")
POLICY, ONNX, LOG = "policy.npz", "policy.onnx", "training.json"
_RECENT = 100  # episodes of the success rate that is shown


@dc.dataclass(frozen=True, kw_only=True)
class Training:
    """What is trained.

    Attributes:
        environment: Id of the environment.
        keywords: Of the environment.
        algorithm: One of `ALGORITHMS`.
        steps: Of the environment, in all.
        seed: Of all draws.
        validation: Episodes that judge a policy.
        command: The line that trains it, for the policy's file.
        data: Folder of a data set of demonstrations, or "".
        rule: Which hand-written rule `bc` and `dagger` imitate; see `baselines`.
    """

    environment: str
    keywords: Mapping[str, Any] = dc.field(default_factory=dict)
    algorithm: str = "q"
    steps: int = 2000
    seed: int = 0
    validation: int = 50
    command: str = ""
    data: str = ""
    rule: str = RULE


def train(
    training: Training, out: Path, *, resume: bool = False, progress: bool = False
) -> Policy:
    """Train a policy, write it and return it.

    It is the latest that did not do worse in the validation episodes than the best, by
    more than their standard error: it has learned from more episodes, and smaller
    differences are chance. The same training gives the same policy, interrupted or not.

    Args:
        training: What to train.
        out: Folder of the files.
        resume: Whether `out` may contain this training, begun earlier.
        progress: Whether to show progress on standard error.

    Raises:
        ScenarioError: For bad input.
        OSError: If files cannot be written.
        ImportError: If a package is missing.
    """
    if training.algorithm not in ALGORITHMS:
        raise ScenarioError(
            f"--algo {training.algorithm}: unknown (allowed: {', '.join(ALGORITHMS)})"
        )
    if training.rule not in RULE_NAMES:
        allowed = ", ".join(RULE_NAMES)
        raise ScenarioError(f"--rule {training.rule}: unknown (allowed: {allowed})")
    if training.steps < 1:
        raise ScenarioError(f"--steps {training.steps}: must be at least 1")
    training_seed(training.seed, 0)
    training = dc.replace(training, environment=environment_id(training.environment))
    history = _begin(training, out, resume)
    env = make_environment(training.environment, training.keywords)
    learner = MakeLearner(
        training.algorithm, env, training.seed, training.data, training.rule
    )
    best: Policy | None = None
    if history:
        best = load_policy(out / POLICY)
        sizes = env.observation_space.shape[0], env.action_space.shape[0]
        check_sizes(str(out / POLICY), best, *sizes)
        learner.restore(out)
    # The networks are small: BLAS's threads would mostly wait for each other, in loops.
    one_thread = threadpool_limits(1, "blas")
    with one_thread, EventLog(out) as events, StatusLine(shown=progress) as line:
        recent: list[bool] = []
        while learner.steps < training.steps or best is None:
            left = min(learner.round_steps, training.steps - learner.steps)
            recent = (recent + learner.advance(max(left, 1)))[-_RECENT:]
            policy = trained_policy(learner, env, training)
            score = validate(policy, env, training.validation)
            policy = _scored(policy, learner.steps, score)
            rate = float(np.mean(recent)) if recent else 0.0
            history.append([learner.steps, learner.episodes, rate, score])
            highest = max(row[3] for row in history)
            if best is None or score >= _least(highest, training.validation):
                best = policy
                best.save(out / POLICY)
                if can_write_onnx(best):
                    write_onnx(best, out / ONNX)
            learner.save(out)
            events.add(
                learner.steps, {"success/training": rate, "success/validation": score}
            )
            _write(out / LOG, training, history)
            words = f"steps, success {rate:.0%} exploring, {score:.0%} validated"
            line.count(min(learner.steps, training.steps), training.steps, words)
    env.close()
    return best


def validate(policy: Policy, env: Any, episodes: int) -> float:
    """Return the share of validation episodes in which a policy succeeds."""
    done = [run_episode(env, policy, VALIDATION + k).success for k in range(episodes)]
    return float(np.mean(done))


def _least(highest: float, episodes: int) -> float:
    """Return what is as good as the highest share of episodes, but for chance."""
    return highest - math.sqrt(highest * (1.0 - highest) / episodes)


def trained_policy(learner: Learner, env: Any, training: Training) -> Policy:
    """Return the policy that a learner has learned so far."""
    import importlib.metadata

    kind, network = learner.policy()
    space = env.observation_space
    info = PolicyInfo(
        environment=training.environment,
        keywords=dict(training.keywords),
        algorithm=training.algorithm,
        version=importlib.metadata.version("drake_srg"),
        command=training.command,
        seed=training.seed,
    )
    low, high = (np.asarray(x, np.float32) for x in (space.low, space.high))
    return Policy(kind, network.copy(), low, high, env.action_space.shape[0], info)


def _scored(policy: Policy, steps: int, score: float) -> Policy:
    scores = {"validation": score}
    return dc.replace(policy, info=dc.replace(policy.info, steps=steps, scores=scores))


def _identity(training: Training) -> dict[str, Any]:
    """Return what must not change when training goes on."""
    plain = dc.asdict(training)
    return {k: v for k, v in plain.items() if k not in ("steps", "command")}


def _begin(training: Training, out: Path, resume: bool) -> list[list[float]]:
    """Check the folder, and return the history of a training to go on with.

    Raises:
        ScenarioError: If it contains a training that this one cannot continue.
    """
    path = out / LOG
    if not path.exists():
        return []
    if not resume:
        raise ScenarioError(
            f"{out}: already contains a training; continue it with --resume, or choose "
            "another --out"
        )
    try:
        begun = json.loads(path.read_text(encoding="utf-8"))
        # Trainings begun earlier have no choice of rules.
        old, history = {"rule": RULE, **begun["training"]}, list(begun["history"])
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise ScenarioError(f"{path}: invalid content: {one_line(error)}") from None
    for key, value in _identity(training).items():
        if old.get(key) != value:
            raise ScenarioError(
                f"{out}: contains another training: {key}: was {old.get(key)}, "
                f"is {value}"
            )
    return history


def _write(path: Path, training: Training, history: list[list[float]]) -> None:
    columns = ["steps", "episodes", "success exploring", "success validated"]
    content = {"training": dc.asdict(training), "columns": columns, "history": history}
    write_file(path, (json.dumps(content, indent=1) + "\n").encode())
