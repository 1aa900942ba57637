"""Learners in NumPy, in rounds that can be interrupted."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.random import default_rng

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.learning.baselines import RULE, rule_of
from drake_srg.learning.cloning import clone
from drake_srg.learning.demonstrations import read_demonstrations
from drake_srg.learning.episodes import Episode, run_episode, training_seed
from drake_srg.learning.network import Array, Network
from drake_srg.learning.policy import Kind, npz_bytes, scaled
from drake_srg.learning.q_learner import QLearner
from drake_srg.sweeps.files import write_file

CHECKPOINT = "checkpoint.npz"


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
        """Run at least so many steps; returns the success of each episode."""

    def policy(self) -> tuple[Kind, Network]:
        """Return the policy so far: its kind and its network."""

    def save(self, folder: Path) -> None:
        """Write all that `restore` needs."""

    def restore(self, folder: Path) -> None:
        """Go on from what `save` wrote."""


class _Rounds:
    """What learners in NumPy share: episodes with seeds of their own, and a file.

    Args:
        env: The environment.
        run: Seed of training.
    """

    def __init__(self, env: Any, run: int) -> None:
        self.steps, self.episodes, self.round_steps = 0, 0, 250
        self._env, self._run = env, run
        space = env.observation_space
        self._low, self._high = space.low, space.high
        self._rng = default_rng(run)

    def advance(self, steps: int) -> list[bool]:
        """See `Learner`."""
        end, done = self.steps + steps, []
        while self.steps < end:
            seed = training_seed(self._run, self.episodes)
            episode = run_episode(self._env, self._act, seed)
            self.steps += len(episode.actions)
            self.episodes += 1
            self._learn(episode)
            done.append(episode.success)
        return done

    def _scaled(self, observation: Array) -> Array:
        return scaled(observation, self._low, self._high)

    def _act(self, observation: Array) -> Array:
        raise NotImplementedError

    def _learn(self, episode: Episode) -> None:
        raise NotImplementedError

    def _state(self) -> dict[str, Any]:
        raise NotImplementedError

    def _restore(self, arrays: Mapping[str, Any]) -> None:
        raise NotImplementedError

    def save(self, folder: Path) -> None:
        """See `Learner`."""
        arrays = self._state() | {
            "steps": np.array(self.steps),
            "episodes": np.array(self.episodes),
            "rng": np.array(json.dumps(self._rng.bit_generator.state)),
        }
        write_file(folder / CHECKPOINT, npz_bytes(arrays))

    def restore(self, folder: Path) -> None:
        """See `Learner`."""
        path = folder / CHECKPOINT
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            self.steps, self.episodes = int(arrays["steps"]), int(arrays["episodes"])
            self._rng.bit_generator.state = json.loads(str(arrays["rng"]))
            self._restore(arrays)
        except Exception as error:  # whatever damaged archives raise: a dozen kinds
            raise ScenarioError(
                f"{path}: --resume: cannot be read: {one_line(error)}"
            ) from None


class QRounds(_Rounds):
    """`QLearner` on an environment whose episodes have one step."""

    def __init__(self, env: Any, run: int) -> None:
        super().__init__(env, run)
        self._learner = QLearner(
            env.observation_space.shape[0], env.action_space.shape[0], self._rng
        )

    def _act(self, observation: Array) -> Array:
        return self._learner.explore(self._scaled(observation))

    def _learn(self, episode: Episode) -> None:
        if len(episode.actions) != 1:
            raise ScenarioError(
                "--algo q: needs episodes of one step, such as those of GraspOneShot "
                "(allowed here: sac, bc, dagger)"
            )
        x = self._scaled(episode.observations[0])
        self._learner.learn(x, episode.actions[0], float(episode.rewards[0]))

    def policy(self) -> tuple[Kind, Network]:
        """See `Learner`."""
        return "q", self._learner.network

    def _state(self) -> dict[str, Any]:
        return self._learner.state()

    def _restore(self, arrays: Mapping[str, Any]) -> None:
        self._learner.restore(dict(arrays))


class CloningRounds(_Rounds):
    """Clones a hand-written rule of an environment, where the rule succeeds."""

    def __init__(self, env: Any, run: int, rule: str = RULE) -> None:
        super().__init__(env, run)
        self.round_steps = sys.maxsize  # fitting takes longer than demonstrating
        self._rule = rule_of(env, rule)
        self._seen: list[Array] = []
        self._done: list[Array] = []

    def _act(self, observation: Array) -> Array:
        return self._rule(observation)

    def _learn(self, episode: Episode) -> None:
        if episode.success:
            self._seen.extend(self._scaled(episode.observations[:-1]))
            self._done.extend(episode.actions)

    def policy(self) -> tuple[Kind, Network]:
        """See `Learner`."""
        if not self._seen:
            raise ScenarioError("--algo bc: no demonstration succeeded; add --steps")
        # Draws of its own, so that how often a policy is made changes nothing.
        rng = default_rng([self._run, self.episodes])
        network, _ = clone(np.array(self._seen), np.array(self._done), rng)
        return "actor", network

    def _state(self) -> dict[str, Any]:
        return {"seen": np.array(self._seen), "done": np.array(self._done)}

    def _restore(self, arrays: Mapping[str, Any]) -> None:
        self._seen, self._done = list(arrays["seen"]), list(arrays["done"])


class DataRounds(CloningRounds):
    """Clones the grasps of a data set; a step is one of them.

    Args:
        env: The environment.
        run: Seed of training.
        data: Folder of the data set.
    """

    def __init__(self, env: Any, run: int, data: Path) -> None:
        super().__init__(env, run)
        self._shown = read_demonstrations(data, env)

    def advance(self, steps: int) -> list[bool]:
        """Take so many demonstrations, or all that are left; see `Learner`."""
        new = self._shown[self.episodes : self.episodes + steps]
        self._seen.extend(self._scaled(x) for x, _ in new)
        self._done.extend(action for _, action in new)
        self.steps += steps
        self.episodes += len(new)
        return [True] * len(new)
