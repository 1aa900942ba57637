"""The hand that points down and the object of all environments.

A pose is [x, y, z, yaw] of the frame `grasp_center` in world [m, rad]; the yaw is 0 if
the hand closes along the world's y.
"""

from __future__ import annotations

import dataclasses as dc
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol

import gymnasium
import numpy as np
import numpy.typing as npt
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.learning.envs.episode_station import EpisodeStation, Sight
from drake_srg.learning.envs.rewards import LIFTED, Truth, pick_progress
from drake_srg.learning.envs.scenes import CONTROL_PERIOD, Scene, SceneSource, Workspace
from drake_srg.scenario import LocalizerConfig, Scenario
from drake_srg.scenario.load import draw_scenario
from drake_srg.scenario.schema import check_single_arm
from drake_srg.simulation.rig import shake
from drake_srg.station.held_grasp import HeldGrasp
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector


class Mover(Protocol):
    """Turns poses of the hand into positions of an arm's joints."""

    def pose(self, q: Vector) -> Vector:
        """Return the hand's pose, shape (4,), at joint positions (N)."""

    def follow(self, q: Vector, pose: Vector) -> Vector:
        """Return joint positions (N) near `q`, at or nearer to a pose (4)."""


def MakeMover(plant: MultibodyPlant, home: Vector) -> Mover:
    """Make the mover of the arm in a finalized plant of a scenario's models.

    Raises:
        ScenarioError: If the hand does not point down at home.
    """
    arm = plant.GetModelInstanceByName("arm")
    kind = Gantry if plant.num_positions(arm) == 4 else Wrist
    mover: Mover = kind(plant)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, arm, home)
    frame = plant.GetFrameByName("grasp_center")
    pointing = frame.CalcPoseInWorld(context).rotation().matrix()[:, 0]
    if pointing[2] > -0.99:
        raise ScenarioError("arm.home: the hand of an environment must point down")
    return mover


def joints_at(mover: Mover, home: Vector, pose: Vector) -> Vector:
    """Return joint positions (N) at a pose (4), searched from home.

    Raises:
        ScenarioError: If the hand does not reach it.
    """
    q = home
    for _ in range(100):
        q = mover.follow(q, pose)
    off = mover.pose(q) - pose
    off[3] = (off[3] + np.pi) % (2.0 * np.pi) - np.pi
    if np.max(np.abs(off)) > 1e-3:
        place = np.round(pose[:3], 3).tolist()
        raise ScenarioError(f"task.region: the hand does not reach {place}")
    return q


class Gantry:
    """A gantry whose joints x, y, z and yaw are the numbers of the pose."""

    def __init__(self, plant: MultibodyPlant) -> None:
        arm = plant.GetModelInstanceByName("arm")
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, arm, np.zeros(4))
        frame = plant.GetFrameByName("grasp_center")
        self._origin = np.append(frame.CalcPoseInWorld(context).translation(), 0.0)

    def pose(self, q: Vector) -> Vector:
        """Return the hand's pose, shape (4,), at joint positions (N)."""
        return self._origin + q

    def follow(self, q: Vector, pose: Vector) -> Vector:
        """Return joint positions (N) near `q`, at or nearer to a pose (4)."""
        del q
        return pose - self._origin


class Wrist:
    """An arm of six joints or more, by damped least squares.

    Every call is one step of Newton's method. If the pose moves by centimetres per
    call, the hand follows it within a tenth of a millimetre.
    """

    # Damping of the pseudoinverse [m, rad]: at the kitchen's postures, it changes a
    # step by less than 1 %; near singular ones, it keeps the joints slow.
    _DAMPING = 0.02

    def __init__(self, plant: MultibodyPlant) -> None:
        self._plant = plant
        self._context = plant.CreateDefaultContext()  # scratch
        self._arm = plant.GetModelInstanceByName("arm")
        self._frame = plant.GetFrameByName("grasp_center")
        speeds = plant.GetVelocitiesFromArray(
            self._arm, np.arange(plant.num_velocities())
        )
        self._columns = speeds.astype(int)
        limits = [plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()]
        self._limits = [plant.GetPositionsFromArray(self._arm, x) for x in limits]

    def pose(self, q: Vector) -> Vector:
        """Return the hand's pose, shape (4,), at joint positions (N)."""
        self._plant.SetPositions(self._context, self._arm, q)
        X_WG = self._frame.CalcPoseInWorld(self._context)
        y = X_WG.rotation().matrix()[:, 1]
        return np.append(X_WG.translation(), np.arctan2(-y[0], y[1]))

    def follow(self, q: Vector, pose: Vector) -> Vector:
        """Return joint positions (N) near `q`, at or nearer to a pose (4)."""
        plant, context = self._plant, self._context
        plant.SetPositions(context, self._arm, q)
        X_WG = self._frame.CalcPoseInWorld(context)
        world = plant.world_frame()
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, self._frame, np.zeros(3), world, world
        )[:, self._columns]
        c, s = np.cos(pose[3]), np.sin(pose[3])
        # Columns: the hand's x down, its y sideways at the yaw, its z.
        R_WD = np.array([[0.0, -s, c], [0.0, c, s], [-1.0, 0.0, 0.0]])
        R = X_WG.rotation().matrix()
        turn = 0.5 * sum(_cross(R[:, i], R_WD[:, i]) for i in range(3))
        error = np.concatenate([turn, pose[:3] - X_WG.translation()])
        square = J @ J.T + self._DAMPING**2 * np.eye(6)
        step = J.T @ np.linalg.solve(square, error)
        return np.clip(q + step, *self._limits)


def _cross(a: Vector, b: Vector) -> Vector:
    # For so few numbers, this takes a tenth of the time of numpy.cross.
    return np.array(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )


# The shake that a grasp must survive: acceleration at its peak along x and y [m/s²],
# about 0.7 g together, at 2 Hz for 1.5 s from rest to rest.
_SHAKE = (np.array([6.0, 6.0, 0.0, 0.0]), 2.0, 1.5)
# An object is lost this far outside the hand's workspace [m], or at this speed [m/s],
# which far exceeds the hand's own. A small object that is flung away and spins would
# need shorter steps than a carried one.
_AWAY, _FLYING = 0.15, 1.5


def shaken(pose: Vector, time: float) -> Vector | None:
    """Return the pose (4) at a time [s] of the shake about a pose; None at its end."""
    acceleration, frequency, duration = _SHAKE
    if time > duration:
        return None
    moved: Vector = shake(pose, acceleration, frequency, duration)(time)
    return moved


class ObjectLostError(Exception):
    """The object flies or has left the workspace; the episode can no longer succeed."""


class HandTask:
    """A hand that points down and one object on a table, in a scenario.

    Attributes:
        places: Whether the hand must also reach `task.place.position`.

    Args:
        tree: Tree of the scenario, with the physics of an environment.
        origin: The scenario's name, for error messages.
        noise: Standard deviation of the object's estimated position [m].
        cameras: Names of the cameras to build.
        sees: Whether the estimate of the object's place comes from the localizer's
            cameras instead of the truth with noise.

    Raises:
        ScenarioError: If the scenario does not suit the task.
    """

    places: ClassVar[bool] = False

    def __init__(
        self,
        tree: Mapping[str, Any],
        origin: str,
        noise: float,
        cameras: Sequence[str] = (),
        *,
        sees: bool = False,
    ) -> None:
        self.scenes = SceneSource(tree, origin, noise)
        scenario = draw_scenario(tree, origin, 0).scenario
        check_single_arm(scenario, "an environment")
        assert scenario.arm is not None
        with scenario_errors(origin):
            self.station = EpisodeStation(episode_scenario(scenario, cameras))
            self._home = np.array(scenario.arm.home)
            self.mover = MakeMover(MakeModelsPlant(scenario), self._home)
            self._sight = Sight(scenario) if sees else None
        self.table = scenario.table.height
        self.goal = np.array(scenario.task.place.position)
        self.workspace = Workspace.of(scenario, goal=self.places)
        self._near = self.workspace.near(_AWAY).tolist()
        with scenario_errors(origin):
            self.q_start = self.joints_at(self.workspace.start)
        self._scene: Scene | None = None
        self._seen: Vector | None = None

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
        """Return joint positions at a pose, searched from home."""
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


def episode_scenario(scenario: Scenario, cameras: Sequence[str]) -> Scenario:
    """Return a scenario without parts that episodes do not need, with these cameras.

    Raises:
        ScenarioError: If one of them is missing.
    """
    for name in cameras:
        if name not in scenario.cameras:
            raise ScenarioError(f"cameras: {name!r} is missing, to render images")
    return dc.replace(
        scenario,
        cameras={name: scenario.cameras[name] for name in cameras},
        camera_errors={},
        localizer=LocalizerConfig(),
        disturbances=[],
        sleeping=None,
    )
