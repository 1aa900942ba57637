"""Results of a calibration: values, lines of text, and a scenario."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.robot.calibrate.mounting import Mounting
from drake_srg.robot.calibrate.solve import Calibration


def X_PB(result: Calibration, mounting: Mounting) -> RigidTransform:
    """Return the calibrated pose of the camera's body in its base frame [m]."""
    return result.estimate.X_PC @ mounting.model.X_BC.inverse()


def answer(
    result: Calibration, mounting: Mounting, *, simulated: bool
) -> dict[str, Any]:
    """Return the calibration as values for JSON, in metres, degrees and pixels.

    Args:
        result: The result of `calibrate`.
        mounting: The camera's mounting.
        simulated: Whether `mounting` describes the true camera. The entry `errors` then
            compares the result with it, and is None otherwise.
    """
    pose = X_PB(result, mounting)
    values = {
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
    if simulated:
        X_BE = mounting.X_PB.inverse() @ pose
        values["errors"] = {
            "position_m": float(np.linalg.norm(X_BE.translation())),
            "rotation_deg": float(np.degrees(X_BE.rotation().ToAngleAxis().angle())),
            "focal_px": (result.estimate.focal - mounting.focal).tolist(),
            "center_px": (result.estimate.center - mounting.center).tolist(),
        }
    return values


def overlay(found: Mapping[str, Any], base: str) -> str:
    """Return a scenario file: `base` with the calibrated camera.

    Args:
        found: The result of `answer`.
        base: A scenario's name, or its path relative to the file.
    """
    return "\n".join(
        [
            f"# {base} with its camera {found['camera']}, calibrated.",
            "# Written by `drake-srg calibrate camera`; standard deviations behind the",
            f"# values. {len(found['images'])} images, {found['rms_px']:.2f} pixels "
            "left (root mean square).",
            f"base: {base}",
            "",
            "camera_calibrations:",
            f"  {found['camera']}:",
            f"    focal: {_listed(found['focal_px'], 3)}"
            f"  # {_listed(found['focal_std_px'], 3)} pixels",
            f"    center: {_listed(found['center_px'], 3)}"
            f"  # {_listed(found['center_std_px'], 3)} pixels",
            "    X_PB:",
            f"      base_frame: {found['base_frame']}",
            f"      translation: {_listed(found['translation_m'], 6)}"
            f"  # {1e3 * found['position_std_m']:.3f} mm, all axes together",
            f"      rotation: !Rpy {{deg: {_listed(found['rpy_deg'], 5)}}}"
            f"  # {found['rotation_std_deg']:.4f} degrees",
            "",
        ]
    )


# By quantity: keys of the value, its standard deviation and its error, a factor for the
# unit, and the decimals of the value, and of deviation and error.
_ROWS = {
    "focal [pixels]": ("focal_px", "focal_std_px", "focal_px", 1.0, 2, 2),
    "center [pixels]": ("center_px", "center_std_px", "center_px", 1.0, 2, 2),
    "position [mm]": ("translation_m", "position_std_m", "position_m", 1e3, 2, 3),
    "roll, pitch, yaw [degrees]": (
        *("rpy_deg", "rotation_std_deg", "rotation_deg"),
        *(1.0, 3, 4),
    ),
}


def report(
    result: Calibration, mounting: Mounting, found: Mapping[str, Any]
) -> Iterator[str]:
    """Yield lines: values, standard deviations and, in simulation, errors."""
    kind = "in the hand" if mounting.in_hand else "fixed"
    count = sum(len(view.pixels) for view in result.views)
    yield (
        f"camera {mounting.camera}, {kind}: {count} corners in {len(result.views)} "
        f"images, {result.rms:.3f} pixels left (root mean square)"
    )
    for name, reason in result.dropped.items():
        yield f"{name}: dropped, {reason}"
    yield ""
    errors = found["errors"]
    head = f"{'quantity':26} {'value':>27} {'std. dev.':>12}"
    yield head + (f" {'true error':>12}" if errors else "")
    for name, (value, std, error, factor, digits, fine) in _ROWS.items():
        words = _words(factor * np.array(found[value]), digits)
        line = (
            f"{name:26} {words:>27} {_words(factor * np.array(found[std]), fine):>12}"
        )
        if errors:
            line += f" {_words(factor * np.array(errors[error]), fine):>12}"
        yield line
    yield f"condition number {result.condition:.0f}"


def _listed(values: Iterable[float], digits: int) -> str:
    return f"[{', '.join(f'{value:.{digits}f}' for value in values)}]"


def _words(values: Any, digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in np.atleast_1d(values))
