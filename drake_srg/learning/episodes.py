"""Episodes, their seeds, and environments by name."""

from __future__ import annotations

import dataclasses as dc
import importlib
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError, one_line, suggest
from drake_srg.learning.policy import Array

NAMESPACE = "drake_srg/"
# Seeds of episodes. The ranges of training, validation and evaluation do not overlap,
# so no policy is judged by an episode that trained or chose it. Each `train --seed S`
# has a million seeds of its own.
PER_RUN = 1_000_000
RUNS = 1000
VALIDATION = RUNS * PER_RUN
EVALUATION = VALIDATION + PER_RUN

Act = Callable[[Array], Array]


def training_seed(run: int, episode: int) -> int:
    """Return the seed of an episode of training.

    Raises:
        ScenarioError: If `run` or `episode` is out of range.
    """
    if not 0 <= run < RUNS:
        raise ScenarioError(f"--seed {run}: out of range (allowed: 0 to {RUNS - 1})")
    if not 0 <= episode < PER_RUN:
        raise ScenarioError(f"--steps: a run has at most {PER_RUN} episodes")
    return run * PER_RUN + episode


@dc.dataclass(frozen=True, eq=False)
class Episode:
    """Record of an episode.

    Attributes:
        observations: Shape (steps + 1, n).
        actions: Shape (steps, m).
        rewards: Shape (steps,).
        success: Whether the environment reported success.
        failure: The reason why the simulator ended the episode early, or "".
        scene: Scene that the environment drew, as plain data.
    """

    observations: Array
    actions: Array
    rewards: Array
    success: bool
    failure: str
    scene: Mapping[str, Any]


def run_episode(env: Any, act: Act, seed: int) -> Episode:
    """Run one episode.

    Args:
        env: A gymnasium.Env with `Box` spaces of one dimension.
        act: Returns the action for an observation.
        seed: Seed of the episode.
    """
    observation, info = env.reset(seed=seed)
    scene = info.get("scene", {})
    observations, actions, rewards = [observation], [], []
    ended = False
    while not ended:
        action = np.asarray(act(observation), np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        actions.append(action)
        rewards.append(reward)
        ended = terminated or truncated
    return Episode(
        np.array(observations, np.float32),
        np.array(actions, np.float32),
        np.array(rewards, np.float32),
        bool(info.get("success", False)),
        str(info.get("failure", "")),
        scene,
    )


def environment_id(name: str) -> str:
    """Return the full id of an environment: `Pick` stands for `drake_srg/Pick-v0`.

    Ids of others stay as they are; `MODULE:ID` imports the module that registers it.
    """
    name = name.removeprefix("drake_srg.learning.envs:")  # imported in any case
    name = name if "/" in name or ":" in name else NAMESPACE + name
    return name if re.search(r"-v\d+$", name) else f"{name}-v0"


def make_environment(name: str, keywords: Mapping[str, Any] | None = None) -> Any:
    """Make an environment.

    Args:
        name: Its id, or the short name of an environment of drake_srg.
        keywords: Keyword arguments of the environment.

    Raises:
        ScenarioError: If the environment is unknown, a keyword is wrong, or a space is
            not a bounded vector.
    """
    import gymnasium

    name = environment_id(name)
    module, _, registered = name.rpartition(":")
    if name.startswith(NAMESPACE):
        module = "drake_srg.learning.envs"
    if module:
        try:
            importlib.import_module(module)  # registers its environments
        except (ModuleNotFoundError, TypeError) as error:  # or a relative name
            raise ScenarioError(f"ENV: {name}: {error}") from None
    if registered not in gymnasium.registry:
        ours = [i for i in gymnasium.registry if i.startswith(NAMESPACE)]
        raise ScenarioError(f"ENV: unknown environment {name!r} {suggest(name, ours)}")
    try:
        env = gymnasium.make(registered, **(keywords or {}))
    except ScenarioError:
        raise
    except (TypeError, ValueError) as error:
        # Gymnasium appends a sentence about where the error was raised.
        reason = one_line(error).partition(" was raised from")[0]
        raise ScenarioError(f"ENV: {name}: {reason}") from None
    for kind, space in (
        ("observation", env.observation_space),
        ("action", env.action_space),
    ):
        if not isinstance(space, gymnasium.spaces.Box) or len(space.shape) != 1:
            raise ScenarioError(
                f"ENV: {name}: {kind}: learners need a flat vector "
                f"(observation=state), got {space}"
            )
        # Policies scale observations by their bounds, and act within -1 .. 1.
        if not space.is_bounded() or (
            kind == "action"
            and not (np.all(space.low == -1) and np.all(space.high == 1))
        ):
            raise ScenarioError(
                f"ENV: {name}: {kind}: learners need finite bounds, -1 .. 1 of actions"
            )
    return env
