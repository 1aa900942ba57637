"""Follows a moving goal from sightings: an alpha-beta filter."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class MovingGoal:
    """Where a goal is, and how it moves. It is replaced, never changed."""

    p_W: Vector  # at `time`, shape (3,) [m]
    v_W: Vector = dc.field(default_factory=lambda: np.zeros(3))  # shape (3,) [m/s]
    time: float = 0.0  # s

    def at(self, time: float) -> Vector:
        """Return where the goal is at a time, shape (3,) [m]."""
        return self.p_W + (time - self.time) * self.v_W

    def seen(self, p_W: Vector, time: float, alpha: float, beta: float) -> MovingGoal:
        """Return the goal after a sighting.

        Args:
            p_W: Where the goal was seen, shape (3,) [m].
            time: When, later than the sighting before [s].
            alpha: Share of the surprise that goes into the position.
            beta: Share of the surprise that goes into the velocity.
        """
        surprise = p_W - self.at(time)
        elapsed = time - self.time
        return MovingGoal(
            self.at(time) + alpha * surprise,
            self.v_W + beta / elapsed * surprise,
            time,
        )
