"""Differences between a table's height maps, and the things that stand there."""

from __future__ import annotations

import contextlib
import dataclasses as dc
from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import Box, HeightMap, LabeledHeightMap, Shape, Vector

# Heights that differ by no more than the larger of both are equal: [m], below the
# height of a spoon's handle, and in standard deviations of a change's noise.
_SAME, _DEVIATIONS = 0.003, 3.0
# Changes of less than this are noise at the edges of things [m³].
_LEAST_VOLUME = 1.0e-6
# If a thing was taken, at least this share of its volume has left the map. A neighbour
# that moves at the same time changes the shadows: when a hammer left a heap, the share
# was 0.26.
_LEAST_SHARE = 0.2
# A connected change of this area means that something is still moving [m²].
# Smaller changes are edges that flicker in noisy depth.
_LEAST_AREA = 2.0e-4
# An edge may appear this far to either side of its place [m]: two cells of the table's
# map. Near an edge, a cell has changed only if no cell this near had its height before.
# So a thing 5 cm wide that moves by less than about 1 cm counts as still.
_FLICKER = 0.004
# Changes of single cells are noise; this many cells side by side are not.
_KERNEL = np.ones((3, 3), np.uint8)
# Radii around a place in which cells show whether its thing has moved or gone [m].
_MOVED, _GONE = 0.05, 0.015
# A pick changes the map within `_TAKEN` of the grasp, as far as the open fingers reach
# [m]. Noise may break the change into parts up to `_APART` from each other [m].
_TAKEN, _APART = 0.1, 0.008
# A thing has left if it stood at least `_LEFT` higher than the cell is now [m]. From
# the ceiling, low things hide `_HIDDEN` of the table beside them [m].
_LEFT, _HIDDEN = 0.01, 0.02
# There may be a gap between the pads, such as that of a fork. The thing itself is then
# at most this far away [m].
_FORK = 0.02
_TAKEN_RADIUS = 0.12  # things this near to a grasp are the load itself [m]
_LEAST_HEIGHT = 0.005  # lower things are below every motion across [m]
# Hardly any cell of a map is off by more than this many standard deviations.
_PEAK = 5.0
# Reach of the open hand around its middle [m].
HAND_RADIUS = 0.16
# Noise breaks low things apart. Parts within this many cells of each other are one.
_GAP = np.ones((5, 5), np.uint8)


def is_still(before: HeightMap, after: HeightMap) -> bool:
    """Return whether nothing has moved between two maps.

    A falling thing is too high for the map, so it appears as unknown cells that move.
    """
    unseen = np.isnan(before.height) != np.isnan(after.height)
    moved = opened(unseen) | changed(before, after)
    return not parts(moved, after.resolution)


def near(height_map: HeightMap, p_W: Vector, radius: float) -> npt.NDArray[np.bool_]:
    """Return which cells of a map are nearer to a place than a radius, (ny, nx).

    Args:
        height_map: The map.
        p_W: The place, shape (2 or 3,) [m].
        radius: The radius [m].
    """
    away = np.linalg.norm(height_map.centers() - p_W[:2], axis=-1)
    return np.asarray(away < radius)


def has_moved(before: HeightMap, after: HeightMap, p_W: Vector) -> bool:
    """Return whether anything near a place has moved between two maps.

    Args:
        before: The map before.
        after: The map now.
        p_W: The place, shape (2 or 3,) [m].
    """
    moved = near(before, p_W, _MOVED) & changed(before, after)
    return bool(parts(moved, after.resolution))


def has_gone(before: HeightMap, after: HeightMap, p_W: Vector) -> bool:
    """Return whether the thing at a place has left the map.

    The place must have become lower, and the total volume on the table smaller. A thing
    that was only pushed aside appears elsewhere.

    Args:
        before: The map before.
        after: The map now.
        p_W: The place, shape (2 or 3,) [m].
    """
    drop = fallen(before, after)
    if not np.any(drop[near(before, p_W, _GONE)] > 0.0):
        return False
    gone, net = np.sum(drop[drop > 0.0]), np.sum(drop)
    least = max(_LEAST_VOLUME / after.resolution**2, _LEAST_SHARE * gone)
    return bool(net > least)


def volume_gone(
    before: HeightMap, after: HeightMap, p_W: Vector, radius: float
) -> float:
    """Return the loss of volume on the map within a radius of a place [m³].

    Args:
        before: The map before.
        after: The map now.
        p_W: The place, shape (2 or 3,) [m].
        radius: Around it [m].
    """
    gone = fallen(before, after)[near(before, p_W, radius)]
    return float(np.sum(gone)) * after.resolution**2


def volume_taken(before: HeightMap, after: HeightMap, p_W: Vector) -> float:
    """Return the loss of volume where a thing was taken, and around it [m³].

    Only connected changes that reach to within `_TAKEN` of the place count. Others have
    another cause, such as a plate that leans on a wall and slides.

    Args:
        before: The map before.
        after: The map now.
        p_W: Place of the grasp, shape (2 or 3,) [m].
    """
    return float(np.sum(_taken(before, after, p_W))) * after.resolution**2


def lowest(seen: HeightMap, earlier: HeightMap | None) -> HeightMap:
    """Return the lower of two maps in every cell; unknown heights are ignored."""
    if earlier is None:
        return seen
    return dc.replace(seen, height=np.fmin(seen.height, earlier.height))


def has_come(
    earlier: HeightMap, before: HeightMap, after: HeightMap, p_W: Vector
) -> bool:
    """Return whether most of the thing taken from a place was new there.

    A thing that was only pushed a little covers much of its earlier place.

    Args:
        earlier: The least heights of earlier maps; see `lowest`.
        before: The map with the thing.
        after: The map without it.
        p_W: Place of the grasp, shape (2 or 3,) [m].
    """
    taken = np.clip(_taken(before, after, p_W), 0.0, None)
    come = np.clip(-fallen(earlier, before), 0.0, taken)
    return bool(np.sum(taken) > 0.0 and np.sum(come) > 0.5 * np.sum(taken))


def _taken(before: HeightMap, after: HeightMap, p_W: Vector) -> Vector:
    """Return each cell's fall [m], where the fallen cells connect to a place."""
    drop = fallen(before, after)
    size = 2 * round(_APART / after.resolution) + 1
    wide = cv2.dilate((drop != 0.0).astype(np.uint8), np.ones((size, size), np.uint8))
    _, labels = cv2.connectedComponents(wide)
    around = np.unique(labels[near(before, p_W, _TAKEN)])
    own = np.isin(labels, around) & (wide > 0)
    return np.where(own, drop, 0.0)


def fallen(before: HeightMap, after: HeightMap) -> Vector:
    """Return each cell's fall [m], shape (ny, nx).

    Noise does not count. A cell that is unknown on either map has not fallen.
    """
    drop: Vector = before.height - after.height
    noise = _deviation(drop[np.isfinite(drop)])
    drop = np.nan_to_num(drop)
    differs = (np.abs(drop) > max(_SAME, _DEVIATIONS * noise)).astype(np.uint8)
    closed = cv2.morphologyEx(differs, cv2.MORPH_CLOSE, _KERNEL)  # fill gaps
    return np.where(opened(closed > 0), drop, 0.0)


def _deviation(heights: Vector) -> float:
    """Return the standard deviation of heights, most of which are the table's [m]."""
    return 1.4826 * float(np.median(np.abs(heights))) if heights.size else 0.0


def changed(before: HeightMap, after: HeightMap) -> npt.NDArray[np.bool_]:
    """Return which cells have changed, shape (ny, nx).

    Noise and edges that flicker do not count.
    """
    reach = int(np.ceil(_FLICKER / after.resolution))
    around = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    seen = np.isfinite(before.height)
    high = cv2.dilate(np.where(seen, before.height, -np.inf), around)
    low = cv2.erode(np.where(seen, before.height, np.inf), around)
    out = (after.height > high + _SAME) | (after.height < low - _SAME)
    return np.asarray(out & (fallen(before, after) != 0.0))


def completed(seen: HeightMap, earlier: HeightMap | None) -> HeightMap:
    """Return a map with its gaps filled from an earlier one, except removed things.

    Gaps close to a removed thing are not filled, either: a few of its cells, now hidden
    beside something else, would look like a thing that still stands there.

    Args:
        seen: The map.
        earlier: The earlier one, of the same grid; None: there is none.
    """
    if earlier is None:
        return seen
    left = (fallen(earlier, seen) > _LEFT).astype(np.uint8)
    size = 2 * round(_HIDDEN / seen.resolution) + 1
    around = np.ones((size, size), np.uint8)
    beside = cv2.dilate(left, around) > 0
    # A cell as high as a visible thing nearby may belong to that thing.
    highest = cv2.dilate(np.nan_to_num(seen.height, nan=-np.inf), around)
    beside &= earlier.height > highest + _LEFT
    height = np.where(beside, np.nan, earlier.height)
    whole = seen.completed(dc.replace(earlier, height=height))
    if isinstance(whole, LabeledHeightMap):
        unknown = np.isnan(whole.height)
        whole = dc.replace(whole, label=np.where(unknown, -1, whole.label))
    return whole


def without_hand(
    seen: HeightMap, p_W: Vector, kept: npt.NDArray[np.bool_]
) -> HeightMap:
    """Return a map without the cells that a hand at a place may cover.

    Args:
        seen: The map.
        p_W: The middle of the hand, shape (2 or 3,) [m].
        kept: Cells that the hand does not hide, shape (ny, nx).
    """
    hidden = near(seen, p_W, HAND_RADIUS) & ~kept
    return dc.replace(seen, height=np.where(hidden, np.nan, seen.height))


def parts(
    mask: npt.NDArray[np.bool_], resolution: float
) -> list[npt.NDArray[np.bool_]]:
    """Return the connected parts of a mask, without flickering edges."""
    _, labels, regions, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    large = regions[:, cv2.CC_STAT_AREA] * resolution**2 >= _LEAST_AREA
    return [labels == label for label in np.flatnonzero(large) if label]


def opened(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return a mask without parts narrower than the kernel."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, _KERNEL)
    return np.asarray(opened > 0)


def obstacle_boxes(
    height_map: HeightMap, table: float, size: float = 0.06
) -> list[tuple[Shape, RigidTransform]]:
    """Return boxes that fill a height map, with their poses [m].

    Noise gets no boxes: adding hundreds to a scene takes seconds.

    Args:
        height_map: The map.
        table: Height of the table [m].
        size: Width of each box [m].
    """
    above = height_map.height - table
    heights = np.nan_to_num(above)
    least = max(_LEAST_HEIGHT, _PEAK * _deviation(above[np.isfinite(above)]))
    cells = max(1, round(size / height_map.resolution))
    width = cells * height_map.resolution
    boxes: list[tuple[Shape, RigidTransform]] = []
    for row in range(0, heights.shape[0], cells):
        for column in range(0, heights.shape[1], cells):
            block = heights[row : row + cells, column : column + cells]
            high = float(block.max())
            if high < least:
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
    """Put a map's things into a scene, except where one is taken.

    Args:
        scene: The planning scene.
        height_map: The map.
        table: Height of the table [m].
        taken: Place of the taken thing, shape (2 or 3,) [m]; None: no thing is taken.
    """
    with contextlib.ExitStack() as stack:
        for shape, X_WO in obstacle_boxes(height_map, table):
            p_W = X_WO.translation()[:2]
            if taken is None or np.linalg.norm(p_W - taken[:2]) > _TAKEN_RADIUS:
                stack.enter_context(scene.standing(shape, X_WO))
        yield


def highest_near(height_map: HeightMap, p_W: Vector, radius: float) -> float:
    """Return the height of the highest thing `near` a place, in world [m]."""
    heights = height_map.height[near(height_map, p_W, radius)]
    return float(np.nanmax(heights, initial=-np.inf))


def thing_at(
    height_map: HeightMap, table: float, p_W: Vector, step: float = np.inf
) -> Vector:
    """Return the centres of the cells of the thing at a place, shape (n, 2) [m].

    Things that touch count as one, unless a step in height separates them. If the map
    shows nothing near, or only steps, the result is the place itself.

    Args:
        height_map: The map.
        table: Height of the table [m].
        p_W: The place, shape (2 or 3,) [m].
        step: The least such step, between cells two apart [m].
    """
    height = np.nan_to_num(height_map.height, nan=table).astype(np.float32)
    steps = cv2.morphologyEx(height, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    found = (height > table + _LEAST_HEIGHT).astype(np.uint8)
    joined = np.asarray(cv2.morphologyEx(found, cv2.MORPH_CLOSE, _GAP))
    high = (joined > 0) & (steps < step)
    _, labels = cv2.connectedComponents(high.astype(np.uint8), connectivity=8)
    centers, place = height_map.centers(), np.asarray(p_W, dtype=float)[:2]
    away = np.where(high, np.linalg.norm(centers - place, axis=-1), np.inf)
    if away.min() > _FORK:
        return place[np.newaxis]
    cells: Vector = centers[labels == labels.flat[away.argmin()]]
    return cells
