"""Loads: what the hand has let go, and what was seen where it belongs."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.planning.clearing.comparing import fallen
from drake_srg.planning.clearing.destination import Destination
from drake_srg.planning.clearing.receiving import SeenLoad
from drake_srg.types import HeightMap

# The volume of a load on a map is the same within this share, unless it lies on another
# side.
_ALIKE = 0.25
# A cell of a load that is within this height of where it was still shows it [m].
_SAME_PLACE = 0.01


@dc.dataclass(frozen=True)
class Drop:
    """A load that the hand has let go, or may have."""

    destination: Destination
    load: SeenLoad
    laid: bool = False  # set down, or laid in a lane of a bin
    again: bool = False  # it passes for a load that is missed


@dc.dataclass(frozen=True, eq=False)
class Received:
    """A load that was seen where it belongs.

    Attributes:
        volume: On the map of the table [m³].
        before: The map of where loads go before it came.
        after: The map with it.
        destination: Where that is.
        counts: Whether it still counts as arrived.
    """

    volume: float
    before: HeightMap
    after: HeightMap
    destination: Destination
    counts: bool = True

    def is_like(self, volume: float) -> bool:
        """Return whether it is about as large as something on the table [m³]."""
        return abs(self.volume - volume) < _ALIKE * self.volume

    def may_have_left(self, now: HeightMap) -> bool:
        """Return whether most of where it came to lie looks otherwise by now.

        It may lie below something else, or that may be all that is there.
        """
        came = -fallen(self.before, self.after) > 0.0
        other = ~(np.abs(now.height - self.after.height) < _SAME_PLACE)
        return bool(np.count_nonzero(came & other) > 0.5 * np.count_nonzero(came))

    def has_left(self, now: HeightMap | None) -> bool:
        """Return whether most of what had risen as it came is gone from there."""
        if now is None:
            return False
        risen = np.clip(-fallen(self.before, self.after), 0.0, None)
        still = np.clip(-fallen(self.before, now), 0.0, risen)
        return bool(np.sum(still) < 0.5 * np.sum(risen))
