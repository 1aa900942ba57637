"""Motions of a hand that points down, and the shake that a grasp must survive.

A pose is [x, y, z, yaw] of the frame `grasp_center` in world [m, rad]; the yaw is 0 if
the hand closes along the world's y.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import LocalizerConfig, Scenario
from drake_srg.simulation.rig import shake
from drake_srg.types import Vector


class Mover(Protocol):
    """Turns poses of the hand into positions of an arm's joints."""

    def pose(self, q: Vector) -> Vector:
        """Return the hand's pose, shape (4,), at joint positions (N)."""

    def follow(self, q: Vector, pose: Vector) -> Vector:
        """Return joint positions (N) at a pose (4), or one step from `q` towards it."""


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
    """Return joint positions (N) at a pose (4); the search starts at home.

    Raises:
        ScenarioError: If the hand does not reach the pose.
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
        """Return joint positions (N) at a pose (4), or one step from `q` towards it."""
        del q
        return pose - self._origin


class Wrist:
    """An arm of six joints or more, moved by damped least squares.

    Every call of `follow` is one step of Newton's method. If the pose moves by
    centimetres per call, the hand follows it within a tenth of a millimetre.
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
        """Return joint positions (N) at a pose (4), or one step from `q` towards it."""
        plant, context = self._plant, self._context
        plant.SetPositions(context, self._arm, q)
        X_WG = self._frame.CalcPoseInWorld(context)
        world = plant.world_frame()
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, self._frame, np.zeros(3), world, world
        )[:, self._columns]
        c, s = np.cos(pose[3]), np.sin(pose[3])
        # Desired axes of the hand as columns: x points down, y lies at the yaw.
        R_WD = np.array([[0.0, -s, c], [0.0, c, s], [-1.0, 0.0, 0.0]])
        R = X_WG.rotation().matrix()
        turn = 0.5 * sum(_cross(R[:, i], R_WD[:, i]) for i in range(3))
        error = np.concatenate([turn, pose[:3] - X_WG.translation()])
        square = J @ J.T + self._DAMPING**2 * np.eye(6)
        step = J.T @ np.linalg.solve(square, error)
        return np.clip(q + step, *self._limits)


def _cross(a: Vector, b: Vector) -> Vector:
    # For single vectors, this takes a tenth of the time of numpy.cross.
    return np.array(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )


# The shake that a grasp must survive: amplitude of the acceleration along x, y, z and
# yaw [m/s², rad/s²], frequency [Hz] and duration [s]. Because it swells and fades, its
# peak is about 0.7 g in all.
_SHAKE = (np.array([6.0, 6.0, 0.0, 0.0]), 2.0, 1.5)


def shaken(pose: Vector, time: float) -> Vector | None:
    """Return the pose (4) at a time [s] of the shake about a pose; None at its end."""
    acceleration, frequency, duration = _SHAKE
    if time > duration:
        return None
    moved: Vector = shake(pose, acceleration, frequency, duration)(time)
    return moved


class ObjectLostError(Exception):
    """The object flies or has left the workspace; the episode can no longer succeed."""


def episode_scenario(scenario: Scenario, cameras: Sequence[str]) -> Scenario:
    """Return a scenario with these cameras, without parts that episodes do not need.

    Raises:
        ScenarioError: If a camera is missing.
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
