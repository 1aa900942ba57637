"""Things on a table as upright boxes, for motions to keep clear of."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import cv2
import numpy as np
from pydrake.math import RigidTransform

from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import Box, HeightMap, Shape, Vector

# Between pads there may be a gap, such as that of a fork. The thing is as near as [m]:
_FORK = 0.02
_TAKEN_RADIUS = 0.12  # things this near to a grasp are the load itself [m]
_LEAST_HEIGHT = 0.005  # lower things are below every motion across [m]
# Noise breaks low things apart. Parts within this many cells of each other are one.
_GAP = np.ones((5, 5), np.uint8)


def columns(
    height_map: HeightMap, table: float, size: float = 0.06
) -> list[tuple[Shape, RigidTransform]]:
    """Return boxes that fill a height map, with their poses [m].

    Args:
        height_map: The map.
        table: Height of the table [m].
        size: Width of each box [m].
    """
    heights = np.nan_to_num(height_map.height - table)
    cells = max(1, round(size / height_map.resolution))
    width = cells * height_map.resolution
    boxes: list[tuple[Shape, RigidTransform]] = []
    for row in range(0, heights.shape[0], cells):
        for column in range(0, heights.shape[1], cells):
            block = heights[row : row + cells, column : column + cells]
            high = float(block.max())
            if high < _LEAST_HEIGHT:
                continue
            middle = 0.5 * np.array(block.shape[::-1]) - 0.5 + [column, row]
            xy = height_map.origin + height_map.resolution * middle
            pose = RigidTransform([*xy, table + 0.5 * high])
            boxes.append((Box([width, width, high]), pose))
    return boxes


@contextlib.contextmanager
def standing(
    scene: PlanningScene,
    height_map: HeightMap,
    table: float,
    taken: Vector | None = None,
) -> Iterator[None]:
    """Let what a map shows stand in a scene, except where something is taken.

    Args:
        scene: The planning scene.
        height_map: The map.
        table: Height of the table [m].
        taken: Where, shape (2 or 3,) [m]; None: nothing is.
    """
    with contextlib.ExitStack() as stack:
        for shape, X_WO in columns(height_map, table):
            p_W = X_WO.translation()[:2]
            if taken is None or np.linalg.norm(p_W - taken[:2]) > _TAKEN_RADIUS:
                stack.enter_context(scene.standing(shape, X_WO))
        yield


def highest_near(height_map: HeightMap, p_W: Vector, radius: float) -> float:
    """Return the height of the highest thing near a place, in world [m].

    Args:
        height_map: The map.
        p_W: The place, shape (2 or 3,) [m].
        radius: What counts as near [m].
    """
    near = np.linalg.norm(height_map.middles() - p_W[:2], axis=-1) < radius
    return float(np.nanmax(height_map.height[near], initial=-np.inf))


def thing_at(
    height_map: HeightMap, table: float, p_W: Vector, step: float = np.inf
) -> Vector:
    """Return the middles of the cells of the thing at a place, shape (n, 2) [m].

    Things that touch count as one, unless a step in height parts them. Where the map
    shows nothing near, or only steps, the place itself is all there is.

    Args:
        height_map: The map.
        table: Height of the table [m].
        p_W: The place, shape (2 or 3,) [m].
        step: The least such step, from one cell to the next but one [m].
    """
    height = np.nan_to_num(height_map.height, nan=table).astype(np.float32)
    steps = cv2.morphologyEx(height, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    found = (height > table + _LEAST_HEIGHT).astype(np.uint8)
    joined = np.asarray(cv2.morphologyEx(found, cv2.MORPH_CLOSE, _GAP))
    high = (joined > 0) & (steps < step)
    _, labels = cv2.connectedComponents(high.astype(np.uint8), connectivity=8)
    middles, place = height_map.middles(), np.asarray(p_W, dtype=float)[:2]
    away = np.where(high, np.linalg.norm(middles - place, axis=-1), np.inf)
    if away.min() > _FORK:
        return place[np.newaxis]
    cells: Vector = middles[labels == labels.flat[away.argmin()]]
    return cells
