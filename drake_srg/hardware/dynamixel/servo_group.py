"""Servos that move one part of a robot together: set up, watched and commanded."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable, Mapping, Sequence

from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.dynamixel.registers import ServoState
from drake_srg.hardware.dynamixel.servo_bus import ServoBus

# Takes the states of the servos, in the order of their IDs.
Report = Callable[[Sequence[ServoState]], None]


@dc.dataclass(kw_only=True)
class GroupConfig:
    """The servos of a part of a robot."""

    ids: Sequence[int]
    # Largest torque, as a fraction of the stall torque.
    effort: float = 1.0
    # How far a servo that has rebooted may be from its goal, to be driven on [counts].
    resume_within: float = math.inf


class ServoGroup:
    """Servos of a part of a robot, as the thread of a bus handles them.

    It switches a servo's torque on where the servo is, and lights its LED. A dark LED
    thus tells that a servo has rebooted: its torque is off and what has been set up is
    lost. The group then sets it up again, unless it is too far from its goal by now. A
    servo that has switched its torque off itself, such as after an overload, stays off.
    In both cases, the whole group halts for good: it commands nothing any more and
    reports nothing, so that whoever waits for its reports stops the robot.

    Args:
        config: The servos.
        report: Called with their states, in the bus's thread.
        warnings: Where trouble is told.

    Attributes:
        config: The servos.
        goals: Positions to command, by ID [counts]. Another thread may replace the
            mapping at any time.
        halted: Why the group has halted; empty while it works.
    """

    def __init__(self, config: GroupConfig, report: Report, warnings: Warnings) -> None:
        self.config = config
        self.goals: Mapping[int, int] = {}
        self.halted = ""
        self._report, self._warnings = report, warnings
        self._ready: set[int] = set()

    def exchange(self, bus: ServoBus, states: Mapping[int, ServoState]) -> bool:
        """Take the servos' states and set them up where necessary.

        Args:
            bus: The bus.
            states: By ID.

        Returns:
            Whether their goals may be commanded.

        Raises:
            BusError: If a servo cannot be set up.
        """
        goals = self.goals
        for number in self.config.ids:
            if self.halted:
                return False
            state = states[number]
            if number not in self._ready:
                self._set_up(bus, number, state)
            elif not state.marked:
                self._resume(bus, number, state, goals.get(number, state.position))
            elif not state.torque:
                why = state.fault or "its torque is off"
                self._halt(f"servo {number} has shut down ({why})")
            elif state.fault:
                self._warnings.warn(
                    f"servo {number} {state.fault}", f"servo {number}: {state.fault}"
                )
        if self.halted:
            return False
        self._report([states[number] for number in self.config.ids])
        return True

    def _resume(self, bus: ServoBus, number: int, state: ServoState, goal: int) -> None:
        away = abs(state.position - goal)
        if away > self.config.resume_within:
            self._halt(
                f"servo {number} has rebooted and is {away} counts from its goal "
                f"(allowed: {self.config.resume_within:.0f})"
            )
            return
        self._set_up(bus, number, state)
        self._warnings.warn(
            f"servo {number} reboot",
            f"servo {number} has rebooted, {away} counts from its goal; it goes on",
        )

    def _set_up(self, bus: ServoBus, number: int, state: ServoState) -> None:
        """Switch the torque on where the servo is, and mark it last of all."""
        effort = round(self.config.effort * bus.table.full_effort)
        bus.write(number, bus.table.effort, effort)
        bus.write(number, "torque_enable", 1)
        bus.write(number, "goal_position", state.position)
        bus.write(number, "led", 1)
        self._ready.add(number)

    def _halt(self, why: str) -> None:
        self.halted = why
        self._warnings.warn(f"halt {why}", f"{why}; nothing commands it any more")
