"""Makes our environments known to LeRobot's commands, as `--env.type=drake_srg`.

docs/training.md shows the command that evaluates a policy in them.
"""

import dataclasses as dc
from typing import Any

from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig

from drake_srg.learning.envs.lerobot_env import LeRobotEnv, make_env

# LeRobot's names of what policies take and give.
_NAMES = {
    "action": "action",
    "agent_pos": "observation.state",
    "environment_state": "observation.environment_state",
    "pixels": "observation.image",
}
_TYPES = {
    "agent_pos": FeatureType.STATE,
    "environment_state": FeatureType.ENV,
    "pixels": FeatureType.VISUAL,
}


@EnvConfig.register_subclass("drake_srg")
@dc.dataclass
class DrakeSrgEnv(EnvConfig):
    """An environment of drake_srg.

    Attributes:
        task: Name of the environment.
        keywords: Of the environment, such as `{"observation": "images"}`.
    """

    task: str | None = "Pick-v0"
    keywords: dict[str, Any] = dc.field(default_factory=dict)
    features_map: dict[str, str] = dc.field(default_factory=lambda: dict(_NAMES))

    def __post_init__(self) -> None:
        """Say what the environment shows and takes."""
        env = LeRobotEnv(self.task, **self.keywords)
        self.fps = env.metadata["render_fps"]
        self.features = {
            "action": PolicyFeature(FeatureType.ACTION, env.action_space.shape),
            **{
                key: PolicyFeature(_TYPES[key], space.shape)
                for key, space in env.observation_space.items()
            },
        }
        env.close()

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Keywords of the environment."""
        return dict(self.keywords)

    def create_envs(self, n_envs: int, use_async_envs: bool = False) -> Any:
        """Make the environments; LeRobot 0.5 and later ask for them here."""
        return make_env(n_envs, use_async_envs, self)
