"""What stands on a table, from a height map."""

from __future__ import annotations

import dataclasses as dc

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.types import HeightMap, Vector

# Cells this near to the table are mostly its own [m].
_NEAR = 0.01
# Smoothing rounds edges; it pays from this noise on [m].
_NOISY = 3e-4
# A thing is higher than the table's noise by this many standard deviations. From there
# it extends over whatever is higher than it by so many.
_DEVIATIONS, _EXTENDS = 4.0, 2.0


@dc.dataclass(frozen=True, eq=False)
class Thing:
    """A connected region above the table.

    Attributes:
        label: Its number in `Relief.labels`.
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
class Relief:
    """A height map above a table, without gaps.

    Attributes:
        map: The map.
        above: Height above the table, 0 where it is unknown, shape (ny, nx) [m].
        unknown: Where no camera saw anything, shape (ny, nx).
        noise: Standard deviation of the table's own heights [m].
        least: What is lower does not count as a thing [m].
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
    ) -> Relief:
        """Return the relief of a map.

        Args:
            map_: The map.
            table: World z of the table [m].
            least_height: Of a thing [m].
            least_area: Of a thing as seen from above [m²].
        """
        unknown = np.isnan(map_.height)
        above = np.where(unknown, 0.0, map_.height - table).astype(np.float32)
        noise = _noise(above[~unknown])
        if noise > _NOISY:
            above = np.asarray(cv2.medianBlur(above, 3), np.float32)
            noise = _noise(above[~unknown])
        least = max(least_height, _DEVIATIONS * noise)
        extends = max(least_height, _EXTENDS * noise)
        labels, things = _things(map_, above, least, extends, least_area)
        return cls(map_, above, unknown, noise, least, labels, things)

    def only(self, thing: Thing) -> Relief:
        """Return the relief with nothing but one of its things."""
        above = np.where(self.labels == thing.label, self.above, np.float32(0.0))
        return dc.replace(self, above=above, things=(thing,))

    def places(self, apart: float) -> list[Vector]:
        """Return places on things, shape (3,) each [m].

        Every part of a thing is within `apart` [m] of one of its places.
        """
        middles, found = self.map.middles(), []
        for thing in self.things:
            rows, columns = thing.cells.T
            points = middles[rows, columns]
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
        row, column = self.map.cells(np.asarray(p_1))
        ny, nx = self.labels.shape
        if not (0 <= row < ny and 0 <= column < nx and self.labels[row, column]):
            return False
        parts = self.map.middles()[self.labels == self.labels[row, column]]
        return bool(np.linalg.norm(parts - p_2[:2], axis=1).min() <= apart)

    def lookup(self, p_W: Vector) -> npt.NDArray[np.float32]:
        """Return heights above the table at points; 0 outside the map.

        Args:
            p_W: x, y in world, shape (..., 2) [m].
        """
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

    They have `least_area` [m²] that is higher than `least`, and extend over all cells
    around it that are higher than `extends` [m]: noise breaks low things apart.
    """
    count, found = cv2.connectedComponents(
        (above > extends).astype(np.uint8), connectivity=8
    )
    labels = np.array(found, np.int32)
    areas = np.bincount(labels[above > least], minlength=count) * map_.resolution**2
    middles, things = map_.middles(), []
    for label in range(1, count):
        if areas[label] < least_area:
            labels[labels == label] = 0
            continue
        cells = np.argwhere(labels == label)
        heights = above[cells[:, 0], cells[:, 1]].astype(float)
        points = middles[cells[:, 0], cells[:, 1]]
        things.append(
            Thing(
                label,
                cells,
                np.average(points, axis=0, weights=heights),
                sides(cells, map_.resolution),
                float(heights.max()),
            )
        )
    return labels, tuple(things)
