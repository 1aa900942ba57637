"""From a moving servo back to a planner's positions, without a jump."""

from __future__ import annotations

import dataclasses as dc
import math

import numpy as np

from drake_srg.types import Vector

_DECAY = 6.0  # 1/s; a hand at 0.25 m/s brakes with less than half the arm's limits
_GONE = 1e-6  # rad, rad/s


@dc.dataclass(frozen=True)
class HandOver:
    """A deviation from planned positions that fades away, critically damped.

    Attributes:
        offset: Of the commands from the planned positions, shape (N,) [rad].
        rate: Its velocity, shape (N,) [rad/s].
    """

    offset: Vector
    rate: Vector

    def stepped(self, period: float) -> HandOver | None:
        """Return the deviation a period [s] later; None once it is gone."""
        left = math.exp(-_DECAY * period)
        slope = self.rate + _DECAY * self.offset
        offset = left * (self.offset + period * slope)
        rate = left * (self.rate - _DECAY * period * slope)
        gone = max(np.max(np.abs(offset)), np.max(np.abs(rate))) < _GONE
        return None if gone else HandOver(offset, rate)
