"""Rendered and synthetic calibrations of cameras with known truth."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.calibrate.mounting import Board, Mounting, mount
from drake_srg.robot.calibrate.overlay import X_PB
from drake_srg.robot.calibrate.shots import find_views, take_shots
from drake_srg.robot.calibrate.solve import (
    Calibration,
    Unknowns,
    View,
    calibrate,
    residuals,
)
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station.planners import own_scene
from drake_srg.types import Vector
from drake_srg.vision.camera import CameraCalibrationConfig

# Noise and blur of a good camera indoors, see `CameraErrorsConfig`.
_NOISE = {"color_noise": 2.0, "blur": 0.5}
# How far the first guess of the focal lengths is off, as a share.
_WRONG_FOCAL = 0.05


@dc.dataclass(frozen=True)
class Cell:
    """A camera that is calibrated in a scenario."""

    scenario: str
    camera: str
    overrides: tuple[str, ...] = ()


# Nothing touches while the arm shows the board, so the kitchen takes longer steps.
_STEP = "plant_config.time_step=0.005"
CELLS = {
    "kitchen": Cell("kitchen", "ceiling", (_STEP,)),
    "assistive arm": Cell("assistive_arm", "ceiling"),
    "camera in the hand": Cell("kitchen_hand_camera", "hand", (_STEP,)),
}


@dc.dataclass(frozen=True)
class Trial:
    """How far a calibration was off, and how far it said it might be.

    Attributes:
        position: Error of the camera's position [m].
        rotation: Error of its rotation [rad].
        focal: Largest error of a focal length, as a share of it.
        center: Error of the principal point [pixels].
        position_std: Standard deviation of the position, all axes together [m].
        rotation_std: Of the rotation [rad].
        rms: What is left of the residuals, root mean square [pixels].
    """

    position: float
    rotation: float
    focal: float
    center: float
    position_std: float
    rotation_std: float
    rms: float


@dc.dataclass(frozen=True)
class Rendered:
    """A calibration from rendered images.

    Attributes:
        mounting: Of its camera.
        truth: The camera and the board as simulated.
        views: What the images showed.
        result: The calibration; None if it failed.
    """

    mounting: Mounting
    truth: Unknowns
    views: list[View]
    result: Calibration | None

    def trial(self) -> Trial | None:
        """Return the errors of the calibration, or nothing if it failed."""
        return None if self.result is None else judge(self.result, self.truth)


def render(cell: Cell, seed: int, images: int) -> Rendered:
    """Calibrate a camera once, from images of a simulated run."""
    noise = [f"camera_errors.{cell.camera}.{k}={v}" for k, v in _NOISE.items()]
    scenario = load_scenario(
        cell.scenario, seed=seed, overrides=[*cell.overrides, *noise]
    )
    scene = own_scene(scenario)
    mounting = mount(scenario, cell.camera, scene, Board())
    shots = take_shots(scenario, mounting, scene, images)
    views = find_views(shots, mounting)
    truth = Unknowns(
        mounting.focal,
        mounting.center,
        mounting.X_PB @ mounting.model.X_BC,
        mounting.X_QO,
    )
    return Rendered(mounting, truth, views, _try(views, truth))


def synthesize(
    runs: list[Rendered], rng: np.random.Generator, images: int
) -> Trial | None:
    """Calibrate a camera from views drawn from runs, with their corner errors.

    The camera and the board are moved at random by some centimetres and degrees. The
    errors of a view's corners are those of one rendered view, so neighbours err alike.

    Args:
        runs: Of one cell.
        rng: Draws.
        images: Number of views.

    Returns:
        The errors of the calibration, or nothing if it failed.
    """
    truth = dc.replace(
        runs[0].truth,
        X_PC=runs[0].truth.X_PC @ _random_pose(rng, 0.01, np.radians(2.0)),
        X_QB=runs[0].truth.X_QB @ _random_pose(rng, 0.005, np.radians(2.0)),
    )
    pool = [
        (view, residuals(run.truth, view))
        for run in runs
        for view in run.views
        if len(view.pixels)
    ]
    views = []
    for i in rng.choice(len(pool), images, replace=False):
        view, _ = pool[i]
        _, errors = pool[rng.integers(len(pool))]
        # A view with fewer corners lends some of its errors twice.
        drawn = np.resize(errors, (len(view.pixels), 2))
        exact = residuals(truth, view) + view.pixels
        views.append(dc.replace(view, pixels=exact + drawn))
    result = _try(views, truth, rng.uniform(-1.0, 1.0, 2))
    return None if result is None else judge(result, truth)


def judge(result: Calibration, truth: Unknowns) -> Trial:
    """Return the errors of a calibration."""
    estimate = result.estimate
    X_CE = truth.X_PC.inverse() @ estimate.X_PC
    return Trial(
        position=float(np.linalg.norm(X_CE.translation())),
        rotation=float(X_CE.rotation().ToAngleAxis().angle()),
        focal=float(np.max(np.abs(estimate.focal / truth.focal - 1.0))),
        center=float(np.linalg.norm(estimate.center - truth.center)),
        position_std=result.position_std,
        rotation_std=result.rotation_std,
        rms=result.rms,
    )


def corner_errors(runs: Sequence[Rendered]) -> Vector:
    """Return the errors of all corners that the runs have found [pixels], (K, 2)."""
    return np.concatenate([residuals(run.truth, v) for run in runs for v in run.views])


def calibrated(scenario: Scenario, rendered: Rendered) -> Scenario:
    """Return a scenario whose localizer believes a rendered calibration."""
    result, mounting = rendered.result, rendered.mounting
    assert result is not None
    pose = Transform(X_PB(result, mounting))
    pose.base_frame = mounting.base_frame
    center = result.estimate.center + mounting.model.pixel_center
    config = CameraCalibrationConfig(
        focal=result.estimate.focal.tolist(), center=center.tolist(), X_PB=pose
    )
    return dc.replace(scenario, camera_calibrations={mounting.camera: config})


def _try(
    views: list[View], truth: Unknowns, guess: Vector | None = None
) -> Calibration | None:
    wrong = np.ones(2) if guess is None else guess
    try:
        return calibrate(
            views,
            truth.focal * (1.0 + _WRONG_FOCAL * wrong),
            truth.center + 10.0 * wrong,
        )
    except ScenarioError:
        return None


def _random_pose(
    rng: np.random.Generator, distance: float, angle: float
) -> RigidTransform:
    """Return a pose at a distance [m] and an angle [rad] in random directions."""
    axis, way = rng.normal(size=(2, 3))
    turn = AngleAxis(angle, axis / np.linalg.norm(axis))
    return RigidTransform(turn, distance * way / np.linalg.norm(way))
