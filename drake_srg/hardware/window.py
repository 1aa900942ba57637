"""The stretch of the commands that goes to a robot with every message."""

from __future__ import annotations

from collections import deque

import numpy as np

from drake_srg.arm.trajectory_follower import CAPACITY
from drake_srg.types import Vector


class Window:
    """Gives commands times by the robot's clock, somewhat ahead of it.

    The times are `period` apart while both clocks keep pace. Where ours was held up,
    the robot gets more time for a step, and never less. Where the robot's was held up,
    the newest command gets farther ahead, until the arm rests.

    Args:
        lead: How far ahead the newest command is [s].
        period: Between commands [s].
    """

    def __init__(self, lead: float, period: float) -> None:
        self._lead, self._period = lead, period
        self._kept: deque[tuple[float, Vector]] = deque(maxlen=CAPACITY)

    def after(self, q: Vector, stamp: float) -> tuple[Vector, Vector]:
        """Return the times (K,) [s] and positions (K, N) to send.

        Args:
            q: The newest command, shape (N,) [rad or m].
            stamp: The robot's clock, as far as it is known [s].
        """
        ahead = [old for t, old in self._kept if t > stamp]
        if ahead and all(np.array_equal(q, old) for old in ahead):
            self._kept.clear()  # it rests, and needs no time for a step
        time = stamp + self._lead
        if self._kept:
            time = max(time, self._kept[-1][0] + self._period)
        self._kept.append((time, np.array(q)))
        while self._kept[0][0] < stamp - self._lead:
            self._kept.popleft()
        times, positions = zip(*self._kept, strict=True)
        return np.array(times), np.array(positions)
