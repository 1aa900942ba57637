"""Our environments with LeRobot's interface (docs/policies.md).

LeRobot wants observations in a dictionary of `agent_pos`, `environment_state` and
`pixels`, the success of an episode as `info["is_success"]`, and three attributes. Its
EnvHub calls `make_env` (https://huggingface.co/docs/lerobot/envhub). Nothing here
imports LeRobot.
"""

from __future__ import annotations

import functools
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv

import drake_srg.learning.envs
from drake_srg.learning.envs.hand_env import HandEnv
from drake_srg.learning.envs.scenes import choose

SUITE = "drake_srg"
# Measurements of the robot itself; the other entries describe object and goal.
_OWN = ("height", "angle_", "speed_", "force_", "closure", "time", "yaw")
_TASKS = {
    "GraspOneShot-v0": "Grasp the object and hold it.",
    "Pick-v0": "Pick up the object.",
    "KitchenPick-v0": "Pick up the object.",
    "KitchenPickPlace-v0": "Pick up the object and place it on its goal.",
}
Values = dict[str, npt.NDArray[Any]]


class LeRobotEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment of ours with LeRobot's names.

    Its observation is a dictionary: `agent_pos`, the robot's measurements of itself, if
    there are any; `environment_state`, the entries about the object; and `pixels`, the
    image with `observation="images"`.

    Args:
        name: Name of the environment, such as `Pick-v0`.
        keywords: Keyword arguments of the environment; see `HandEnv`.

    Raises:
        ScenarioError: If the name or a keyword is wrong.
    """

    def __init__(self, name: str, **keywords: Any) -> None:
        choose("environment", name, drake_srg.learning.envs.ENVIRONMENTS)
        keywords.setdefault("render_mode", "rgb_array")
        env = gymnasium.make(f"drake_srg/{name}", **keywords)
        super().__init__(env)
        self.task, self.task_description = name, _TASKS[name]
        inner = env.unwrapped
        assert isinstance(inner, HandEnv)
        # LeRobot reads this name.
        self._max_episode_steps = int(getattr(inner, "max_steps", 1))
        own = [entry.startswith(_OWN) for entry in inner.observation_names]
        self._parts = {"agent_pos": np.array(own), "environment_state": ~np.array(own)}
        spaces: dict[str, gymnasium.Space[Any]] = {
            key: gymnasium.spaces.Box(-1.0, 1.0, (int(part.sum()),), np.float32)
            for key, part in self._parts.items()
            if part.any()
        }
        if isinstance(env.observation_space, gymnasium.spaces.Dict):
            spaces["pixels"] = env.observation_space["image"]
        self.observation_space = gymnasium.spaces.Dict(spaces)

    def _renamed(self, observation: Any) -> Values:
        images = isinstance(observation, dict)
        state = observation["state"] if images else observation
        values = {key: state[part] for key, part in self._parts.items() if part.any()}
        return values | ({"pixels": observation["image"]} if images else {})

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Values, dict[str, Any]]:
        """Begin an episode; `options={"scene": info["scene"]}` replays one.

        Other options than a scene are LeRobot's own.
        """
        kept = {k: v for k, v in (options or {}).items() if k == "scene"}
        observation, info = self.env.reset(seed=seed, options=kept)
        return self._renamed(observation), _plain(info)

    def step(self, action: Any) -> tuple[Values, float, bool, bool, dict[str, Any]]:
        """Act, and return the observation by LeRobot's names."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return (
            self._renamed(observation),
            float(reward),
            terminated,
            truncated,
            _plain(info),
        )


def _plain(info: dict[str, Any]) -> dict[str, Any]:
    """Return the entries that vector environments can collect: numbers of one type."""
    return {"is_success": bool(info["success"])}


def make_env(
    n_envs: int = 1,
    use_async_envs: bool = False,
    cfg: Any = None,
    *,
    name: str = "Pick-v0",
    **keywords: Any,
) -> dict[str, dict[int, VectorEnv[Any, Any, Any]]]:
    """Make environments as LeRobot's EnvHub expects them.

    Args:
        n_envs: Number of copies.
        use_async_envs: Whether each copy has a process of its own.
        cfg: LeRobot's configuration, if any: its `task` names the environment, and its
            `keywords`, if any, are added.
        name: Name of the environment if there is no `task`.
        keywords: Keyword arguments of the environment; see `HandEnv`.

    Returns:
        The vector environment by suite and number of the task.

    Raises:
        ScenarioError: If the name or a keyword is wrong.
        ValueError: If `n_envs` is less than 1.
    """
    if n_envs < 1:
        raise ValueError(f"n_envs: must be at least 1, got {n_envs}")
    name = getattr(cfg, "task", None) or name
    keywords = {**keywords, **(getattr(cfg, "keywords", None) or {})}
    make = functools.partial(LeRobotEnv, name, **keywords)
    # LeRobot reads the success of an episode from `final_info`.
    mode = AutoresetMode.SAME_STEP
    if use_async_envs and n_envs > 1:
        make()  # fails here on mistakes, not in the workers
        # Threads of the renderer would not survive a fork.
        vector: VectorEnv[Any, Any, Any] = AsyncVectorEnv(
            [make] * n_envs, context="spawn", autoreset_mode=mode
        )
    else:
        vector = SyncVectorEnv([make] * n_envs, autoreset_mode=mode)
    return {SUITE: {0: vector}}
