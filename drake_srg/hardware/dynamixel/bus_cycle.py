"""The exchange with all servos of a bus, over and over."""

from __future__ import annotations

from collections.abc import Callable

from drake_srg.bridges.commands import Warnings
from drake_srg.hardware.dynamixel.servo_bus import BusError, ServoBus
from drake_srg.hardware.dynamixel.servo_group import ServoGroup


class BusCycle:
    """Reads the servos of all groups and commands their goals, once per call.

    Where a servo does not reply, nothing is reported for any of them, and the line is
    opened anew.

    Args:
        open_bus: Opens the bus; raises an OSError if it cannot.
        warnings: Where trouble is told.

    Raises:
        OSError: If the bus cannot be opened.
    """

    def __init__(self, open_bus: Callable[[], ServoBus], warnings: Warnings) -> None:
        self._open, self._warnings = open_bus, warnings
        self._groups: tuple[ServoGroup, ...] = ()
        self._bus: ServoBus | None = open_bus()
        self.closed = False

    def add(self, group: ServoGroup) -> None:
        """Handle another group of servos from now on."""
        self._groups = (*self._groups, group)

    def remove(self, group: ServoGroup) -> None:
        """Leave a group where it is; after the last one, close the bus."""
        self._groups = tuple(other for other in self._groups if other is not group)
        if not self._groups and not self.closed:
            self.closed = True
            self.end()

    def end(self) -> None:
        """Close the bus."""
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def cycle(self) -> bool:
        """Exchange states and goals with all servos; return whether that worked."""
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
            if self._bus is not None:
                self._bus.close()
                self._bus = None
            return False
        self._warnings.forget("servo bus")
        return True
