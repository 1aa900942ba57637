"""Keep simulated time in step with real time."""

from __future__ import annotations

import math
import threading
import time as wall
from collections import deque
from collections.abc import Callable

# A run is too slow if it keeps less than this share of its rate in two consecutive
# windows of this length [s, real]. A single stall does not count.
_KEPT, _WINDOW = 0.97, 5.0


class Pacer:
    """Lets simulated time pass at a multiple of real time, or as fast as possible.

    Args:
        rate: Simulated seconds per real second; infinite means never wait.
        stop: Ends a wait when it is set.
        patience: Lags up to this length [s, real] are caught up with. Time lost beyond
            that is given up, so that the simulation never rushes for long.
        clock: Returns real time [s].

    Attributes:
        lost: Real time given up so far [s].
        too_slow: Simulated over real time while the run is too slow, otherwise None.
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
        self.lost = 0.0
        self.too_slow: float | None = None
        self._start = clock()  # real time at which simulated time is (taken as) 0
        # (real, simulated) times of about the last second.
        self._recent: deque[tuple[float, float]] = deque([(self._start, 0.0)])
        self._window, self._slow_windows = (self._start, 0.0), 0

    def wait(self, time: float) -> None:
        """Wait until real time has caught up with the simulated `time` [s]."""
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
        """Decide at the end of each window whether the run is too slow."""
        real, simulated = self._window
        if now - real >= _WINDOW:
            factor = (time - simulated) / (now - real)
            slow = factor < _KEPT * self._rate
            self._slow_windows = self._slow_windows + 1 if slow else 0
            self.too_slow = factor if self._slow_windows > 1 else None
            self._window = (now, time)

    @property
    def factor(self) -> float:
        """Simulated over real time during the last second."""
        (real_0, time_0), (real_1, time_1) = self._recent[0], self._recent[-1]
        return (time_1 - time_0) / max(real_1 - real_0, 1e-9)
