"""Base of the environments: an arm carries the SRG to one object on a table."""

from __future__ import annotations

import copy
import dataclasses as dc
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError, scenario_errors, suggest
from drake_srg.common.minimum_jerk import minimum_jerk_blend
from drake_srg.envs.episode_station import EpisodeStation, SimulationError
from drake_srg.envs.movers import MakeMover
from drake_srg.envs.physics import CONTROL_PERIOD, Physics, choose
from drake_srg.envs.rewards import LIFTED, REWARDS, Reward, Truth, pick_progress
from drake_srg.envs.scenes import Scene, SceneSource
from drake_srg.scenario import LocalizerConfig, Scenario
from drake_srg.scenario.load import draw_scenario
from drake_srg.simulation.bench import shake
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector

Observation = npt.NDArray[np.float32]

OBSERVATIONS = ("state",)
# The shake that a grasp must survive: acceleration at its peak along x and y [m/s²],
# about 0.7 g together, at 2 Hz for 1.5 s from rest to rest.
_SHAKE = (np.array([6.0, 6.0, 0.0, 0.0]), 2.0, 1.5)
# An object is lost this far outside the hand's workspace [m], or at this speed [m/s],
# which is far above the hand's own. A small object that is flung away and spins needs
# shorter steps than one that is carried.
_AWAY, _FLYING = 0.15, 1.5
# Height at the start of an episode, of the grasp centre above the table [m]: 5 cm over
# the tallest object.
START_HEIGHT = 0.17
# The open fingers' ends are 20 mm beyond the grasp centre [m].
LOWEST = 0.025


class ObjectLostError(Exception):
    """The object flies or has left the place: the episode cannot succeed any more."""


class HandEnv(gymnasium.Env[Any, Observation]):
    """An environment in which a hand that points down grasps one object.

    All environments share these keywords. See docs/learning.md for the observations and
    actions of each.

    Args:
        scenario: Name or path of the scenario: arm, gripper, table and the
            distributions of its one object.
        physics: `train`, `fast` or `accurate`; see `Physics`.
        driver: Of the gripper: `plant`, `position` or `tendon`.
        observation: `state`.
        reward: `shaped`, `success`, or a function; see `drake_srg.envs.rewards`.
        noise: Standard deviation of the object's estimated position [m].
        critic: Whether `info["critic"]` has the ground truth, see
            `critic_observation`.
        touch: Whether observations include the fingers' forces; zeros otherwise.
        render_mode: `rgb_array` for images of the scenario's video camera.
        overrides: Entries `KEY=VALUE` for the scenario, as for `load_scenario`.

    Raises:
        ScenarioError: On an invalid keyword or scenario.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "render_modes": ["rgb_array"],
        "render_fps": 1.0 / CONTROL_PERIOD,
    }
    # Meaning of the entries of an observation, and of an action.
    observation_names: Sequence[str] = ()
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
            allowed = [
                *("scenario", "physics", "driver", "observation", "reward", "noise"),
                *("touch", "critic", "render_mode", "overrides"),
            ]
            raise ScenarioError(f"unknown keyword {name!r} {suggest(name, allowed)}")
        choose("observation", observation, OBSERVATIONS)
        choose("render_mode", render_mode or "rgb_array", ("rgb_array",))
        if not callable(reward):
            choose("reward", reward, REWARDS)
        self.physics = Physics(physics, driver)
        self.render_mode = render_mode
        self.touch = touch
        self.critic = critic
        self._reward = reward if callable(reward) else REWARDS[reward]
        tree = self.physics.scenario_tree(scenario, overrides)
        self.scenes = SceneSource(tree, str(scenario), noise)
        loaded = draw_scenario(tree, str(scenario), 0).scenario
        with scenario_errors(str(scenario)):
            self.station = EpisodeStation(_for_episodes(loaded, render_mode))
            self._home = np.array(loaded.arm.home)  # type: ignore[union-attr]  # checked by scenario_tree
            self.mover = MakeMover(MakeModelsPlant(loaded), self._home)
        self.table = loaded.table.height
        self.goal = np.array(loaded.task.place.position)
        self._center = 0.5 * np.add(loaded.task.region.min, loaded.task.region.max)
        # Where the hand may go: the region and 8 cm around it [x, y, z].
        self._low = np.append(np.array(loaded.task.region.min) - 0.08, LOWEST)
        self._high = np.append(np.array(loaded.task.region.max) + 0.08, 0.3)
        self._low[2] += self.table
        self._high[2] += self.table
        self._q_start = self._joints_at(self.over(self._center, 0.0))
        self.scene: Scene | None = None
        n = len(self.observation_names)
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (n,), np.float32)
        n = len(self.action_names)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (n,), np.float32)

    def over(self, position: Vector, yaw: float) -> Vector:
        """Return the hand's pose (4) at the start height over a place [x, y]."""
        return np.array([*position, self.table + START_HEIGHT, yaw])

    def _joints_at(self, pose: Vector) -> Vector:
        """Return joint positions at a pose, found from home."""
        q = self._home
        for _ in range(100):
            q = self.mover.follow(q, pose)
        off = np.abs(self.mover.pose(q) - pose)
        if np.max(off) > 1e-3:
            raise ScenarioError(
                f"task.region: the hand does not reach {np.round(pose[:3], 3).tolist()}"
            )
        return q

    # Episodes.

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; `options={"scene": info["scene"]}` replays one.

        Raises:
            ScenarioError: If the options or the scene are invalid.
        """
        super().reset(seed=seed)
        for key in options or {}:
            if key != "scene":
                raise ScenarioError(f"options: unknown key {key!r} (allowed: scene)")
        if options and "scene" in options:
            self.scene = self.scenes.replay(options["scene"])
        else:
            self.scene = self.scenes.draw(self.np_random)
        self.begin(self._q_start)
        info = self.info(self.truth())
        info["scene"] = copy.deepcopy(dict(self.scene.tree))
        return self.observe(), info

    def begin(self, q: Vector) -> None:
        """Put arm and object at their start."""
        assert self.scene is not None, "call reset first"
        self.station.reset(self.scene, q)
        self.q_commanded = q
        self.pose = self.mover.pose(q)  # commanded
        self.closure = 0.0
        self.success = self.lost = False

    def tick(self, pose: Vector, closure: float) -> None:
        """Simulate one control period towards a pose (4) and a closure.

        Raises:
            SimulationError: If Drake gives up.
            ObjectLostError: If nothing can become of the episode any more.
        """
        self.pose, self.closure = pose, closure
        self.q_commanded = self.mover.follow(self.q_commanded, pose)
        self.station.advance(self.q_commanded, closure)
        p_WO = self.station.X_WO().translation()
        away = np.any(p_WO < self._low - _AWAY) or np.any(p_WO > self._high + _AWAY)
        if away or self.station.speed() > _FLYING:
            raise ObjectLostError

    def move(self, pose: Vector, closure: float, ticks: int) -> None:
        """Move the hand to a pose with minimum jerk."""
        start = self.pose
        for i in range(ticks):
            share = minimum_jerk_blend((i + 1) / ticks)
            self.tick(start + share * (pose - start), closure)

    def survives_shake(self) -> bool:
        """Shake the hand, and return whether the object is still up."""
        acceleration, frequency, duration = _SHAKE
        motion = shake(self.pose, acceleration, frequency, duration)
        for i in range(round(duration / CONTROL_PERIOD)):
            self.tick(motion((i + 1) * CONTROL_PERIOD), self.closure)
            if self.truth().height < 0.5 * LIFTED:
                return False
        return True

    # What came of it.

    @property
    def estimate(self) -> Vector:
        """Estimated position of the object, [x, y, z, yaw], shape (4,)."""
        assert self.scene is not None
        thing = self.scene.object
        xy = np.add(thing.position, self.scene.estimate_error)
        yaw = 0.0 if self.scene.is_round else thing.yaw
        return np.array([*xy, self.table + 0.5 * self.scene.shape.height, yaw])

    def hand(self) -> Vector:
        """Return the hand's measured pose, shape (4,)."""
        state = self.station.measured("arm.state_measured")
        return self.mover.pose(state[: len(self._home)])

    def truth(self) -> Truth:
        """Return the present ground truth."""
        assert self.scene is not None
        X_WO = self.station.X_WO()
        p_WO = X_WO.translation()
        down = -X_WO.rotation().matrix()[2]
        height = float(p_WO[2] - self.scene.shape.half_extent(down) - self.table)
        hand = self.mover.pose(self.station.q())
        reach = math.dist(p_WO, hand[:3])
        force = self.station.measured("gripper.contact_force").tolist()
        touching = 0.5 * (max(force[::2]) > 0.0) + 0.5 * (max(force[1::2]) > 0.0)
        return Truth(
            reach=reach,
            height=height,
            touching=touching,
            progress=pick_progress(reach, touching, height),
            success=self.success,
            lost=self.lost,
            scene=self.scene,
            station=self.station,
        )

    def info(self, truth: Truth) -> dict[str, Any]:
        """Return what only the trainer may know."""
        info: dict[str, Any] = {
            "success": truth.success,
            "failure": "",
        }
        if self.critic:
            info["critic"] = self.critic_observation(truth)
        return info

    def critic_observation(self, truth: Truth) -> Observation:
        """Return the ground truth as numbers, for critics that are not deployed.

        They are the observation's entries with the true place of the object, and its
        mass [kg], friction, height above the table [m] and speed [m/s].
        """
        scene, station = truth.scene, self.station
        p = station.X_WO().translation() - self.mover.pose(station.q())[:3]
        plant = station.plant.get_body(station._body)
        mass = plant.get_mass(station.plant_context)
        values = [*p, mass, scene.object.friction or 0.0, truth.height, station.speed()]
        return np.clip(np.array(values, dtype=np.float32), -10.0, 10.0)

    def observe(self) -> Observation:
        """Return the observation."""
        raise NotImplementedError

    def failed_step(
        self, error: SimulationError
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Return what a step returns that Drake could not simulate."""
        info: dict[str, Any] = {
            "success": False,
            "failure": str(error),
        }
        if self.critic:
            info["critic"] = np.zeros(7, dtype=np.float32)
        return (
            np.zeros(self.observation_space.shape, np.float32),
            0.0,
            False,
            True,
            info,
        )

    def render(self) -> npt.NDArray[np.uint8] | None:  # type: ignore[override]  # one frame
        """Return an image (height, width, 3) of the video camera."""
        if self.render_mode is None:
            return None
        camera = self.station.scenario.recording.video_camera
        image = self.station.measured(f"camera_{camera}.color_image")
        return np.array(image.data[:, :, :3])


def _for_episodes(scenario: Scenario, render_mode: str | None) -> Scenario:
    """Return a scenario without what episodes do not need."""
    video = scenario.recording.video_camera
    if render_mode is not None and video not in scenario.cameras:
        raise ScenarioError("recording.video_camera: must name a camera to render")
    cameras = {video: scenario.cameras[video]} if render_mode is not None else {}
    return dc.replace(
        scenario,
        cameras=cameras,
        camera_errors={},
        localizer=LocalizerConfig(),
        disturbances=[],
        sleeping=None,
    )
