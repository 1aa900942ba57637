"""Base classes of the pick-and-place task's modes."""

from __future__ import annotations

import dataclasses as dc
from typing import ClassVar, TypeAlias

from pydrake.trajectories import Trajectory

from drake_srg.planning import state_machine
from drake_srg.planning.planner_machine import GIVES_UP
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.planning.task.observing import (
    Senses,
    holding,
    watch_grasp,
    watch_touch,
)
from drake_srg.planning.task.planner_memory import Attempt, Cycle, PlannerMemory
from drake_srg.planning.task.replanning import Replanner
from drake_srg.planning.task.transitions import Observation
from drake_srg.types import Failure, Mode

Now: TypeAlias = state_machine.Moment[Senses]
Entry: TypeAlias = state_machine.Entry[Senses, Mode, Observation]

_MESSAGES = {
    **GIVES_UP,
    Failure.NO_GRASP: "the fingers closed, but nothing of the right size is in them",
    Failure.DROPPED: "the object was in the hand and got lost",
    Failure.MISPLACED: "the object is not seen on its goal",
}


class TaskMode(state_machine.ModeActions[Mode, PlannerMemory, Senses, Observation]):
    """A mode of the task. Every mode heeds the clock and torques from outside.

    Attributes:
        mode: Which mode it is.
        config: Times and limits.
        replanner: Plans from what is seen.
        repeat: How many cycles the task has.
    """

    mode: ClassVar[Mode]

    def __init__(
        self, config: PlannerConfig, replanner: Replanner, repeat: int
    ) -> None:
        self.config = config
        self.replanner = replanner
        self.repeat = repeat

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Begin the mode's planned motion, if there is one."""
        attempt = dc.replace(memory.attempt, ready_at=entry.time, looked=False)
        trajectory = self.trajectory(attempt)
        motion = memory.motion.followed_by(trajectory, entry.time, self.wait)
        return dc.replace(memory, attempt=attempt, motion=motion)

    def trajectory(self, attempt: Attempt) -> Trajectory | None:
        """Return the planned motion of the mode, None where the arm rests."""
        return attempt.motions.motions.get(self.mode) if attempt.motions else None

    @property
    def wait(self) -> float:
        """How long the mode lasts at least after its motion [s]."""
        return 0.0

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Stop the arm where it meets something."""
        return watch_touch(memory, now.senses, self.config)

    def observe(self, memory: PlannerMemory, now: Now) -> Observation:
        """Return what the mode's transitions depend on, and only that."""
        failure = self.final_failure(memory, now.time)
        if failure is not None:
            return Observation(failure=failure)
        return self.observe_mode(memory, now)

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Return what the mode's own transitions depend on."""
        return Observation()

    def final_failure(self, memory: PlannerMemory, time: float) -> Failure | None:
        """Return the failure that ends the task in whatever mode, if there is one."""
        if memory.attempt.trapped:
            return memory.trouble.failure
        if memory.trouble.touched:
            return Failure.STOPPED
        over = time - memory.cycle.started > self.config.time_budget
        return Failure.TIME_BUDGET if over else None


class Moving(TaskMode):
    """A mode that moves the arm; it ends once the arm has arrived."""

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Look around once the arm has arrived."""
        memory = super().update(memory, now)
        there = memory.motion.arrived(now.senses.q, now.time)
        look = there and not memory.attempt.looked
        return self.look(memory, now) if look else memory

    def look(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Return the memory with what is seen at the end of the motion."""
        return memory

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the arm has arrived, or is stopped by something."""
        if memory.motion.arrived(now.senses.q, now.time):
            return self.observe_arrived(memory, now)
        late = now.time > memory.motion.due + self.config.arrival_timeout
        return Observation(failure=Failure.STOPPED if late else None)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Return what the mode's transitions depend on once the arm has arrived."""
        return Observation(arrived=True)


class Carrying(Moving):
    """A mode that moves the arm with the object in the hand."""

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Stop the arm where the hand loses the object."""
        memory = watch_grasp(memory, now.senses, now.time, self.config)
        return super().update(memory, now)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the object is still in the hand."""
        return Observation(arrived=True, holding=holding(memory, now.senses))


class BetweenAttempts(TaskMode):
    """A mode without a plan; as it begins, the previous plan is forgotten."""

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Judge the attempt that has ended, and forget its plan."""
        attempt, trouble = memory.attempt, memory.trouble
        totals, cycle = memory.totals, memory.cycle
        observed = entry.observation.failure if entry.observation else None
        failure, message = observed or trouble.failure, trouble.message
        if entry.previous is None:
            cycle = Cycle(started=entry.time)
        elif attempt.at_goal:
            failure, message = None, ""
            totals = dc.replace(totals, cycles=totals.cycles + 1)
            cycle = Cycle(started=entry.time)
        elif attempt.at_goal is False:
            failure = failure or Failure.MISPLACED
        # Where planning failed, its own words say more.
        worded = entry.previous is Mode.IDLE or attempt.trapped
        if failure is not None and not worded:
            message = trouble.touched or _MESSAGES.get(failure, message)
        return dc.replace(
            memory,
            motion=memory.motion.ended(entry.time),
            attempt=Attempt(began=entry.time, next_look=entry.time),
            totals=totals,
            cycle=cycle,
            trouble=dc.replace(trouble, failure=failure, message=message),
        )
