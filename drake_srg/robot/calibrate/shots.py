"""Images of the board with poses of the hand, from a simulation or a folder."""

from __future__ import annotations

import contextlib
import csv
import dataclasses as dc
import io
import itertools
import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.tables import read_table
from drake_srg.planning.motion.inverse_kinematics import (
    AxisTarget,
    HandTarget,
    find_posture,
)
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.paths import plan_joint_path
from drake_srg.planning.motion.planning_scene import PlanningFailure, PlanningScene
from drake_srg.robot.calibrate.mounting import (
    THICKNESS,
    Mounting,
    find_corners,
    with_board,
)
from drake_srg.robot.calibrate.solve import View
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig
from drake_srg.types import Box, Vector

POSES = "poses.csv"
COLUMNS = ("image", "x", "y", "z", "qw", "qx", "qy", "qz")


@dc.dataclass(frozen=True)
class Shot:
    """An image, and the hand's pose when it was taken.

    Attributes:
        name: File name of the image.
        image: Grey (height, width) or RGB (height, width, 3).
        X_WH: Pose of the hand in the world, see `Mounting.hand_frame` [m].
    """

    name: str
    image: npt.NDArray[np.uint8]
    X_WH: RigidTransform


def find_views(shots: Sequence[Shot], mounting: Mounting) -> list[View]:
    """Return a view of the board for each image, in order.

    If no image shows the board, look for a board made by OpenCV before 4.6.

    Raises:
        ScenarioError: If an image has another size than the camera's, or two in a row
            are the same although the hand has moved.
    """
    info = mounting.model.color
    size = (info.height(), info.width())
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
        last = shot
    board = mounting.board
    for candidate in (board, dc.replace(board, legacy=True)):
        views = []
        for shot in shots:
            corners = find_corners(shot.image, candidate)
            X_PQ = mounting.X_PQ(shot.X_WH)
            views.append(View(shot.name, X_PQ, corners.p_B, corners.pixels))
        if any(len(view.pixels) for view in views):
            if candidate.legacy:
                logging.getLogger("drake_srg").warning(
                    "the board was made by OpenCV before 4.6: a white square is first"
                )
            return views
    if not shots:
        return []
    raise ScenarioError(
        f"none of {len(shots)} images shows the board (allowed: {board.columns} x "
        f"{board.rows} squares, {board.dictionary})"
    )


def read_shots(folder: Path) -> list[Shot]:
    """Read a folder of images with the poses of the hand in `poses.csv`.

    Raises:
        ScenarioError: If a file is missing or invalid.
    """
    rows = read_table(folder / POSES, COLUMNS)
    return [_read_shot(folder, row, where) for where, row in rows]


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
        # Grey, or RGB, which OpenCV wants as BGR.
        image = shot.image if shot.image.ndim == 2 else shot.image[..., ::-1]
        files[shot.name] = bytes(cv2.imencode(".png", image)[1])
    return {POSES: text.getvalue().encode(), **files}


def _read_shot(folder: Path, row: Mapping[str, str], where: str) -> Shot:
    numbers: list[float] = []
    for name in COLUMNS[1:]:
        try:
            numbers.append(float(row[name]))
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
    name = row["image"]
    file = folder / name
    image = None
    if file.is_file():  # `imread` warns on standard error about a missing file
        with contextlib.suppress(cv2.error):  # raised if it has too many pixels
            image = cv2.imread(str(file), cv2.IMREAD_COLOR)
    if image is None:
        raise ScenarioError(f"{where}: image {name!r} cannot be read")
    rgb = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
    rotation = Quaternion(np.array(numbers[3:]) / norm)
    return Shot(name, rgb, RigidTransform(rotation, numbers[:3]))


def _frozen(last: Shot, shot: Shot) -> bool:
    moved = not last.X_WH.IsNearlyEqualTo(shot.X_WH, 1e-3)
    return moved and np.array_equal(last.image, shot.image)


# Pixels per cell of a marker. The detector also reads cells of 2.5 pixels, but finds
# corners half as accurately.
_CELL_PIXELS = 3.0
# The board's diagonal fills at most this share of the image's height.
_MOST_FILLED = 0.8
# Angle between the board's normal and the line of sight [rad]. Tilted boards determine
# the pose best, but the detector does not read markers that are foreshortened too much.
_LEAST_TILT, _MOST_TILT = np.radians(10.0), np.radians(40.0)
_TILT_TOLERANCE = np.radians(5.0)
# Random views to try for each wanted view.
_TRIES = 12


def plan_visits(
    mounting: Mounting, scene: PlanningScene, home: Vector, count: int, seed: int
) -> list[Vector]:
    """Plan paths from posture to posture, the first from home.

    Args:
        mounting: Camera and board.
        scene: The arm, and what to keep clear of.
        home: The posture to start from, shape (N,) [rad].
        count: How many postures.
        seed: Seed of the random views.

    Returns:
        Waypoints (K, N) [rad] that straight joint lines connect, for each posture.

    Raises:
        ScenarioError: If the arm reaches too few postures, or the image is too small
            to read the board.
    """
    box = Box([*mounting.board.size, THICKNESS])
    X_OB = RigidTransform([*mounting.board.center[:2], 0.5 * THICKNESS])
    paths: list[Vector] = []
    at = home
    # If the arm moves the camera, the board lies on the table, far from the hand.
    if mounting.in_hand:
        held = scene.standing(box, mounting.X_QO @ X_OB)
    else:
        held = scene.holding(box, mounting.X_QO @ X_OB)
    with held:
        for i, target in enumerate(_targets(mounting, scene, home, count, seed)):
            found = find_posture(
                scene, target, q_nominal=home, q_guess=at, max_starts=4, seed=i
            )
            if found is None:
                continue
            path = plan_joint_path(scene, at, found.q, max_iterations=100, seed=seed)
            if isinstance(path, PlanningFailure):
                continue
            paths.append(path)
            at = found.q
            if len(paths) == count:
                return paths
    raise ScenarioError(
        f"cameras.{mounting.camera}: the arm can show this camera the board in only "
        f"{len(paths)} of {count} postures; use another camera, or fewer --images"
    )


def _targets(
    mounting: Mounting, scene: PlanningScene, home: Vector, count: int, seed: int
) -> Iterator[HandTarget]:
    """Yield random targets of the hand at which the camera sees the board."""
    rng = np.random.default_rng(seed)
    board, info = mounting.board, mounting.model.color
    width, height = info.width(), info.height()
    diagonal = float(np.linalg.norm(board.size))
    far = mounting.focal.min() * board.marker / 6.0 / _CELL_PIXELS
    near = mounting.focal.max() * diagonal / (_MOST_FILLED * height)
    if not near < far:
        raise ScenarioError(
            f"cameras.{mounting.camera}: images of {width} x {height} pixels are too "
            "small to read the whole board's markers"
        )
    X_PC = mounting.X_PB @ mounting.model.X_BC
    X_GH = scene.X_WG(home).inverse() @ mounting.X_WH(scene, home)
    for _ in range(_TRIES * count):
        z = rng.uniform(near, far)
        # The board's middle keeps this distance from the image's edge [pixels], so that
        # the image shows most of the board.
        margin = 0.35 * diagonal * mounting.focal.max() / z
        u, v = (_inside(rng, side, margin) for side in (width, height))
        p_C = z * np.array([*(np.array([u, v]) - mounting.center) / mounting.focal, 1])
        sight_C = p_C / np.linalg.norm(p_C)
        tilt = _tilted(rng, rng.uniform(_LEAST_TILT, _MOST_TILT))
        if mounting.in_hand:
            X_GC = X_GH @ X_PC
            down = mounting.X_QO.rotation().matrix()[:, 2]
            axis = AxisTarget(
                X_GC.rotation() @ sight_C, _turned(down, tilt), _TILT_TOLERANCE
            )
            yield HandTarget(
                mounting.X_QO @ board.center, axes=(axis,), p_GT=X_GC @ p_C
            )
        else:
            X_WC = mounting.X_WP @ X_PC
            normal_G = -mounting.X_QO.rotation().matrix()[:, 2]
            toward = _turned(X_WC.rotation() @ -sight_C, tilt)
            axis = AxisTarget(normal_G, toward, _TILT_TOLERANCE)
            p_GT = mounting.X_QO @ board.center
            yield HandTarget(X_WC @ p_C, axes=(axis,), p_GT=p_GT)


def _inside(rng: np.random.Generator, side: float, margin: float) -> float:
    """Return a random coordinate [pixels], a margin away from the image's edges."""
    return float(rng.uniform(min(margin, side / 2), max(side - margin, side / 2)))


def _tilted(rng: np.random.Generator, angle: float) -> Vector:
    """Return the z axis tilted by an angle in a random direction, shape (3,)."""
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    across = np.sin(angle)
    return np.array([across * np.cos(azimuth), across * np.sin(azimuth), np.cos(angle)])


def _turned(axis: Vector, tilt: Vector) -> Vector:
    """Return the vector `tilt` (3,), given in a frame whose z axis is `axis` (3,)."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first), axis]).T @ tilt


# Share of the arm's limits of speed and acceleration. Images are taken at rest, so the
# motions between them do not matter.
_SPEED = 0.9
# The arm rests once no joint is faster than this [rad/s]; at a metre that is 0.1 mm in
# the time between two readings of its joints.
_REST_SPEED = 2e-3
_REST_WAIT, _MOST_WAITS = 0.1, 50  # s
_NO_LOG = 10.0  # s


def take_shots(
    scenario: Scenario,
    mounting: Mounting,
    scene: PlanningScene,
    count: int,
    tell: Callable[[int], None] = lambda taken: None,
) -> list[Shot]:
    """Move the arm through many postures, and take an image in each.

    The hand's pose follows from the measured joint positions, as on hardware.

    Args:
        scenario: The scenario, without the board.
        mounting: Camera and board.
        scene: The arm, and what to keep clear of.
        count: How many images.
        tell: Called with the number of images taken so far.

    Raises:
        ScenarioError: If the arm cannot show the board, or does not come to rest.
    """
    assert scenario.arm is not None
    home = np.array(scenario.arm.home)
    paths = plan_visits(mounting, scene, home, count, scenario.random_seed)
    limits = MotionLimits.of_plant(scene).scaled(_SPEED, _SPEED)
    shots: list[Shot] = []
    shown = with_board(scenario, mounting)
    # Nothing reads the log, so a long period will do.
    with Rig(shown, name="calibrate", log_period=_NO_LOG, images=True) as rig:
        for path in paths:
            tell(len(shots))
            for start, end in itertools.pairwise(path):
                rig.move(end, _duration(np.abs(end - start), limits))
            q = _rest(rig, scene.num_joints)
            X_WH = mounting.X_WH(scene, q)
            name = f"view_{len(shots):02d}.png"
            shots.append(Shot(name, rig.image(mounting.camera), X_WH))
    return shots


def _duration(way: Vector, limits: MotionLimits) -> float:
    """Return the time of a minimum-jerk motion within the limits [s]."""
    # The peaks are 1.875 way / time for speed, and 5.774 way / time^2 for acceleration.
    speed = 1.875 * way / limits.velocity
    acceleration = np.sqrt(5.774 * way / limits.acceleration)
    return float(max(speed.max(), acceleration.max(), 0.1))


def _rest(rig: Rig, num_joints: int) -> Vector:
    """Wait until the arm rests, and return its measured joint positions (N) [rad]."""
    for _ in range(_MOST_WAITS):
        rig.advance(_REST_WAIT)
        state = rig.measured("arm.state_measured")
        if np.abs(state[num_joints:]).max() < _REST_SPEED:
            return np.asarray(state[:num_joints])
    raise ScenarioError(
        f"the arm is still moving {_MOST_WAITS * _REST_WAIT:g} s after a motion"
    )
