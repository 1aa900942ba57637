"""Base class of the environments: keywords, spaces, episodes, images."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.learning.envs.episode_station import SimulationError
from drake_srg.learning.envs.hand_task import HandTask
from drake_srg.learning.envs.rewards import REWARDS, STEP_REWARDS, Reward, Truth
from drake_srg.learning.envs.scenes import CONTROL_PERIOD, Physics, choose
from drake_srg.types import Vector

State = npt.NDArray[np.float32]
Observation = State | dict[str, npt.NDArray[Any]]
Step = tuple[Observation, float, bool, bool, dict[str, Any]]

OBSERVATIONS = ("state", "blobs", "images")
_KEYWORDS = (
    *("scenario", "physics", "driver", "observation", "reward", "noise", "touch"),
    *("critic", "render_mode", "overrides"),
)


class HandEnv(HandTask, gymnasium.Env[Any, Any]):
    """An environment in which a hand that points down grasps one object.

    All environments share these keywords. See docs/learning.md for the observations and
    actions of each.

    Args:
        scenario: Name or path of the scenario: arm, gripper, table and the
            distributions of its one object.
        physics: `train`, `fast` or `accurate`; see `Physics`.
        driver: Driver of the gripper: `plant`, `position` or `tendon`.
        observation: `state`: a vector. `blobs`: the same, with the object's pose from
            the localizer's cameras at the start. `images`: a dictionary of the state
            and an image of the localizer's camera, or of the video camera without a
            localizer.
        reward: `shaped`, `success`, `lifted`, a measure of the lifted grasp, such as
            `slip_margin`, or a function; see `drake_srg.learning.envs.rewards`.
            Environments that judge no lift take only `shaped`, `success` or a function.
        noise: Standard deviation of the object's estimated position [m].
        touch: Whether observations include the fingers' forces; zeros otherwise.
        critic: Whether `info["critic"]` holds the ground truth; see
            `critic_observation`.
        render_mode: `rgb_array` for images of the scenario's video camera.
        overrides: Entries `KEY=VALUE` for the scenario, as for `load_scenario`.

    Raises:
        ScenarioError: On an invalid keyword or scenario.
    """

    metadata = {  # noqa: RUF012 (gymnasium declares it)
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / CONTROL_PERIOD),
    }
    # Meaning of the entries of a state, and of an action.
    observation_names: Sequence[str] = ()
    # Whether an episode ends with a lift and a shake, which some rewards need.
    judges_lift: ClassVar[bool] = True
    # Steps of the plant per control period; see `Physics`.
    train_steps: ClassVar[int] = 2
    action_names: Sequence[str] = ()

    def __init__(
        self,
        *,
        scenario: str | Path = "learn_bench",
        physics: str = "train",
        driver: str = "plant",
        observation: str = "state",
        reward: str | Reward = "shaped",
        noise: float = 0.005,
        touch: bool = True,
        critic: bool = False,
        render_mode: str | None = None,
        overrides: Sequence[str] = (),
        **unknown: Any,
    ) -> None:
        for name in unknown:
            raise ScenarioError(f"unknown keyword {name!r} {suggest(name, _KEYWORDS)}")
        choose("observation", observation, OBSERVATIONS)
        choose("render_mode", render_mode or "rgb_array", ("rgb_array",))
        if not callable(reward):
            choose("reward", reward, REWARDS if self.judges_lift else STEP_REWARDS)
        self.render_mode = render_mode
        self.touch = touch
        self.critic = critic
        self._reward = reward if callable(reward) else REWARDS[reward]
        tree = Physics(physics, driver, self.train_steps).scenario_tree(
            scenario, overrides
        )
        self._video: str = tree["recording"].get("video_camera", "")
        seen = (tree.get("localizer") or {}).get("cameras") or [self._video]
        self._camera: str | None = seen[0] if observation == "images" else None
        cameras = [self._camera] if self._camera is not None else []
        if observation == "blobs":
            cameras = list((tree.get("localizer") or {}).get("cameras") or ())
            if not cameras:
                raise ScenarioError(
                    f"{scenario}: localizer.cameras: observation=blobs needs a camera"
                )
        if render_mode is not None and self._video not in cameras:
            cameras.append(self._video)
        super().__init__(
            tree, str(scenario), noise, cameras, sees=observation == "blobs"
        )
        states = _box(len(self.observation_names))
        self.observation_space = states
        if self._camera is not None:
            config = self.station.scenario.cameras[self._camera]
            size = (config.height, config.width, 3)
            images = gymnasium.spaces.Box(0, 255, size, np.uint8)
            self.observation_space = gymnasium.spaces.Dict(
                {"state": states, "image": images}
            )
        self.action_space = _box(len(self.action_names))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; `options={"scene": info["scene"]}` replays one.

        Raises:
            ScenarioError: If the options or the scene are invalid.
        """
        super().reset(seed=seed)
        if not isinstance(options, Mapping | None):
            kind = type(options).__name__
            raise ScenarioError(f"options: must be a mapping, got {kind}")
        for key in options or {}:
            if key != "scene":
                raise ScenarioError(f"options: unknown key {key!r} (allowed: scene)")
        if options and "scene" in options:
            scene = self.scenes.replay(options["scene"])
        else:
            scene = self.scenes.draw(self.np_random)
        self.look(scene)
        self.begin(scene, self.q_start)
        info = self.info(self.truth())
        info["scene"] = copy.deepcopy(dict(scene.tree))
        return self.observe(), info

    def state(self) -> State:
        """Return the numbers of an observation, each -1 .. 1."""
        raise NotImplementedError

    def observe(self) -> Observation:
        """Return the observation."""
        if self._camera is None:
            return self.state()
        return {"state": self.state(), "image": self.image(self._camera)}

    def info(self, truth: Truth) -> dict[str, Any]:
        """Return the ground truth, which only the trainer may use."""
        info: dict[str, Any] = {"success": truth.success, "failure": ""}
        if self.critic:
            info["critic"] = self.critic_observation(truth)
        return info

    def critic_observation(self, truth: Truth) -> State:
        """Return the ground truth as numbers, for critics that are not deployed.

        They are the object's true position relative to the hand [0.2 m], its mass [kg],
        friction, height above the table [0.2 m] and speed [m/s].
        """
        thing = self.scene.object
        p = self.station.X_WO().translation() - self.mover.pose(self.station.q())[:3]
        height, speed = truth.height / 0.2, self.station.speed()
        values = [*(p / 0.2), thing.mass or 0.0, thing.friction or 0.0, height, speed]
        return np.array(values, dtype=np.float32)

    def failed_step(self, error: Exception) -> Step:
        """Return the result of a step that could not be simulated."""
        info: dict[str, Any] = {"success": False, "failure": str(error)}
        if self.critic:
            info["critic"] = np.zeros(7, dtype=np.float32)
        observation: Observation = np.zeros(len(self.observation_names), np.float32)
        if self._camera is not None:
            image = self.image(self._camera)
            observation = {"state": np.asarray(observation), "image": image}
        return observation, 0.0, False, True, info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return an image (height, width, 3) of the video camera."""
        return self.image(self._video) if self.render_mode is not None else None


def _box(size: int) -> gymnasium.spaces.Box:
    return gymnasium.spaces.Box(-1.0, 1.0, (size,), np.float32)


def clipped(values: Vector) -> State:
    """Return the numbers of an observation or action, clipped to -1 .. 1."""
    return np.clip(values, -1.0, 1.0).astype(np.float32)


def checked(action: Any) -> Vector:
    """Return an action as numbers.

    Raises:
        SimulationError: If they are not all finite.
    """
    values = np.asarray(action, dtype=float)
    if not np.isfinite(values).all():
        raise SimulationError(f"the action is not finite: {values.tolist()}")
    return values
