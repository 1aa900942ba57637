"""Training of policies (extra `learn`).

DIR/policy.npz       the policy, chosen by validation episodes
DIR/policy.onnx      the policy for other programs; not written by `q`
DIR/training.json    settings and progress of the training
DIR/events.*         progress for TensorBoard
DIR/checkpoint.pt    state for --resume
"""

from __future__ import annotations

import dataclasses as dc
import importlib
import importlib.metadata
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.status_line import StatusLine
from drake_srg.common.tables import read_json
from drake_srg.learning.episodes import (
    VALIDATION,
    environment_id,
    make_environment,
    run_episode,
    training_seed,
)
from drake_srg.learning.policy import (
    Kind,
    Network,
    Policy,
    PolicyInfo,
    check_sizes,
    load_policy,
    write_onnx,
)
from drake_srg.learning.rules import RULE, RULE_NAMES
from drake_srg.sweeps.files import write_file

ALGORITHMS = ("q", "sac", "bc", "dagger")
POLICY, ONNX, LOG = "policy.npz", "policy.onnx", "training.json"
_RECENT = 100  # number of episodes in the displayed success rate


@dc.dataclass(frozen=True, kw_only=True)
class Training:
    """Settings of a training.

    Attributes:
        environment: Id of the environment.
        keywords: Keyword arguments of the environment.
        algorithm: One of `ALGORITHMS`.
        steps: Steps of the environment in total.
        seed: Seed of all draws.
        validation: Number of validation episodes per policy.
        command: The command line, to be noted in the policy's file.
        data: Folder of a data set of demonstrations, or "".
        rule: Hand-written rule that `bc` and `dagger` imitate; see `rules.rule_of`.
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


class Learner(Protocol):
    """Learns from an environment, a few episodes at a time.

    Attributes:
        steps: Steps of the environment so far.
        episodes: Episodes so far.
        round_steps: Steps between two validations.
    """

    steps: int
    episodes: int
    round_steps: int

    def advance(self, steps: int) -> list[bool]:
        """Run at least a number of steps; return the success of each episode."""

    def policy(self) -> tuple[Kind, Network]:
        """Return the present policy: its kind and its network."""

    def save(self, folder: Path) -> None:
        """Write the state that `restore` reads."""

    def restore(self, folder: Path) -> None:
        """Continue from the files of `save`."""


def MakeLearner(
    algorithm: str, env: Any, run: int, data: str = "", rule: str = RULE
) -> Learner:
    """Make the learner of an algorithm.

    Args:
        algorithm: One of `ALGORITHMS`.
        env: The environment.
        run: Seed of training.
        data: Folder of a data set, for `bc`; "" for a hand-written rule.
        rule: Rule that `bc` and `dagger` imitate; see `rules.rule_of`.

    Raises:
        ScenarioError: If the algorithm does not fit the environment, or `data` does not
            fit both.
        ImportError: If the extra `learn` is missing.
    """
    if data and algorithm != "bc":
        raise ScenarioError(f"--data: needs --algo bc, got {algorithm}")
    if rule != RULE and algorithm not in ("bc", "dagger"):
        raise ScenarioError(
            f"--rule {rule}: needs --algo bc or dagger, got {algorithm}"
        )
    if rule != RULE and data:
        raise ScenarioError(f"--rule {rule}: cannot be combined with --data")
    require_learn()
    from drake_srg.learning.learners import (
        CloningRounds,
        DaggerRounds,
        DataRounds,
        QRounds,
        SacRounds,
    )

    if algorithm == "q":
        return QRounds(env, run)
    if algorithm == "sac":
        return SacRounds(env, run)
    if algorithm == "dagger":
        return DaggerRounds(env, run, rule)
    return DataRounds(env, run, Path(data)) if data else CloningRounds(env, run, rule)


def require_learn() -> None:
    """Check that the packages for training are installed.

    Raises:
        ImportError: If one is missing; the message says what to install.
    """
    try:
        for name in ("torch", "stable_baselines3", "tensorboard", "onnx"):
            importlib.import_module(name)
    except ImportError as error:
        raise ImportError(
            f"Training needs PyTorch and Stable-Baselines3 ({one_line(error)}). "
            "Install a CPU build of torch first (1.1 GB; pytorch.org says how, and a "
            "plain `pip install torch` may fetch a CUDA build of several GB), then "
            "run: pip install 'drake_srg[learn]'; trained policies need neither"
        ) from error


def train(
    training: Training, out: Path, *, resume: bool = False, progress: bool = False
) -> Policy:
    """Train a policy, write it and return it.

    The result is the latest policy whose validation score is within one standard error
    of the best. Smaller differences are chance, and a later policy has seen more
    episodes. The same training gives the same policy, interrupted or not.

    Args:
        training: Settings of the training.
        out: Folder of the files.
        resume: Whether to continue this training if `out` contains it.
        progress: Whether to show progress on standard error.

    Raises:
        ScenarioError: For bad input.
        OSError: If files cannot be written.
        ImportError: If the extra `learn` is missing.
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
    from torch.utils.tensorboard import SummaryWriter

    # With such small networks, more threads would mostly wait for each other.
    one_thread = threadpool_limits(1)
    with one_thread, SummaryWriter(out) as events, StatusLine(shown=progress) as line:
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
                if best.kind == "actor":
                    write_onnx(best, out / ONNX)
            learner.save(out)
            events.add_scalar("success/training", rate, learner.steps)
            events.add_scalar("success/validation", score, learner.steps)
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
    """Return the lowest success rate within one standard error of the highest."""
    return highest - math.sqrt(highest * (1.0 - highest) / episodes)


def trained_policy(learner: Learner, env: Any, training: Training) -> Policy:
    """Return the learner's present policy."""
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
    return Policy(kind, network, low, high, env.action_space.shape[0], info)


def _scored(policy: Policy, steps: int, score: float) -> Policy:
    scores = {"validation": score}
    return dc.replace(policy, info=dc.replace(policy.info, steps=steps, scores=scores))


def _identity(training: Training) -> dict[str, Any]:
    """Return the settings that must not change when training continues."""
    plain = dc.asdict(training)
    return {k: v for k, v in plain.items() if k not in ("steps", "command")}


def _begin(training: Training, out: Path, resume: bool) -> list[list[float]]:
    """Check the folder, and return the history of a training to continue.

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
    # Trainings from before --rule existed imitated RULE.
    old, history = read_json(
        path, lambda begun: ({"rule": RULE, **begun["training"]}, [*begun["history"]])
    )
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
