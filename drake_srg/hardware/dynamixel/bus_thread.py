"""The thread that talks to a bus of servos."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from drake_srg.bridges.commands import Warnings
from drake_srg.hardware.dynamixel.servo_bus import BusError, ServoBus
from drake_srg.hardware.dynamixel.servo_group import ServoGroup

_PAUSE = 0.1  # before a lost bus is opened again [s]


class BusThread:
    """Reads all servos of a bus and commands their goals, over and over.

    Where a servo does not reply, nothing is reported for any of them, and the line is
    opened anew.

    Args:
        open_bus: Opens the bus; raises an OSError if it cannot.
        period: Time between exchanges [s].
        warnings: Where trouble is told.

    Raises:
        OSError: If the bus cannot be opened.
    """

    def __init__(
        self, open_bus: Callable[[], ServoBus], period: float, warnings: Warnings
    ) -> None:
        self._open, self._period, self._warnings = open_bus, period, warnings
        self._groups: tuple[ServoGroup, ...] = ()
        self._bus: ServoBus | None = open_bus()
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="servo bus", daemon=True)

    def add(self, group: ServoGroup) -> None:
        """Handle another group of servos from now on."""
        self._groups = (*self._groups, group)
        if self._thread.ident is None:
            self._thread.start()

    def remove(self, group: ServoGroup) -> None:
        """Leave a group where it is; without any, close the bus and end the thread."""
        self._groups = tuple(other for other in self._groups if other is not group)
        if self._groups or self._done.is_set():
            return
        self._done.set()
        if self._thread.is_alive():
            self._thread.join()
        self._close()

    @property
    def closed(self) -> bool:
        """Whether it has ended."""
        return self._done.is_set()

    def cycle(self) -> bool:
        """Exchange states and goals with all servos once; return whether that worked.

        The thread calls this.
        """
        groups = [group for group in self._groups if not group.halted]
        numbers = [number for group in groups for number in group.config.ids]
        try:
            if self._bus is None:
                self._bus = self._open()
            if numbers:
                states = self._bus.read_states(numbers)
                obeying = [g for g in groups if g.exchange(self._bus, states)]
                goals = {k: goal for g in obeying for k, goal in g.goals.items()}
                if goals:
                    self._bus.sync_write("goal_position", goals)
        except (BusError, OSError) as error:
            self._warnings.warn("servo bus", f"servo bus: {error}; it is tried again")
            self._close()
            return False
        self._warnings.forget("servo bus")
        return True

    def _run(self) -> None:
        due = time.monotonic()
        while not self._done.is_set():
            pause = 0.0 if self.cycle() else _PAUSE
            due = max(due + self._period, time.monotonic() + pause)
            self._done.wait(due - time.monotonic())

    def _close(self) -> None:
        if self._bus is not None:
            self._bus.close()
            self._bus = None
