"""The thread that talks to a bus of servos."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from drake_srg.bridges.commands import Warnings
from drake_srg.hardware.dynamixel.bus_cycle import BusCycle
from drake_srg.hardware.dynamixel.servo_bus import ServoBus
from drake_srg.hardware.dynamixel.servo_group import ServoGroup

_PAUSE = 0.1  # before a lost bus is opened again [s]


class BusThread(BusCycle):
    """A thread that repeats a bus's exchange, from the first group to the last.

    Args:
        open_bus: See `BusCycle`.
        period: Time between exchanges [s].
        warnings: See `BusCycle`.

    Raises:
        OSError: If the bus cannot be opened.
    """

    def __init__(
        self, open_bus: Callable[[], ServoBus], period: float, warnings: Warnings
    ) -> None:
        super().__init__(open_bus, warnings)
        self._period = period
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="servo bus", daemon=True)

    def add(self, group: ServoGroup) -> None:
        """See `BusCycle`."""
        super().add(group)
        if self._thread.ident is None:
            self._thread.start()

    def end(self) -> None:
        """See `BusCycle`; waits for the exchange that is under way."""
        self._done.set()
        if self._thread.ident is not None:
            self._thread.join()
        super().end()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._done.is_set():
            pause = 0.0 if self.cycle() else _PAUSE
            due = max(due + self._period, time.monotonic() + pause)
            self._done.wait(due - time.monotonic())
