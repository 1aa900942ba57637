"""Environments with flat vectors for learners, and the ids of all suite environments.

Importing this module registers up to three environments per task, such as `pick_can`:
`drake_srg/pick_can-v0`, a `SuiteEnv`; `drake_srg/pick_can_proprio-v0`, a
`ProprioceptionEnv`; and, if the task has an object to pick,
`drake_srg/pick_can_state-v0`, a `StateEnv`. In the workers of a vector environment, let
gymnasium import the module:
`gymnasium.make("drake_srg.suite.envs:drake_srg/pick_can-v0")`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import EVALUATION, NAMESPACE, VALIDATION
from drake_srg.suite.env import Observation, SuiteEnv
from drake_srg.suite.tasks import (
    EPISODES,
    EVALUATION_SPLIT,
    TRAINING_SPLIT,
    find_tasks,
    load_tasks,
)
from drake_srg.types import Vector

Array = npt.NDArray[np.float32]
_REACH = 0.5  # scale of distances [m]
_KICKED = 0.2  # share of the steps with a disturbance
_FORCE = 20.0  # scale of the finger links' forces, as in `drake_srg.learning.envs` [N]


class ProprioceptionEnv(gymnasium.Env[Array, Array]):
    """A task of the suite in flat vectors for learners, without images.

    An observation (N + n + m) has the measured positions of the arm's N joints and the
    hand's n joints, scaled to -1 .. 1 between their limits, and the normal forces of
    the m finger links, where 1 is 20 N. It does not show where an object is.

    An action (N + 1) has the motion of each joint's command, where 1 is the joint's top
    speed, and the closure, -1 open .. 1 closed. Several arms follow one another, as in
    `SuiteEnv`.

    The seed is the scenario's. Seeds from `EVALUATION` on stand for the 200 episodes of
    evaluation; without a seed, one of training is drawn. `info["success"]` is
    `info["is_success"]`.

    Args:
        task: Name of the task.
        expert: Whether the task's expert runs along, for `rule`. This takes time.
        noise: Standard deviation of a disturbance of the joints' motions in a fifth of
            the steps, as a share of their top speeds. The expert then also shows how to
            correct errors (M. Laskey et al., DART, CoRL 2017). Episodes of validation
            and evaluation are not disturbed.
        episode_length: Longest episode, in steps; None: the task's.
        render_mode: See `SuiteEnv`.

    Raises:
        ScenarioError: If the task or another argument is unknown.
    """

    metadata = SuiteEnv.metadata

    def __init__(
        self,
        task: str,
        *,
        expert: bool = False,
        noise: float = 0.0,
        episode_length: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        if not (isinstance(noise, int | float) and 0.0 <= noise < math.inf):
            raise ScenarioError(f"noise: must be 0 or more, and finite, got {noise!r}")
        self.noise, self._disturbed = noise, False
        self.suite = SuiteEnv(
            task,
            split=TRAINING_SPLIT,
            cameras=(),
            expert=expert,
            episode_length=episode_length,
            render_mode=render_mode,
        )
        self.render_mode = render_mode
        size = gymnasium.spaces.flatdim(self.suite.observation_space)
        box = gymnasium.spaces.Box
        self.observation_space = box(-1.0, 1.0, (size,), np.float32)
        self.action_space = box(-1.0, 1.0, self.suite.actions.shape, np.float32)
        self._last = np.zeros(size, np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; `seed` is the scenario's, drawn by default."""
        super().reset(seed=seed)
        if seed is None:
            seed = int(self.np_random.integers(VALIDATION))
        judged, self._disturbed = seed >= EVALUATION, seed < VALIDATION
        self.suite.split = EVALUATION_SPLIT if judged else TRAINING_SPLIT
        number = (seed - EVALUATION) % EPISODES if judged else seed
        observation, info = self.suite.reset(seed=number, options=options)
        return self._flat(observation), self._info(info)

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Move for 1/16 s; see `SuiteEnv.step`."""
        values = np.asarray(action, dtype=float)
        if values.shape != self.action_space.shape:
            shape = self.action_space.shape
            raise ValueError(f"action: must have shape {shape}, got {values.shape}")
        values = np.clip(values, -1.0, 1.0)
        if not self.suite.failure:  # otherwise, any step ends the episode
            episode = self.suite.episode
            moved = episode.command + (values + self._kick()) * self.suite.motion
            moved[episode.closures] = 0.5 * (values[episode.closures] + 1.0)
            values = moved
        observation, reward, terminated, truncated, info = self.suite.step(
            values.astype(np.float32)
        )
        return (
            self._flat(observation),
            reward,
            terminated,
            truncated,
            self._info(info),
        )

    def rule(self, observation: Array) -> Array:
        """Return the action (N + 1) that the expert proposes now.

        Args:
            observation: The latest observation. The expert has memory, so it cannot
                answer for earlier ones.

        Raises:
            ScenarioError: If this is another observation, or the environment was made
                without `expert`.
        """
        if not np.array_equal(observation, self._last):
            raise ScenarioError(
                "rule: the expert of a task answers only at the present moment "
                "(allowed: --algo bc)"
            )
        if self.suite.failure:
            return np.zeros(self.action_space.shape or (), np.float32)
        proposed, episode = self.suite.expert_action(), self.suite.episode
        action = (proposed - episode.command) / self.suite.motion
        action[episode.closures] = 2.0 * proposed[episode.closures] - 1.0
        return np.clip(action, -1.0, 1.0).astype(np.float32)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return an image (height, width, 3) of the video camera."""
        return self.suite.render()

    def close(self) -> None:
        """Free the simulation."""
        self.suite.close()

    def _kick(self) -> Array | float:
        """Return the disturbance of a step, as a share of each joint's top speed."""
        disturbed = self._disturbed and self.noise > 0.0
        if not disturbed or self.np_random.random() >= _KICKED:
            return 0.0
        size = self.action_space.shape
        return self.noise * self.np_random.normal(size=size).astype(np.float32)

    def _flat(self, observation: Observation) -> Array:
        parts = np.concatenate(self._parts(observation))
        self._last = np.clip(parts, -1.0, 1.0).astype(np.float32)
        return self._last.copy()

    def _parts(self, observation: Observation) -> list[Vector]:
        """Return the parts of a flat observation, before clipping to -1 .. 1."""
        low, high = self.suite.limits
        positions = 2.0 * (observation["agent_pos"] - low) / (high - low) - 1.0
        return [positions, observation["touch"] / _FORCE]

    def _info(self, info: dict[str, Any]) -> dict[str, Any]:
        return {**info, "success": info["is_success"]}


class StateEnv(ProprioceptionEnv):
    """A task of the suite in flat vectors, with the true place of the picked object.

    An observation has 9 K + 3 more entries for K hands. For each hand, these are the
    object's position and its x and z axes, in the palm's frame. The last three are the
    vector from the object to its goal in world. For positions, 1 is 0.5 m, and larger
    entries are clipped.

    Args:
        task: Name of a task whose goal is `lift` or `place`.
        options: See `ProprioceptionEnv`.

    Raises:
        ScenarioError: If the task or another argument is unknown.
    """

    def __init__(self, task: str, **options: Any) -> None:
        (name,) = find_tasks([task])
        if not load_tasks()[name].picks:
            raise ScenarioError(
                f"task: {task} has no object of its own to pick "
                "(allowed: tasks whose goal is `lift` or `place`)"
            )
        super().__init__(task, **options)
        size = len(self._last) + self._known
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (size,), np.float32)
        self._last = np.zeros(size, np.float32)

    @property
    def _known(self) -> int:
        """Number of entries that this class adds to an observation."""
        return 9 * len(self.suite.hands) + 3

    def _parts(self, observation: Observation) -> list[Vector]:
        parts = super()._parts(observation)
        if self.suite.failure:
            return [*parts, np.zeros(self._known)]
        X_POs, p_OG_W = self.suite.episode.picked()
        for X_PO in X_POs:
            parts.append(X_PO.translation() / _REACH)
            parts.extend(X_PO.rotation().matrix().T[[0, 2]])
        return [*parts, p_OG_W / _REACH]


# Environments of flat vectors, by the ends of their names.
VECTOR_ENVS: Mapping[str, type[ProprioceptionEnv]] = {
    "proprio": ProprioceptionEnv,
    "state": StateEnv,
}


def register_envs() -> None:
    """Register the environments with gymnasium, in the namespace `drake_srg`."""
    for task, config in load_tasks().items():
        kinds = {task: "env:SuiteEnv"}
        for suffix, kind in VECTOR_ENVS.items():
            if config.picks or kind is not StateEnv:
                kinds[f"{task}_{suffix}"] = f"envs:{kind.__name__}"
        for name, entry in kinds.items():
            env_id = f"{NAMESPACE}{name}-v0"
            if env_id not in gymnasium.registry:
                gymnasium.register(
                    env_id,
                    entry_point=f"drake_srg.suite.{entry}",
                    kwargs={"task": task},
                )


register_envs()
