"""Where an arm was a moment ago."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.common.shared import Shared
from drake_srg.servoing.sightings import Taken
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class ArmHistory(Shared):
    """Recent positions of an arm.

    Attributes:
        stamps: When they were measured, by the arm's clock, increasing, shape (K,) [s].
        times: When they arrived, by ours, shape (K,) [s].
        positions: Of the joints, shape (K, N) [rad].
    """

    stamps: Vector = dc.field(default_factory=lambda: np.zeros(0))
    times: Vector = dc.field(default_factory=lambda: np.zeros(0))
    positions: Vector = dc.field(default_factory=lambda: np.zeros((0, 0)))

    def followed_by(
        self, stamp: float, time: float, q: Vector, span: float
    ) -> ArmHistory:
        """Return the history with one more measurement.

        One that is not new changes nothing. If the arm's clock has been set back, the
        history begins anew.

        Args:
            stamp: When it was measured, by the arm's clock [s]; NaN: not known.
            time: When it arrived, by ours [s].
            q: The joints' positions, shape (N,) [rad].
            span: How far back to remember [s].
        """
        known = self if len(self.stamps) and stamp >= self.stamps[-1] else None
        if np.isnan(stamp) or (known is not None and stamp == known.stamps[-1]):
            return self
        if known is None:
            return ArmHistory(np.array([stamp]), np.array([time]), q[np.newaxis].copy())
        kept = known.stamps >= stamp - span
        return ArmHistory(
            np.append(known.stamps[kept], stamp),
            np.append(known.times[kept], time),
            np.vstack([known.positions[kept], q]),
        )

    def at(self, stamp: float) -> Taken | None:
        """Return our time, and where the arm was, at a time by the arm's clock [s].

        Returns:
            Both, between measurements interpolated; None outside of the history.
        """
        if not len(self.stamps) or not self.stamps[0] <= stamp <= self.stamps[-1]:
            return None
        q = [np.interp(stamp, self.stamps, joint) for joint in self.positions.T]
        return Taken(float(np.interp(stamp, self.stamps, self.times)), np.array(q))
