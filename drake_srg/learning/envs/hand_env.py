"""Base class of the environments: keywords, spaces, episodes, motions, images."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError, scenario_errors, suggest
from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.learning.envs.episode_station import (
    EpisodeStation,
    Sight,
    SimulationError,
)
from drake_srg.learning.envs.hand_task import (
    MakeMover,
    ObjectLostError,
    episode_scenario,
    joints_at,
    shaken,
)
from drake_srg.learning.envs.rewards import (
    LIFTED,
    REWARDS,
    STEP_REWARDS,
    Reward,
    Truth,
    pick_progress,
)
from drake_srg.learning.envs.scenes import (
    CONTROL_PERIOD,
    Physics,
    Scene,
    SceneSource,
    Workspace,
    choose,
)
from drake_srg.scenario.load import draw_scenario
from drake_srg.scenario.schema import check_single_arm
from drake_srg.station.held_grasp import HeldGrasp
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector

State = npt.NDArray[np.float32]
Observation = State | dict[str, npt.NDArray[Any]]
Step = tuple[Observation, float, bool, bool, dict[str, Any]]

OBSERVATIONS = ("state", "blobs", "images")
_KEYWORDS = (
    *("scenario", "physics", "driver", "observation", "reward", "noise", "touch"),
    *("render_mode", "overrides"),
)

# An object is lost this far outside the hand's workspace [m], or at this speed [m/s],
# which far exceeds the hand's own. The episode ends then, because a small object that
# is flung away and spins would need shorter time steps than a carried one.
_AWAY, _FLYING = 0.15, 1.5


class HandEnv(gymnasium.Env[Any, Any]):
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
            Environments without a lift accept only `shaped`, `success` or a function.
        noise: Standard deviation of the object's estimated position [m].
        touch: Whether observations include the fingers' forces; zeros otherwise.
        render_mode: `rgb_array` for images of the scenario's video camera.
        overrides: Entries `KEY=VALUE` for the scenario, as for `load_scenario`.

    Raises:
        ScenarioError: On an invalid keyword or scenario.
    """

    metadata = {  # noqa: RUF012 (gymnasium declares it)
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / CONTROL_PERIOD),
    }
    # Meanings of the entries of a state, and of an action.
    observation_names: Sequence[str] = ()
    action_names: Sequence[str] = ()
    # Whether an episode ends with a lift and a shake, which some rewards need.
    judges_lift: ClassVar[bool] = True
    # Steps of the plant per control period; see `Physics`.
    train_steps: ClassVar[int] = 2
    # Whether the hand must also reach `task.place.position`.
    places: ClassVar[bool] = False

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
        origin = str(scenario)
        self.scenes = SceneSource(tree, origin, noise)
        first = draw_scenario(tree, origin, 0).scenario
        check_single_arm(first, "an environment")
        assert first.arm is not None
        with scenario_errors(origin):
            self.station = EpisodeStation(episode_scenario(first, cameras))
            self._home = np.array(first.arm.home)
            self.mover = MakeMover(MakeModelsPlant(first), self._home)
            self._sight = Sight(first) if observation == "blobs" else None
        self.table = first.table.height
        self.goal = np.array(first.task.place.position)
        self.workspace = Workspace.of(first, goal=self.places)
        self._near = self.workspace.near(_AWAY).tolist()
        with scenario_errors(origin):
            self.q_start = self.joints_at(self.workspace.start)
        self._scene: Scene | None = None
        self._seen: Vector | None = None
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
        """Return the observation as a vector, each entry -1 .. 1."""
        raise NotImplementedError

    def observe(self) -> Observation:
        """Return the observation."""
        if self._camera is None:
            return self.state()
        return {"state": self.state(), "image": self.image(self._camera)}

    def info(self, truth: Truth) -> dict[str, Any]:
        """Return the ground truth, which only the trainer may use."""
        return {"success": truth.success, "failure": ""}

    def failed_step(self, error: Exception) -> Step:
        """Return the result of a step that could not be simulated."""
        info: dict[str, Any] = {"success": False, "failure": str(error)}
        observation: Observation = np.zeros(len(self.observation_names), np.float32)
        if self._camera is not None:
            image = self.image(self._camera)
            observation = {"state": np.asarray(observation), "image": image}
        return observation, 0.0, False, True, info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return an image (height, width, 3) of the video camera."""
        return self.image(self._video) if self.render_mode is not None else None

    # The simulation.

    @property
    def scene(self) -> Scene:
        """The present episode's object.

        Raises:
            gymnasium.error.ResetNeeded: Before the first episode.
        """
        if self._scene is None:
            raise gymnasium.error.ResetNeeded("call reset() before the first step")
        return self._scene

    def joints_at(self, pose: Vector) -> Vector:
        """Return joint positions at a pose; the search starts at home."""
        return joints_at(self.mover, self._home, pose)

    def look(self, scene: Scene) -> None:
        """Estimate an object's place from the cameras' images, with the arm at home.

        The estimate of an unseen object is the middle of the region.
        """
        if self._sight is None:
            return
        self.begin(scene, self._home)
        self._seen = self._sight.find(self.station, scene)
        if self._seen is None:
            height = self.table + 0.5 * scene.shape.height
            self._seen = np.array([*self.workspace.start[:2], height, 0.0])

    def begin(self, scene: Scene, q: Vector) -> None:
        """Put object and arm at their start."""
        self._scene = scene
        self.station.reset(scene, q)
        self.q_commanded = q
        self.pose = self.mover.pose(q)  # commanded
        self.closure = 0.0
        self.success = self.lost = False
        self.grasp: HeldGrasp | None = None

    def tick(self, pose: Vector, closure: float) -> None:
        """Simulate one control period towards a pose (4) and a closure.

        Raises:
            SimulationError: If Drake gives up.
            ObjectLostError: If the episode can no longer succeed.
        """
        self.pose, self.closure = pose, closure
        self.q_commanded = self.mover.follow(self.q_commanded, pose)
        self.station.advance(self.q_commanded, closure)
        *p_WO, vx, vy, vz = self.station.motion()
        near = all(
            low < x < high for x, (low, high) in zip(p_WO, self._near, strict=True)
        )
        if not near or math.hypot(vx, vy, vz) > _FLYING:
            raise ObjectLostError

    def move(self, pose: Vector, closure: float, ticks: int) -> None:
        """Move the hand to a pose with minimum jerk."""
        start = self.pose
        for i in range(ticks):
            share = minimum_jerk_blend((i + 1) / ticks)
            self.tick(start + share * (pose - start), closure)

    def survives_shake(self) -> bool:
        """Read the grasp, shake the hand, and return whether the object is still up."""
        self.grasp = self.station.grasp()
        start, ticks = self.pose, itertools.count(1)
        while (pose := shaken(start, next(ticks) * CONTROL_PERIOD)) is not None:
            self.tick(pose, self.closure)
            if self.height() < 0.5 * LIFTED:
                return False
        return True

    # The result.

    @property
    def estimate(self) -> Vector:
        """Estimated position of the object, [x, y, z, yaw], shape (4,)."""
        if self._seen is not None:
            return self._seen
        xy = self.scene.position + self.scene.estimate_error
        yaw = 0.0 if self.scene.is_round else self.scene.object.yaw
        return np.array([*xy, self.table + 0.5 * self.scene.shape.height, yaw])

    def hand(self) -> Vector:
        """Return the hand's measured pose, shape (4,)."""
        state = self.station.measured("arm.state_measured")
        return self.mover.pose(state[: len(self._home)])

    def height(self) -> float:
        """Return the true height of the object's lowest point above the table [m]."""
        X_WO = self.station.X_WO()
        down = -X_WO.rotation().matrix()[2]
        half = self.scene.shape.half_extent(down)
        return float(X_WO.translation()[2] - half - self.table)

    def truth(self) -> Truth:
        """Return the present ground truth."""
        p_WO = self.station.X_WO().translation()
        height = self.height()
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
            grasp=self.grasp,
            station=self.station,
        )

    def image(self, camera: str) -> npt.NDArray[np.uint8]:
        """Return a camera's present image, RGB (height, width, 3)."""
        image = self.station.measured(f"camera_{camera}.color_image")
        return np.array(image.data[:, :, :3])


def _box(size: int) -> gymnasium.spaces.Box:
    return gymnasium.spaces.Box(-1.0, 1.0, (size,), np.float32)


def clipped(values: Vector) -> State:
    """Return an observation or action, clipped to -1 .. 1."""
    return np.clip(values, -1.0, 1.0).astype(np.float32)


def checked(action: Any) -> Vector:
    """Return an action as an array of floats.

    Raises:
        SimulationError: If an entry is not finite.
    """
    values = np.asarray(action, dtype=float)
    if not np.isfinite(values).all():
        raise SimulationError(f"the action is not finite: {values.tolist()}")
    return values
