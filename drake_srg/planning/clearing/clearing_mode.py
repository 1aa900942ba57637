"""What the modes of clearing a table have in common."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from typing import ClassVar, TypeAlias

from pydrake.trajectories import Trajectory

from drake_srg.planning import state_machine
from drake_srg.planning.clearing.clearing_memory import ClearingMemory
from drake_srg.planning.clearing.picking import PickPlanner
from drake_srg.planning.planner_machine import HandSenses, Observation, PlannerMode
from drake_srg.types import Failure, HeightMap, Mode


@dc.dataclass(frozen=True)
class Senses(HandSenses[HeightMap]):
    """Measurements at one time; `see` returns the height map of the table."""

    # Looks at where loads go; returns None without a camera for that.
    see_destinations: Callable[[], HeightMap | None]


Now: TypeAlias = state_machine.Moment[Senses]
Entry: TypeAlias = state_machine.Entry[Senses, Mode, Observation]


class ClearingMode(PlannerMode[ClearingMemory, Senses]):
    """A mode that moves the arm, or waits; every mode checks the time budget.

    Attributes:
        mode: Which mode it is.
        yields: Whether the arm stops once it is off its path by `path_tolerance`. It
            would press things into each other: with 500 N, a plate into a box.
        planner: Plans the picks.
        config: Times and limits.
    """

    yields: ClassVar[bool] = False

    def __init__(self, planner: PickPlanner) -> None:
        self.planner = planner
        self.config = planner.config

    def trajectory(self, memory: ClearingMemory) -> Trajectory | None:
        """Return the planned motion of the mode, None where the arm rests."""
        return memory.pick.motions.get(self.mode) if memory.pick else None

    def final_failure(self, memory: ClearingMemory, time: float) -> Failure | None:
        """Return the failure that ends the task in whatever mode, if there is one."""
        over = time > self.config.time_budget
        return memory.failure or (Failure.TIME_BUDGET if over else None)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report whether the arm has arrived, or is stopped by something."""
        motion, q = memory.motion, now.senses.q
        if motion.arrived(q, now.time):
            return Observation(arrived=True)
        late = now.time > motion.due + self.config.arrival_timeout
        allowed = self.config.path_tolerance
        if self.yields and allowed is not None:
            late |= motion.error(q, now.time) > allowed
        return Observation(stuck=late)
