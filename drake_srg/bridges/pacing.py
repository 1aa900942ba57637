"""Simulated time beside the clock on the wall."""

from __future__ import annotations

import math
import threading
import time as wall
from collections import deque
from collections.abc import Callable

# Too slow is what does less than this share of its rate in two windows of this length
# [s, real] one after the other: a stall is not.
_KEPT, _WINDOW = 0.97, 5.0


class Pacer:
    """Lets simulated time pass at a multiple of real time, or as fast as it can.

    Args:
        rate: Simulated seconds in a real one; infinite: never wait.
        stop: Ends a wait when it is set.
        patience: What simulated time lags behind up to this [s, real] is made up for;
            what it lags more is given up, so that it never rushes for long.
        clock: Real time [s].
    """

    def __init__(
        self,
        rate: float,
        stop: threading.Event,
        *,
        patience: float = 0.5,
        clock: Callable[[], float] = wall.monotonic,
    ):
        self._rate, self._stop = rate, stop
        self._patience, self._clock = patience, clock
        self.lost = 0.0  # real time given up [s]
        self.too_slow: float | None = None  # simulated over real time, where it is
        self._start = clock()  # when simulated time was 0, or would have been
        # (real, simulated) times of the last second or so.
        self._recent: deque[tuple[float, float]] = deque([(self._start, 0.0)])
        self._window, self._slow_windows = (self._start, 0.0), 0

    def wait(self, time: float) -> None:
        """Wait until it is time for the simulated `time` [s]."""
        now = self._clock()
        if math.isfinite(self._rate):
            ahead = self._start + time / self._rate - now
            if ahead > 0.0:
                self._stop.wait(ahead)
            elif ahead < -self._patience:
                self.lost -= ahead
                self._start -= ahead
            self._judge(now, time)
        self._recent.append((now, time))
        while now - self._recent[0][0] > 1.0 and len(self._recent) > 2:
            self._recent.popleft()

    def _judge(self, now: float, time: float) -> None:
        """See, at the end of a window, whether it is too slow."""
        real, simulated = self._window
        if now - real >= _WINDOW:
            factor = (time - simulated) / (now - real)
            slow = factor < _KEPT * self._rate
            self._slow_windows = self._slow_windows + 1 if slow else 0
            self.too_slow = factor if self._slow_windows > 1 else None
            self._window = (now, time)

    @property
    def factor(self) -> float:
        """Simulated over real time, of the last second."""
        (real_0, time_0), (real_1, time_1) = self._recent[0], self._recent[-1]
        return (time_1 - time_0) / max(real_1 - real_0, 1e-9)
