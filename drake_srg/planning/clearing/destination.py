"""Destinations of loads."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from drake_srg.planning.clearing.maps import parts
from drake_srg.types import HeightMap, Vector

# Radius around a destination in which the planner looks for a load that missed it [m].
BESIDE = 0.1
# How far a load in the hand may reach beyond a bin, and how far around the bin the
# planner takes its last look for loads that missed it [m]. The arm is then farther
# away.
AROUND = 0.2
# In maps, a bin's edge flickers between wall and table within `EDGE` outside [m].
# Within `_WALL` inside, a cell may still be wall [m].
EDGE, _WALL = 0.01, 0.02
# Long things are laid down in lanes on both sides of the middle, where others are
# dropped. Distance of a lane from the middle, as a share of the bin's width.
_LANE = 0.2
# Tall things are set down in the bin's middle, or this far to either side along it,
# as a share of its length. A thing that leans on a rim may hang over it.
_SPOT = 0.25
# Half the width of a lane, and of a place for a tall load [m]. Everything within it
# counts as below the load. In a lane, it may also be below the hand, whose fingers open
# by 55 mm and are 22 mm thick. A finger that enters a mug would lift it out of the bin.
_HALF_LANE, _HALF_SPOT = 0.09, 0.05
# A part that sticks out over a rim by at most `_STICKS_OUT` [m] counts as in the bin:
# most of it is inside, and beside the wall there is no room for a hand. On the wall, it
# is higher than the rim by `_ON_RIM`; beside the wall, it is at most `_BELOW_RIM`
# lower.
_STICKS_OUT, _ON_RIM, _BELOW_RIM = 0.08, 0.008, 0.03


@dc.dataclass(frozen=True, eq=False)
class Spot:
    """A place in a bin where a load may be laid or set down."""

    aside_W: Vector  # from the bin's middle to its own, in world, shape (3,) [m]
    ground: float  # world z of the highest thing there [m]


@dc.dataclass(frozen=True, eq=False)
class Spots:
    """Places in a bin for loads to be laid or set down, the emptier first.

    Attributes:
        long: Lanes along the bin, for long loads.
        tall: Places away from its walls, for tall ones.
    """

    long: tuple[Spot, ...] = ()
    tall: tuple[Spot, ...] = ()

    def raised(self, height: float) -> Spots:
        """Return the same places, each higher than before [m]."""

        def raised(spots: Iterable[Spot]) -> tuple[Spot, ...]:
            return tuple(dc.replace(s, ground=s.ground + height) for s in spots)

        return Spots(raised(self.long), raised(self.tall))


@dc.dataclass(frozen=True, eq=False)
class Destination:
    """A rectangle in which loads are dropped or set down.

    Attributes:
        low: Its least x, y in world, shape (2,) [m].
        high: Its greatest x, y.
        place: Place for the middle of a thing on its support, if it stands as before,
            shape (3,) [m]; None where loads are dropped.
        rim: World z of a bin's rim [m]; None: it has none.
        floor: World z of a bin's floor [m]; -inf: unknown.
    """

    low: Vector
    high: Vector
    place: Vector | None = None
    rim: float | None = None
    floor: float = -np.inf

    @property
    def middle(self) -> Vector:
        """The middle of the bin, x and y in world, shape (2,) [m]."""
        middle: Vector = 0.5 * (self.low + self.high)
        return middle

    def overhang(self, height_map: HeightMap) -> npt.NDArray[np.bool_]:
        """Return where things that lie in a bin stick out over its rim, (ny, nx).

        Args:
            height_map: Height map of the bin and its surroundings.
        """
        result = np.zeros(height_map.height.shape, bool)
        if self.rim is None:
            return result
        inside = self.contains(height_map, -_WALL)
        outside = ~self.contains(height_map, EDGE)
        beside = np.where(inside | outside, -_BELOW_RIM, _ON_RIM)
        high = height_map.height > self.rim + beside  # unknown cells compare as False
        far = ~self.contains(height_map, _STICKS_OUT)
        for part in parts(high, height_map.resolution):
            if np.any(part & inside) and not np.any(part & far):
                result |= part & outside
        return result

    def top(self, height_map: HeightMap) -> float:
        """Return the world z of the highest thing inside, -inf if none is seen [m]."""
        inside = height_map.height[self.contains(height_map, -_WALL)]
        return float(np.nanmax(inside, initial=-np.inf))

    def spots(self, height_map: HeightMap | None) -> Spots:
        """Return the spots in a bin where loads are laid or set down.

        Args:
            height_map: Map of the bin; None: the bin is empty.
        """
        across = int(np.argmin(self.high - self.low))
        lanes = [self._spot(height_map, across, side) for side in (-_LANE, _LANE)]
        places = [
            self._spot(height_map, 1 - across, side, around=True)
            for side in (0.0, -_SPOT, _SPOT)
        ]
        return Spots(_emptier_first(lanes), _emptier_first(places))

    def _spot(
        self,
        height_map: HeightMap | None,
        axis: int,
        side: float,
        *,
        around: bool = False,
    ) -> Spot:
        """Return a lane beside the middle, or a place.

        Args:
            height_map: See `spots`.
            axis: Axis along which the spot is off the bin's middle, 0 or 1.
            side: Its offset along that axis, as a share of the bin's size.
            around: True: a square around the place. False: a strip along the bin.
        """
        aside = side * np.eye(3)[axis] * (self.high - self.low)[axis]
        if height_map is None:
            return Spot(aside, self.floor)
        apart = np.abs(height_map.centers() - self.middle - aside[:2])
        if around:
            within = apart.max(axis=-1) < _HALF_SPOT
        else:
            within = apart[..., axis] < _HALF_LANE
        within &= self.contains(height_map, -_WALL)
        inside = height_map.height[within]
        return Spot(aside, float(np.nanmax(inside, initial=self.floor)))

    def contains(
        self, height_map: HeightMap, margin: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """Return which cells of a map are inside or within a margin [m], (ny, nx)."""
        return self.encloses(height_map.centers(), margin)

    def encloses(self, p_W: Vector, margin: float) -> npt.NDArray[np.bool_]:
        """Return which points (..., 2) are inside or within a margin [m], (...)."""
        inside = (p_W >= self.low - margin) & (p_W <= self.high + margin)
        return np.asarray(np.all(inside, axis=-1))


def _emptier_first(spots: Iterable[Spot]) -> tuple[Spot, ...]:
    return tuple(sorted(spots, key=lambda spot: spot.ground))
