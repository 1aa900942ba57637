"""Results of a calibration: a scenario, lines of text, and its errors."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable, Iterator

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.robot.calibrate.mounting import Mounting
from drake_srg.robot.calibrate.solve import Calibration
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class TrueErrors:
    """Errors of a calibration in simulation, against the simulated camera.

    Attributes:
        position: Of the camera's body [m], shape (3,), in the body.
        rotation: Angle of the camera's body [rad].
        focal: Of the focal lengths [pixels], shape (2,).
        center: Of the principal point [pixels], shape (2,).
    """

    position: Vector
    rotation: float
    focal: Vector
    center: Vector


def X_PB(result: Calibration, mounting: Mounting) -> RigidTransform:
    """Return the calibrated pose of the camera's body in its base frame [m]."""
    return result.estimate.X_PC @ mounting.model.X_BC.inverse()


def true_errors(result: Calibration, mounting: Mounting) -> TrueErrors:
    """Return the errors of a calibration of the camera that `mounting` describes."""
    X_BE = mounting.X_PB.inverse() @ X_PB(result, mounting)
    return TrueErrors(
        np.array(X_BE.translation()),
        float(X_BE.rotation().ToAngleAxis().angle()),
        result.estimate.focal - mounting.focal,
        result.estimate.center - mounting.center,
    )


def overlay(result: Calibration, mounting: Mounting, base: str) -> str:
    """Return a scenario file: `base` with the calibrated camera.

    Args:
        result: Of `calibrate`.
        mounting: Of the camera.
        base: A scenario: its name, or its path from the file.
    """
    pose = X_PB(result, mounting)
    degrees = np.degrees(RollPitchYaw(pose.rotation()).vector())
    center = result.estimate.center + mounting.model.pixel_center
    return "\n".join(
        [
            f"# {base} with its camera {mounting.camera}, calibrated.",
            "# Written by `drake-srg calibrate camera`; standard deviations behind the",
            f"# values. {len(result.views)} images, {result.rms:.2f} pixels left (root "
            "mean square).",
            f"base: {base}",
            "",
            "camera_calibrations:",
            f"  {mounting.camera}:",
            f"    focal: {_listed(result.estimate.focal, 3)}"
            f"  # {_listed(result.focal_std, 3)} pixels",
            f"    center: {_listed(center, 3)}"
            f"  # {_listed(result.center_std, 3)} pixels",
            "    X_PB:",
            f"      base_frame: {mounting.base_frame}",
            f"      translation: {_listed(pose.translation(), 6)}"
            f"  # {1e3 * result.position_std:.3f} mm, all axes together",
            f"      rotation: !Rpy {{deg: {_listed(degrees, 5)}}}"
            f"  # {np.degrees(result.rotation_std):.4f} degrees",
            "",
        ]
    )


def report(
    result: Calibration, mounting: Mounting, errors: TrueErrors | None
) -> Iterator[str]:
    """Yield lines: values with standard deviations, and in simulation their errors."""
    kind = "in the hand" if mounting.in_hand else "fixed"
    count = sum(len(view.pixels) for view in result.views)
    yield (
        f"camera {mounting.camera}, {kind}: {count} corners in {len(result.views)} "
        f"images, {result.rms:.3f} pixels left (root mean square)"
    )
    for name, reason in result.dropped.items():
        yield f"{name}: dropped, {reason}"
    yield ""
    head = f"{'quantity':26} {'value':>27} {'std. dev.':>12}"
    yield head + (f" {'true error':>12}" if errors else "")
    pose = X_PB(result, mounting)
    degrees = np.degrees(RollPitchYaw(pose.rotation()).vector())
    center = result.estimate.center + mounting.model.pixel_center
    for name, value, std, error in (
        (
            "focal [pixels]",
            _words(result.estimate.focal, 2),
            _words(result.focal_std, 2),
            errors and _words(errors.focal, 2),
        ),
        (
            "center [pixels]",
            _words(center, 2),
            _words(result.center_std, 2),
            errors and _words(errors.center, 2),
        ),
        (
            "position [mm]",
            _words(1e3 * pose.translation(), 2),
            f"{1e3 * result.position_std:.3f}",
            errors and f"{1e3 * np.linalg.norm(errors.position):.3f}",
        ),
        (
            "roll, pitch, yaw [degrees]",
            _words(degrees, 3),
            f"{np.degrees(result.rotation_std):.4f}",
            errors and f"{np.degrees(errors.rotation):.4f}",
        ),
    ):
        line = f"{name:26} {value:>27} {std:>12}"
        yield line + (f" {error:>12}" if error else "")
    yield f"condition number {result.condition:.0f}"


def answer(
    result: Calibration, mounting: Mounting, errors: TrueErrors | None
) -> dict[str, object]:
    """Return the calibration as JSON's values: metres, degrees and pixels."""
    pose = X_PB(result, mounting)
    values: dict[str, object] = {
        "camera": mounting.camera,
        "base_frame": mounting.base_frame,
        "focal_px": result.estimate.focal.tolist(),
        "focal_std_px": result.focal_std.tolist(),
        "center_px": (result.estimate.center + mounting.model.pixel_center).tolist(),
        "center_std_px": result.center_std.tolist(),
        "translation_m": pose.translation().tolist(),
        "position_std_m": result.position_std,
        "rpy_deg": np.degrees(RollPitchYaw(pose.rotation()).vector()).tolist(),
        "rotation_std_deg": float(np.degrees(result.rotation_std)),
        "rms_px": result.rms,
        "condition": result.condition,
        "images": [view.name for view in result.views],
        "dropped": result.dropped,
        "errors": None,
    }
    if errors is not None:
        values["errors"] = {
            "position_m": float(np.linalg.norm(errors.position)),
            "rotation_deg": float(np.degrees(errors.rotation)),
            "focal_px": errors.focal.tolist(),
            "center_px": errors.center.tolist(),
        }
    return values


def _listed(values: Iterable[float], digits: int) -> str:
    return f"[{', '.join(f'{value:.{digits}f}' for value in values)}]"


def _words(values: Iterable[float], digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
