"""The suite's tasks as an environment for gymnasium."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import gymnasium
import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError, scenario_errors, suggest
from drake_srg.learning.envs.scenes import choose
from drake_srg.learning.episodes import VALIDATION
from drake_srg.scenario import robot_arms
from drake_srg.scenario.load import draw_scenario, load_tree
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.suite.episode import PERIOD, Episode, EpisodeError, with_cameras
from drake_srg.suite.tasks import (
    EPISODES,
    EVALUATION_SPLIT,
    SPLITS,
    find_tasks,
    load_tasks,
    scenario_seed,
)
from drake_srg.types import Vector

Observation = dict[str, Any]


class SuiteEnv(gymnasium.Env[Observation, npt.NDArray[np.float32]]):
    """A task of the suite: one or more arms with grippers at a table.

    An action (N + 1) lasts 1/16 s. It has the positions of the arm's N joints [rad], to
    which the commands move evenly, but no faster than the joints can, and the hand's
    closure, 0 open .. 1 closed.

    An observation has `agent_pos` (N + n), the measured positions of the arm's N joints
    and the hand's n joints [rad]; `touch` (m), the normal forces of the finger links
    [N]; and `pixels`, the images by camera. For the iiwa 14 with the SRG, N is 7, and n
    and m are 4. A data set of `drake-srg dataset` holds the same positions, actions and
    images.

    Several arms follow one another in all three vectors, in the scenario's order.

    Success is judged from ground truth; see `Task`. It ends the episode, with reward 1.
    An object that falls off the table ends it with reward 0. `info` has `is_success`,
    and `failure`: the reason if the simulator ended the episode, else "".

    Attributes:
        actions: The action space.
        limits: Least and greatest values of `agent_pos`, each of shape (N + n,) [rad].
        motion: Largest change of each entry of the command in a step, shape (N + 1,)
            [rad]; 1 for a closure.
        hands: Names of the hands' models.
        failure: `failure` of the present episode, as in `info`.

    Args:
        task: Name of the task.
        split: `evaluation`: the seed chooses one of 200 episodes that are never used
            for training; `training`: the seed is the scenario's.
        cameras: Names of the scenario's cameras for `pixels`; none: no `pixels`.
        expert: Whether the task's expert runs along, for `expert_action`. This takes
            time.
        episode_length: Longest episode, in steps; None: the task's.
        render_mode: `rgb_array`, for images of the scenario's video camera, or None.

    Raises:
        ScenarioError: If the task, a camera or another argument is unknown.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]  # gymnasium's is not
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / PERIOD),
    }

    def __init__(
        self,
        task: str,
        *,
        split: str = EVALUATION_SPLIT,
        cameras: Iterable[str] = ("ceiling",),
        expert: bool = False,
        episode_length: int | None = None,
        render_mode: str | None = "rgb_array",
    ) -> None:
        (self.task,) = find_tasks([task])
        choose("split", split, SPLITS)
        choose("render_mode", render_mode or "rgb_array", ("rgb_array",))
        self.config, self.split, self.expert = load_tasks()[task], split, expert
        self.cameras, self.render_mode = list(cameras), render_mode
        self._tree = load_tree(self.config.scenario, self.config.set)
        first = draw_scenario(self._tree, self.task, scenario_seed(split, 0)).scenario
        for camera in self.cameras:
            if camera not in first.cameras:
                known = suggest(camera, first.cameras)
                raise ScenarioError(f"cameras: unknown {camera!r} {known}")
        self._video = "overview"
        # LeRobot reads this attribute.
        self._max_episode_steps = (
            round(self.config.seconds / PERIOD)
            if episode_length is None
            else episode_length
        )
        if self._max_episode_steps < 1:
            raise ScenarioError(
                f"episode_length: must be at least 1, got {episode_length}"
            )
        with scenario_errors(self.task):
            plant = MakeModelsPlant(first)
        # Limits of the measured positions by model, shape (2, n) [rad].
        self._joints: dict[str, Vector] = {}
        self.hands: list[str] = []
        commands, motions, sensors = [], [], 0
        for robot in robot_arms(first):
            assert robot.gripper is not None
            arm = plant.GetModelInstanceByName(robot.arm_model)
            hand = plant.GetModelInstanceByName(robot.gripper_model)
            bounds = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
            limits = np.array([plant.GetPositionsFromArray(arm, q) for q in bounds])
            speeds = plant.GetVelocitiesFromArray(arm, plant.GetVelocityUpperLimits())
            fingers = [plant.GetJointByName(n, hand) for n in robot.gripper.joint_names]
            self._joints[robot.arm_model] = limits
            self._joints[robot.gripper_model] = np.array(
                [(j.position_lower_limit(), j.position_upper_limit()) for j in fingers]
            ).T
            self.hands.append(robot.gripper_model)
            commands.append(np.column_stack([limits, [0.0, 1.0]]))
            motions.append(np.append(np.array(speeds) * PERIOD, 1.0))
            sensors += len(robot.gripper.sensor_names)
        self._low, self._high = np.hstack(commands)
        self.motion = np.concatenate(motions)
        self.limits = tuple(np.hstack([*self._joints.values()]))
        box = gymnasium.spaces.Box
        self.actions = box(self._low.astype(np.float32), self._high.astype(np.float32))
        self.action_space = self.actions
        parts: dict[str, gymnasium.Space[Any]] = {
            "agent_pos": box(-np.inf, np.inf, self.limits[0].shape, np.float32),
            "touch": box(0.0, np.inf, (sensors,), np.float32),
        }
        if self.cameras:
            sizes = {name: first.cameras[name] for name in self.cameras}
            parts["pixels"] = gymnasium.spaces.Dict(
                {
                    name: box(0, 255, (size.height, size.width, 3), np.uint8)
                    for name, size in sizes.items()
                }
            )
        self._parts = gymnasium.spaces.Dict(parts)
        self.observation_space = self._parts
        self._episode: Episode | None = None
        self._number = 0
        self._steps = 0
        self.failure = ""
        self._last = _zeros(self._parts)

    @property
    def task_description(self) -> str:
        """The task in plain words: one of three, by the episode's number."""
        return self.config.wordings[self._number % 3]

    @property
    def episode(self) -> Episode:
        """The present episode.

        Raises:
            gymnasium.error.ResetNeeded: Before the first one.
        """
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("call reset() before the first step")
        return self._episode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; `seed` is its number, drawn by default."""
        del options  # LeRobot passes its own
        super().reset(seed=seed)
        most = EPISODES if self.split == EVALUATION_SPLIT else VALIDATION
        self._number = int(self.np_random.integers(most)) if seed is None else seed
        number = scenario_seed(self.split, self._number)
        scenario = draw_scenario(self._tree, self.task, number).scenario
        cameras = [*self.cameras]
        if self.render_mode is not None:
            cameras.append(self._video)
        scenario = with_cameras(scenario, cameras)
        self._episode, self._steps, self.failure = None, 0, ""
        expert = self.config.expert if self.expert else None
        try:
            self._episode = Episode(self.config.goal, scenario, self.task, expert)
            self._last = self._observe(self._episode)
        except EpisodeError as error:
            # The first step will end the episode.
            self.failure = str(error)
            self._last = _zeros(self._parts)
        return self._last, self._info(success=False)

    def step(
        self, action: npt.NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move for 1/16 s.

        An episode that Drake cannot simulate is truncated; `info["failure"]` says why.
        """
        success = lost = False
        self._steps += 1
        try:
            if not self.failure:
                goal = np.clip(_checked(action, len(self._low)), self._low, self._high)
                episode = self.episode
                near = episode.command + np.array([-1.0, 1.0])[:, None] * self.motion
                episode.advance(np.clip(goal, *near))
                self._last = self._observe(episode)
                success, lost = episode.succeeds(), episode.lost()
        except EpisodeError as error:
            self.failure = str(error)
        truncated = bool(self.failure) or self._steps >= self._max_episode_steps
        terminated = (success or lost) and not self.failure
        truncated = truncated and not terminated
        return self._last, float(success), terminated, truncated, self._info(success)

    def expert_action(self) -> npt.NDArray[np.float32]:
        """Return the action (N + 1) that the expert proposes now.

        Raises:
            ScenarioError: If the environment was made without `expert`.
        """
        if not self.expert:
            raise ScenarioError("expert: must be True, for the expert's actions")
        return self.episode.proposal().astype(np.float32)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return an image (height, width, 3) of the video camera."""
        if self.render_mode is None or self._episode is None:
            return None
        return self._episode.image(self._video)

    def close(self) -> None:
        """Free the simulation."""
        self._episode = None

    def _observe(self, episode: Episode) -> Observation:
        positions = [
            episode.measured(f"{model}.state_measured")[: limits.shape[1]]
            for model, limits in self._joints.items()
        ]
        touch = [episode.measured(f"{hand}.contact_force") for hand in self.hands]
        seen: Observation = {
            "agent_pos": np.concatenate(positions).astype(np.float32),
            "touch": np.concatenate(touch).astype(np.float32),
        }
        if self.cameras:
            seen["pixels"] = {name: episode.image(name) for name in self.cameras}
        return seen

    def _info(self, success: bool) -> dict[str, Any]:
        return {"is_success": success, "failure": self.failure}


def _zeros(space: gymnasium.spaces.Dict) -> Observation:
    return {
        key: _zeros(part)
        if isinstance(part, gymnasium.spaces.Dict)
        else np.zeros(part.shape, part.dtype)
        for key, part in space.items()
    }


def _checked(action: Any, size: int) -> Vector:
    """Return an action as an array of floats.

    Raises:
        EpisodeError: If an entry is not finite.
        ValueError: If the shape is wrong.
    """
    values = np.asarray(action, dtype=float)
    if values.shape != (size,):
        raise ValueError(f"action: must have shape ({size},), got {values.shape}")
    if not np.isfinite(values).all():
        raise EpisodeError(f"the action is not finite: {values.tolist()}")
    return values
