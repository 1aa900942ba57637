"""What the modes of clearing a table have in common."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from typing import ClassVar, TypeAlias

from pydrake.trajectories import Trajectory

from drake_srg.planning import state_machine
from drake_srg.planning.clearing.clearing_memory import ClearingMemory
from drake_srg.planning.clearing.picking import PickPlanner
from drake_srg.planning.clearing.transitions import Observation
from drake_srg.planning.senses import HandSenses
from drake_srg.types import Failure, HeightMap, Mode


@dc.dataclass(frozen=True)
class Senses(HandSenses[HeightMap]):
    """Measurements at one time; `see` returns the height map of the table."""

    # Looks at where loads go; returns None without a camera for that.
    see_destinations: Callable[[], HeightMap | None]


Now: TypeAlias = state_machine.Moment[Senses]
Entry: TypeAlias = state_machine.Entry[Senses, Mode, Observation]


class ClearingMode(
    state_machine.ModeActions[Mode, ClearingMemory, Senses, Observation]
):
    """A mode that moves the arm, or waits; every mode checks the time budget.

    Attributes:
        mode: Which mode it is.
        yields: Whether the arm stops once it is off its path by `path_tolerance`. It
            would press things into each other: with 500 N, a plate into a box.
        planner: Plans the picks.
        config: Times and limits.
    """

    mode: ClassVar[Mode]
    yields: ClassVar[bool] = False

    def __init__(self, planner: PickPlanner) -> None:
        self.planner = planner
        self.config = planner.config

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Begin the mode's planned motion, if there is one."""
        trajectory = self.trajectory(memory)
        motion = memory.motion.followed_by(trajectory, entry.time)
        return dc.replace(memory, motion=motion)

    def trajectory(self, memory: ClearingMemory) -> Trajectory | None:
        """Return the planned motion of the mode, None where the arm rests."""
        return memory.pick.motions.get(self.mode) if memory.pick else None

    def observe(self, memory: ClearingMemory, now: Now) -> Observation:
        """Return what the mode's transitions depend on, and only that."""
        if memory.failure is not None:
            return Observation(failure=memory.failure)
        if now.time > self.config.time_budget:
            return Observation(failure=Failure.TIME_BUDGET)
        return self.observe_mode(memory, now)

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
