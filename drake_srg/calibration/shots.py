"""Images of the board with the poses of the hand, from a run or from a folder."""

from __future__ import annotations

import csv
import dataclasses as dc
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from drake_srg.calibration.board import find_corners
from drake_srg.calibration.mounting import Mounting
from drake_srg.calibration.projection import View
from drake_srg.common.exceptions import ScenarioError

POSES = "poses.csv"
COLUMNS = ("image", "x", "y", "z", "qw", "qx", "qy", "qz")


@dc.dataclass(frozen=True)
class Shot:
    """An image and the hand's pose as it was taken.

    Attributes:
        name: File name of the image.
        image: Grey (height, width) or RGB (height, width, 3).
        X_WH: Pose of the hand in the world, see `Mounting.hand_frame` [m].
    """

    name: str
    image: npt.NDArray[np.uint8]
    X_WH: RigidTransform


def find_views(shots: Iterable[Shot], mounting: Mounting) -> list[View]:
    """Return what each image shows of the board, in order.

    Raises:
        ScenarioError: If an image has another size than the camera's, or two in a row
            are the same although the hand has moved.
    """
    info = mounting.model.color
    size = (info.height(), info.width())
    views: list[View] = []
    last: Shot | None = None
    for shot in shots:
        if shot.image.shape[:2] != size:
            h, w = shot.image.shape[:2]
            raise ScenarioError(
                f"{shot.name}: image has {w} x {h} pixels (allowed: {size[1]} x "
                f"{size[0]}, as cameras.{mounting.camera})"
            )
        if last is not None and _frozen(last, shot):
            raise ScenarioError(
                f"{shot.name}: same image as {last.name}, but the hand has moved; the "
                "camera is frozen"
            )
        corners = find_corners(shot.image, mounting.board)
        X_PQ = mounting.X_PQ(shot.X_WH)
        views.append(View(shot.name, X_PQ, corners.p_B, corners.pixels))
        last = shot
    if views and not any(len(view.pixels) for view in views):
        board = mounting.board
        raise ScenarioError(
            f"none of {len(views)} images shows the board (allowed: {board.columns} x "
            f"{board.rows} squares, {board.dictionary})"
        )
    return views


def read_shots(folder: Path) -> list[Shot]:
    """Read a folder of images with the poses of the hand in `poses.csv`.

    Raises:
        ScenarioError: If a file is missing or invalid.
    """
    path = folder / POSES
    try:
        # Spreadsheets put a byte-order mark before the first column.
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            rows = list(reader)
    except (OSError, UnicodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or "not a CSV file in UTF-8"
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None
    missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
    if missing:
        raise ScenarioError(
            f"{path}: missing column {missing[0]} (allowed: {', '.join(COLUMNS)})"
        )
    return [
        _read_shot(folder, row, f"{path}: row {i}") for i, row in enumerate(rows, 2)
    ]


def shot_files(shots: Sequence[Shot]) -> dict[str, bytes]:
    """Return the files of a folder that `read_shots` reads, by name."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    files: dict[str, bytes] = {}
    for shot in shots:
        q, p = shot.X_WH.rotation().ToQuaternion(), shot.X_WH.translation()
        numbers = (*p, q.w(), q.x(), q.y(), q.z())
        writer.writerow([shot.name, *(f"{x:.9f}" for x in numbers)])
        # Grey, or RGB to OpenCV's order.
        image = shot.image if shot.image.ndim == 2 else shot.image[..., ::-1]
        files[shot.name] = bytes(cv2.imencode(".png", image)[1])
    return {POSES: text.getvalue().encode(), **files}


def _read_shot(folder: Path, row: Mapping[str, str | None], where: str) -> Shot:
    numbers: list[float] = []
    for name in COLUMNS[1:]:
        try:
            numbers.append(float(row[name] or ""))
        except ValueError:
            numbers.append(math.nan)
        if not math.isfinite(numbers[-1]):
            raise ScenarioError(f"{where}: {name}: must be a number, got {row[name]!r}")
    norm = float(np.linalg.norm(numbers[3:]))
    if abs(norm - 1.0) > 1e-3:
        raise ScenarioError(
            f"{where}: qw, qx, qy, qz must have norm 1 (allowed: within 0.001), got "
            f"{norm:.4g}"
        )
    name = row["image"] or ""
    file = folder / name
    # `imread` warns on standard error about a missing file.
    image = cv2.imread(str(file), cv2.IMREAD_COLOR) if file.is_file() else None
    if image is None:
        raise ScenarioError(f"{where}: image {name!r} cannot be read")
    rgb = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    rotation = Quaternion(np.array(numbers[3:]) / norm)
    return Shot(name, rgb, RigidTransform(rotation, numbers[:3]))


def _frozen(last: Shot, shot: Shot) -> bool:
    moved = not last.X_WH.IsNearlyEqualTo(shot.X_WH, 1e-3)
    return moved and np.array_equal(last.image, shot.image)
