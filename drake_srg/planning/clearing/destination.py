"""Where loads go."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import numpy.typing as npt

from drake_srg.planning.clearing.comparing import parts
from drake_srg.types import HeightMap, Vector

# How far around a destination a load may be seen that has missed it [m].
BESIDE = 0.1
# How far a load in the hand may reach beyond a bin, and how far around the bin the
# planner looks in the end for what has missed it [m]. Farther off is the arm.
AROUND = 0.2
# A bin's edge in maps flickers between wall and table within this distance outside [m].
# As far inside, there may still be wall [m].
EDGE, _WALL = 0.01, 0.02
# Lanes in which long things are laid down are beside the middle, where others are
# dropped: so far, as a share of a bin's width, and so wide to either side [m].
_LANE, _LANE_WIDTH = 0.2, 0.05
# Tall things are set down in its middle, or so far to either side along it, as a share
# of its length: what leans on a rim may hang over it.
_SPOT = 0.25
# What reaches over a rim from inside, no further than `_STICKS_OUT` beyond it, is in
# the bin [m]: most of it is inside, and the wall leaves a hand no room. On the wall it
# is higher than the rim by `_ON_RIM`, and beside that at most `_BELOW_RIM` lower.
_STICKS_OUT, _ON_RIM, _BELOW_RIM = 0.08, 0.008, 0.03


@dc.dataclass(frozen=True, eq=False)
class Lane:
    """A part of a bin: a strip along it for long things, or a spot for tall ones."""

    aside_W: Vector  # from the bin's middle to its own, in world, shape (3,) [m]
    ground: float  # world z of the highest thing in it [m]
    tall: bool = False  # it is a spot


@dc.dataclass(frozen=True, eq=False)
class Destination:
    """A rectangle that loads are dropped or set down in.

    Attributes:
        low: Its least x, y in world, shape (2,) [m].
        high: Its greatest.
        level: World z of what loads are set down on, to stand as they stood before [m];
            None where they are dropped.
        rim: World z of a bin's rim [m]; None: it has none.
        floor: World z of a bin's floor [m]; -inf: unknown.
    """

    low: Vector
    high: Vector
    level: float | None = None
    rim: float | None = None
    floor: float = -np.inf

    @property
    def middle(self) -> Vector:
        """Its middle, x, y in world, shape (2,) [m]."""
        middle: Vector = 0.5 * (self.low + self.high)
        return middle

    def overhang(self, height_map: HeightMap) -> npt.NDArray[np.bool_]:
        """Return where things that lie in a bin stick out over its rim, (ny, nx).

        Args:
            height_map: Of the bin and what is around it.
        """
        result = np.zeros(height_map.height.shape, bool)
        if self.rim is None:
            return result
        inside = self.contains(height_map, -_WALL)
        outside = ~self.contains(height_map, EDGE)
        beside = np.where(inside | outside, -_BELOW_RIM, _ON_RIM)
        high = height_map.height > self.rim + beside  # no cell that is unknown
        far = ~self.contains(height_map, _STICKS_OUT)
        for part in parts(high, height_map.resolution):
            if np.any(part & inside) and not np.any(part & far):
                result |= part & outside
        return result

    def top(self, height_map: HeightMap) -> float:
        """Return the world z of the highest thing inside, -inf if none is seen [m]."""
        inside = height_map.height[self.contains(height_map, -_WALL)]
        return float(np.nanmax(inside, initial=-np.inf))

    def lanes(self, height_map: HeightMap | None) -> list[Lane]:
        """Return a bin's lanes and spots, the emptier ones first.

        Args:
            height_map: The bin is empty without one.
        """
        size = self.high - self.low
        across = int(np.argmin(size))
        lanes = []
        for tall, axis, side in (
            (False, across, -_LANE),
            (False, across, _LANE),
            (True, 1 - across, 0.0),
            (True, 1 - across, -_SPOT),
            (True, 1 - across, _SPOT),
        ):
            aside = side * np.eye(3)[axis] * size[axis]
            ground = self.floor
            if height_map is not None:
                apart = np.abs(height_map.middles() - self.middle - aside[:2])
                lane = apart.max(axis=-1) if tall else apart[..., across]
                within = (lane < _LANE_WIDTH) & self.contains(height_map, -_WALL)
                inside = height_map.height[within]
                ground = float(np.nanmax(inside, initial=self.floor))
            lanes.append(Lane(aside, ground, tall))
        return sorted(lanes, key=lambda lane: lane.ground)

    def contains(
        self, height_map: HeightMap, margin: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """Return which cells of a map are inside or within a margin [m], (ny, nx)."""
        return self.encloses(height_map.middles(), margin)

    def encloses(self, p_W: Vector, margin: float) -> npt.NDArray[np.bool_]:
        """Return which points (..., 2) are inside or within a margin [m], (...)."""
        inside = (p_W >= self.low - margin) & (p_W <= self.high + margin)
        return np.asarray(np.all(inside, axis=-1))
