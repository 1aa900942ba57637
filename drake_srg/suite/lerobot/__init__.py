"""The suite as environments for LeRobot's commands (docs/lerobot.md).

    lerobot-eval --env.discover_packages_path=drake_srg.suite.lerobot \
        --env.type=drake_srg --env.task=pick_can ...

LeRobot imports the packages in that option, and installed distributions whose names
begin with `lerobot_env_`; see examples/lerobot. Written for LeRobot 0.6.1.
"""

from __future__ import annotations

import dataclasses as dc
import functools
from typing import Any

from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.envs.utils import _LazyAsyncVectorEnv, freeze_after_episode_end

from drake_srg.common.exceptions import ScenarioError
from drake_srg.suite.env import SuiteEnv
from drake_srg.suite.tasks import EVALUATION_SPLIT, find_tasks

SUITE = "drake_srg"


def _features(env: Any) -> dict[str, PolicyFeature]:
    """Return an environment's actions and observations, by the environment's names."""
    features = {"action": PolicyFeature(FeatureType.ACTION, env.action_space.shape)}
    for key, space in env.observation_space.items():
        if key != "pixels":
            features[key] = PolicyFeature(FeatureType.STATE, space.shape)
            continue
        for camera, image in space.items():
            name = f"pixels/{camera}"
            features[name] = PolicyFeature(FeatureType.VISUAL, image.shape)
    return features


def _policy_name(key: str) -> str:
    """Return LeRobot's name for a policy's input or output."""
    names = {"action": "action", "agent_pos": "observation.state"}
    if key.startswith("pixels/"):
        return key.replace("pixels/", "observation.images.", 1)
    return names.get(key, f"observation.{key}")


@EnvConfig.register_subclass("drake_srg")
@dc.dataclass
class DrakeSrgSuite(EnvConfig):
    """Tasks of the suite.

    Attributes:
        task: Names of tasks with the same arm, with commas between them.
        split: `evaluation` or `training`; see `SuiteEnv`.
        cameras: Names of the cameras whose images policies see.
        episode_length: Longest episode, in steps; None: the task's.
    """

    task: str | None = "pick_can"
    fps: int = SuiteEnv.metadata["render_fps"]
    split: str = EVALUATION_SPLIT
    cameras: list[str] = dc.field(default_factory=lambda: ["ceiling"])
    episode_length: int | None = None

    def __post_init__(self) -> None:
        """Declare observations and actions, which must be the same for all tasks.

        Raises:
            ScenarioError: If a task is unknown, or its observations or actions differ.
        """
        names = find_tasks(self.task or "")
        found = [_features(SuiteEnv(name, **self.gym_kwargs)) for name in names]
        for name, features in zip(names, found, strict=True):
            if features != found[0]:
                raise ScenarioError(
                    f"task: {name} has another arm or other cameras than {names[0]}; "
                    "evaluate it with a separate command"
                )
        self.features = found[0]
        self.features_map = {key: _policy_name(key) for key in self.features}

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Keywords of the environments."""
        return {
            "split": self.split,
            "cameras": self.cameras,
            "episode_length": self.episode_length,
        }

    def create_envs(
        self, n_envs: int, use_async_envs: bool = False
    ) -> dict[str, dict[int, VectorEnv[Any, Any, Any]]]:
        """Make the environments, by suite and by number in the order of `task`.

        A copy whose episode has ended waits for the others. A task's simulations begin
        only when its turn comes.
        """
        tasks: dict[int, Any] = {}
        for number, name in enumerate(find_tasks(self.task or "")):
            make = functools.partial(SuiteEnv, name, **self.gym_kwargs)
            if use_async_envs and n_envs > 1:
                env = make()
                tasks[number] = _LazyAsyncVectorEnv(
                    [make] * n_envs,
                    env.observation_space,
                    env.action_space,
                    env.metadata,
                )
            else:
                tasks[number] = SyncVectorEnv(
                    [freeze_after_episode_end(make)] * n_envs,
                    autoreset_mode=AutoresetMode.NEXT_STEP,
                )
        return {SUITE: tasks}
