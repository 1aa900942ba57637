"""Postures of the arm in which the camera sees the board, each in another way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.calibration.mounting import THICKNESS, Mounting
from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget
from drake_srg.planning.motion.inverse_kinematics import (
    IkSolution,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.paths import plan_joint_path
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import Box, Vector

# Pixels in a marker's cell. The detector reads 2.5, but finds corners half as well.
_CELL_PIXELS = 3.0
# The board's diagonal fills at most this share of the image's height.
_MOST_FILLED = 0.8
# Angle between the board's normal and the line of sight [rad]: poses are told best by
# tilted boards, but foreshortened markers are not read.
_LEAST_TILT, _MOST_TILT = np.radians(10.0), np.radians(40.0)
_TILT_TOLERANCE = np.radians(5.0)
# Random views that are tried for each one wanted.
_TRIES = 12


def plan_visits(
    mounting: Mounting, scene: PlanningScene, home: Vector, count: int, seed: int
) -> list[Vector]:
    """Return paths from posture to posture, the first one from home.

    Args:
        mounting: Camera and board.
        scene: The arm, and what to keep clear of.
        home: The posture to start from, shape (N,) [rad].
        count: How many postures.
        seed: Of the random views.

    Returns:
        Waypoints (K, N) [rad] that straight joint lines connect, for each posture.

    Raises:
        ScenarioError: If the arm cannot show the board that often, or the image is too
            small for it.
    """
    box = Box([*mounting.board.size, THICKNESS])
    X_OB = RigidTransform([*mounting.board.center[:2], 0.5 * THICKNESS])
    paths: list[Vector] = []
    at = home
    # Where the arm moves the camera, the board lies on the table, far from the hand.
    if mounting.in_hand:
        held = scene.standing(box, mounting.X_QO @ X_OB)
    else:
        held = scene.holding(box, mounting.X_QO @ X_OB)
    with held:
        for i, target in enumerate(_targets(mounting, scene, home, count, seed)):
            found = solve_inverse_kinematics(
                scene, target, q_nominal=home, q_guess=at, max_starts=4, seed=i
            )
            if not isinstance(found, IkSolution):
                continue
            path = plan_joint_path(scene, at, found.q, max_iterations=100, seed=seed)
            if isinstance(path, PlanningFailure):
                continue
            paths.append(path)
            at = found.q
            if len(paths) == count:
                return paths
    raise ScenarioError(
        f"cameras.{mounting.camera}: the arm can show it the board in {len(paths)} of "
        f"{count} ways; another camera, or fewer --images"
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
        # The board's middle stays so far inside that most of it is seen.
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
    """Return a place along a side of the image, at least a margin inside it."""
    return float(rng.uniform(min(margin, side / 2), max(side - margin, side / 2)))


def _tilted(rng: np.random.Generator, angle: float) -> Vector:
    """Return the z axis tilted by an angle in a random direction, shape (3,)."""
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    across = np.sin(angle)
    return np.array([across * np.cos(azimuth), across * np.sin(azimuth), np.cos(angle)])


def _turned(axis: Vector, tilt: Vector) -> Vector:
    """Return `tilt` (3,) in a frame whose z is `axis` (3,)."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first), axis]).T @ tilt
