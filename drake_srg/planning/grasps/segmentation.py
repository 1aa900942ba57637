"""Segmentation of a table's height map into objects."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.types import HeightMap, Vector

# Cells this near to the table mostly belong to it [m].
_NEAR = 0.01
# Smoothing rounds edges, so only maps with more noise than this are smoothed [m].
_NOISY = 3e-4
# Noise makes specks that look like small things. On a noisy map, a thing must be larger
# by this factor.
_SPECKS = 2.0
# A thing rises above the table by `_DEVIATIONS` standard deviations of noise. From
# there, it extends over all cells that rise by `_EXTENDS`.
_DEVIATIONS, _EXTENDS = 4.0, 2.0
# A part of a thing that is nowhere wider than `_THIN` and at least `_LONG` long sticks
# out of something wider, like a hammer from below a plate [m].
_THIN, _LONG = 0.05, 0.1
# A part at least `_BROAD` across beside one wider than `_WIDE` also has a lever of
# its own, such as a ball that touches a plate. The corners of a lying box are narrower
# [m].
_WIDE, _BROAD = 0.13, 0.03


@dc.dataclass(frozen=True, eq=False)
class Thing:
    """A connected region above the table.

    Attributes:
        label: Its number in `Segmentation.labels`.
        cells: Its cells (iy, ix), shape (n, 2).
        middle: x, y of the middle of its volume, shape (2,) [m].
        size: Long and short side of the narrowest rectangle around it [m].
        top: Its height above the table [m].
    """

    label: int
    cells: npt.NDArray[np.intp]
    middle: Vector
    size: tuple[float, float]
    top: float


@dc.dataclass(frozen=True, eq=False)
class Segmentation:
    """A height map above a table, without gaps, segmented into things.

    Attributes:
        map: The map.
        above: Height above the table, 0 where it is unknown, shape (ny, nx) [m].
        unknown: Cells that no camera saw, shape (ny, nx).
        noise: Standard deviation of the table's own heights [m].
        least: Least height of a thing [m].
        labels: Number of the thing in each cell, 0 for none, shape (ny, nx).
        things: The things.
    """

    map: HeightMap
    above: npt.NDArray[np.float32]
    unknown: npt.NDArray[np.bool_]
    noise: float
    least: float
    labels: npt.NDArray[np.int32]
    things: tuple[Thing, ...]

    @classmethod
    def of(
        cls, map_: HeightMap, table: float, *, least_height: float, least_area: float
    ) -> Segmentation:
        """Return the segmentation of a map.

        Args:
            map_: The map.
            table: World z of the table [m].
            least_height: Least height of a thing [m].
            least_area: Least area of a thing as seen from above [m²]; twice that if the
                map is noisy.
        """
        unknown = np.isnan(map_.height)
        above = np.where(unknown, 0.0, map_.height - table).astype(np.float32)
        noise = _noise(above[~unknown])
        if noise > _NOISY:
            above = np.asarray(cv2.medianBlur(above, 3), np.float32)
            noise = _noise(above[~unknown])
            least_area *= _SPECKS
        least = max(least_height, _DEVIATIONS * noise)
        extends = max(least_height, _EXTENDS * noise)
        labels, things = _things(map_, above, least, extends, least_area)
        return cls(map_, above, unknown, noise, least, labels, things)

    def only(self, thing: Thing) -> Segmentation:
        """Return the segmentation reduced to one of its things."""
        above = np.where(self.labels == thing.label, self.above, np.float32(0.0))
        return dc.replace(self, above=above, things=(thing,))

    def places(self, apart: float) -> list[Vector]:
        """Return places on things, shape (3,) each [m].

        Every part of a thing is within `apart` [m] of one of its places.
        """
        centers, found = self.map.centers(), []
        for thing in self.things:
            rows, columns = thing.cells.T
            points = centers[rows, columns]
            nearest = np.linalg.norm(points - thing.middle, axis=1)
            at = int(np.argmin(nearest))
            distances = np.full(len(points), np.inf)
            while distances.max() > apart:
                cell = tuple(thing.cells[at])
                found.append(np.array([*points[at], self.map.height[cell]]))
                distances = np.fmin(
                    distances, np.linalg.norm(points - points[at], axis=1)
                )
                at = int(np.argmax(distances))
        return found

    def beside_same(self, p_1: Vector, p_2: Vector, apart: float) -> bool:
        """Return whether a thing is at `p_1` and within `apart` of `p_2`, in world [m].

        Args:
            p_1: Shape (2 or 3,).
            p_2: Shape (2 or 3,).
            apart: The distance.
        """
        return self.label_at(p_1) in self.labels_near(p_2, apart)

    def label_at(self, p_W: Vector) -> int:
        """Return the number of the thing at a place (2 or 3,) in world [m]; 0: none."""
        row, column = self.map.cells(np.asarray(p_W))
        ny, nx = self.labels.shape
        inside = 0 <= row < ny and 0 <= column < nx
        return int(self.labels[row, column]) if inside else 0

    def labels_near(self, p_W: Vector, apart: float) -> set[int]:
        """Return the numbers of things within `apart` of a place (2 or 3,) [m]."""
        near = np.linalg.norm(self.map.centers() - p_W[:2], axis=-1) <= apart
        return set(np.unique(self.labels[near]).tolist()) - {0}

    @functools.cached_property
    def thing_middles(self) -> Vector:
        """Middle of the thing in each cell, shape (ny, nx, 2) [m]; NaN in empty cells.

        Things that touch count as one. But a long thin part, or a broad part beside
        something wide, has its own middle, because it may be another thing.
        """
        result = np.full((*self.labels.shape, 2), np.nan)
        for thing in self.things:
            result[tuple(thing.cells.T)] = thing.middle
        high = np.isfinite(result[..., 0]).astype(np.uint8)
        res = self.map.resolution
        broad = [
            cells
            for cells in _sticking_out(high, _WIDE / res)
            if _breadth(cells) * res >= _BROAD
        ]
        long = [
            cells
            for cells in _sticking_out(high, _THIN / res)
            if sides(cells, res)[0] >= _LONG
        ]
        for cells in broad + long:
            result[tuple(cells.T)] = _middle(self.map, self.above, cells)
        return result

    def lookup(self, p_W: Vector) -> npt.NDArray[np.float32]:
        """Return heights above the table at points (..., 2) [m]; 0 outside the map."""
        padded = np.pad(self.above, 1)
        cells = (p_W - self.map.origin) * (1.0 / self.map.resolution) + 1.5
        ny, nx = padded.shape
        ix = np.clip(cells[..., 0], 0, nx - 1).astype(np.int32)
        iy = np.clip(cells[..., 1], 0, ny - 1).astype(np.int32)
        return padded.ravel().take(iy * nx + ix)


def sides(cells: npt.NDArray[np.intp], resolution: float) -> tuple[float, float]:
    """Return the long and short side of the narrowest rectangle around cells [m].

    Args:
        cells: Their (iy, ix), shape (n, 2).
        resolution: Size of a cell [m].
    """
    _, found, _ = cv2.minAreaRect((cells - cells[0]).astype(np.float32))
    short, long = sorted((side + 1.0) * resolution for side in found)
    return long, short


def _sticking_out(
    high: npt.NDArray[np.uint8], width: float
) -> Iterator[npt.NDArray[np.intp]]:
    """Yield the cells (n, 2) of each part that sticks out of something wider.

    Things without such a wide part yield nothing.

    Args:
        high: Cells of things, shape (ny, nx).
        width: Width in cells.
    """
    core = _depth(high) > 0.5 * width
    if not core.any():
        return
    wide = _depth((~core).astype(np.uint8)) <= 0.5 * width
    count, labels = cv2.connectedComponents(high, connectivity=8)
    beside = np.zeros(count, bool)
    beside[labels[core]] = True
    rest = (beside[labels] & ~wide).astype(np.uint8)
    count, parts = cv2.connectedComponents(rest, connectivity=8)
    for part in range(1, count):
        yield np.argwhere(parts == part)


def _breadth(cells: npt.NDArray[np.intp]) -> float:
    """Return the diameter of the largest disc within cells (n, 2), in cells."""
    rows, columns = (cells - cells.min(axis=0) + 1).T
    mask = np.zeros((rows.max() + 2, columns.max() + 2), np.uint8)
    mask[rows, columns] = 1
    return 2.0 * float(_depth(mask).max())


def _depth(mask: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Return the distance of each cell's middle from a mask's edge, in cells."""
    distance = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.maximum(np.asarray(distance, np.float32) - 0.5, 0.0)


def _noise(above: npt.NDArray[np.float32]) -> float:
    """Return the standard deviation of a table's own heights [m]."""
    flat = np.abs(above[np.abs(above) < _NEAR])
    return 1.4826 * float(np.median(flat)) if len(flat) else 0.0


def _things(
    map_: HeightMap,
    above: npt.NDArray[np.float32],
    least: float,
    extends: float,
    least_area: float,
) -> tuple[npt.NDArray[np.int32], tuple[Thing, ...]]:
    """Return the number of the thing in each cell, and the things.

    A thing has at least `least_area` [m²] higher than `least`. It extends over all
    connected cells higher than `extends` [m], because noise breaks low things apart.
    """
    count, found, boxes, _ = cv2.connectedComponentsWithStats(
        (above > extends).astype(np.uint8), connectivity=8
    )
    areas = np.bincount(found[above > least], minlength=count) * map_.resolution**2
    kept = areas >= least_area
    kept[0] = False
    # Noise leaves hundreds of specks, so all are cleared at once.
    labels = np.where(kept, np.arange(count, dtype=np.int32), np.int32(0))[found]
    things = []
    for label in np.flatnonzero(kept).tolist():
        x, y, width, height, _ = boxes[label]
        cells = np.argwhere(labels[y : y + height, x : x + width] == label)
        cells += np.array([y, x])
        things.append(
            Thing(
                label,
                cells,
                _middle(map_, above, cells),
                sides(cells, map_.resolution),
                float(above[tuple(cells.T)].max()),
            )
        )
    return labels, tuple(things)


def _middle(
    map_: HeightMap, above: npt.NDArray[np.float32], cells: npt.NDArray[np.intp]
) -> Vector:
    """Return x, y of the centre of volume of some cells (n, 2), shape (2,) [m]."""
    heights = above[tuple(cells.T)].astype(float)
    points = map_.centers()[tuple(cells.T)]
    middle: Vector = np.average(points, axis=0, weights=heights)
    return middle
