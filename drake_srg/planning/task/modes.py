"""The modes of picking and placing: what each commands, looks at and observes.

`transitions.TRANSITIONS` says where each of them leads. A mode holds no state: it takes
the planner's memory and returns the next one.
"""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.task.config import PlannerConfig
from drake_srg.planning.task.observing import holding
from drake_srg.planning.task.planner_memory import Attempt, PlannerMemory
from drake_srg.planning.task.replanning import Replanner
from drake_srg.planning.task.task_mode import (
    BetweenAttempts,
    Carrying,
    Entry,
    Moving,
    Now,
    TaskMode,
)
from drake_srg.planning.task.transitions import Observation
from drake_srg.types import Failure, Mode

# Joint error within which what an object meets as it is set down is its goal [rad]: 5
# to 8 mm at the hand of an iiwa.
_SET_DOWN = 0.01


class Idle(BetweenAttempts):
    """Looks for the object, and plans all motions from where it is seen."""

    mode = Mode.IDLE

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Look and plan whenever a look is due."""
        memory = super().update(memory, now)
        if now.time < memory.attempt.next_look:
            return memory
        return self.replanner.plan(now.senses.see(), memory, now.time)

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report motions, a way out or a failure, once planning has taken its time."""
        attempt = memory.attempt
        if now.time < attempt.ready_at:
            return Observation()
        planned, stuck = attempt.motions is not None, attempt.escape is not None
        failure = None if planned or stuck else memory.trouble.failure
        return Observation(ready=planned, stuck=stuck, failure=failure)


class PreGrasp(Moving):
    """Moves the open hand in front of the object."""

    mode = Mode.PRE_GRASP

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Open the fingers as far as the object needs, and go."""
        memory, grasp = super().enter(memory, entry), memory.attempt.planned.grasp
        grip = dc.replace(
            memory.grip, closure=grasp.closure_open, fingers_open=grasp.fingers_open
        )
        return dc.replace(memory, grip=grip)

    def look(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """See whether the object is still where the motions take it."""
        if not self.config.look_before_grasp:
            return memory
        return self.replanner.compare(now.senses.see(), memory, now.time)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether anything has moved."""
        return Observation(arrived=True, moved=memory.attempt.moved)


class Grasp(Moving):
    """Moves the open hand around the object."""

    mode = Mode.GRASP

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Count the attempt, and go."""
        cycle, totals = memory.cycle, memory.totals
        return dc.replace(
            super().enter(memory, entry),
            cycle=dc.replace(cycle, attempts=cycle.attempts + 1),
            totals=dc.replace(totals, attempts=totals.attempts + 1),
        )


class Close(TaskMode):
    """Closes the fingers on the object."""

    mode = Mode.CLOSE

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Close the fingers."""
        memory, grasp = super().enter(memory, entry), memory.attempt.planned.grasp
        grip = dc.replace(memory.grip, closure=grasp.closure_closed)
        return dc.replace(memory, grip=grip)

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the fingers rest, and whether they hold the object."""
        senses = now.senses
        return Observation(still=senses.still, holding=holding(memory, senses))


class Verify(TaskMode):
    """Makes sure that the fingers hold the object."""

    mode = Mode.VERIFY

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the fingers hold the object."""
        return Observation(holding=holding(memory, now.senses))


class Lift(Carrying):
    """Lifts the object off its support, and makes sure that it is held."""

    mode = Mode.LIFT

    @property
    def wait(self) -> float:
        """Time to verify the grasp at rest [s]."""
        return self.config.verify_time

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Remember how the fingers hold the object, and go."""
        grip = dc.replace(
            memory.grip, angles=entry.senses.fingers.copy(), unheld_since=np.inf
        )
        return dc.replace(super().enter(memory, entry), grip=grip)


class Transfer(Carrying):
    """Carries the object above its goal, and looks at it there."""

    mode = Mode.TRANSFER

    @property
    def wait(self) -> float:
        """Time to verify the grasp at rest [s]."""
        return self.config.verify_time

    def look(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """See where the object is in the hand, and correct its placing."""
        if not self.config.look_before_place or memory.attempt.lost:
            return memory
        return self.replanner.correct(now.senses.see(), memory, now.time)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the object is held, and how planning went."""
        return Observation(
            arrived=True,
            holding=holding(memory, now.senses),
            ready=now.time >= memory.attempt.ready_at,
            failure=memory.trouble.failure,
        )


class Place(Carrying):
    """Sets the object down on its goal."""

    mode = Mode.PLACE

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """End where the object meets its goal early, as one that hangs askew does."""
        after = super().update(memory, now)
        left = np.max(np.abs(memory.motion.destination - now.senses.q))
        if after.trouble.touched and left < _SET_DOWN:
            return dc.replace(after, trouble=memory.trouble)
        return after


class Release(TaskMode):
    """Opens the fingers, and plans an escape if the object was lost."""

    mode = Mode.RELEASE

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Open the fingers."""
        memory, grasp = super().enter(memory, entry), memory.attempt.planned.grasp
        grip = dc.replace(memory.grip, closure=grasp.closure_open)
        memory = dc.replace(memory, grip=grip)
        if entry.previous is Mode.PLACE and not memory.attempt.lost:
            return memory
        held = entry.previous is not Mode.VERIFY
        failure = Failure.DROPPED if held else Failure.NO_GRASP
        tried = (*memory.cycle.tried, grasp.name)
        memory = dc.replace(
            memory,
            cycle=dc.replace(memory.cycle, tried=tried),
            trouble=dc.replace(memory.trouble, failure=failure),
        )
        return self.replanner.escape(memory, entry.time)

    def observe_entry(self, memory: PlannerMemory) -> Observation | None:
        """Report that the arm has no way out."""
        if not memory.attempt.trapped:
            return None
        return Observation(failure=memory.trouble.failure)

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report fingers that rest clear of the object, once an escape is planned."""
        clear = now.time >= memory.attempt.ready_at and now.senses.clear
        return Observation(still=now.senses.still, clear=clear)


class Retreat(Moving):
    """Draws the hand back from the object."""

    mode = Mode.RETREAT

    def trajectory(self, attempt: Attempt) -> Trajectory | None:
        """Return the escape, if there is one, or the planned motion."""
        return attempt.escape[0] if attempt.escape else super().trajectory(attempt)


class Home(Moving):
    """Moves the arm home, and looks from there whether the object is on its goal."""

    mode = Mode.HOME

    @property
    def wait(self) -> float:
        """Time at home, including that for the fingers to close [s]."""
        return self.config.home_wait + self.config.close_at_home

    def trajectory(self, attempt: Attempt) -> Trajectory | None:
        """Return the escape, if there is one, or the planned motion."""
        return attempt.escape[1] if attempt.escape else super().trajectory(attempt)

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Close the empty fingers towards the end, if the configuration says so."""
        if 0.0 < self.config.close_at_home >= memory.motion.due - now.time:
            memory = dc.replace(memory, grip=dc.replace(memory.grip, closure=1.0))
        return super().update(memory, now)

    def look(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """See whether the object is on its goal."""
        # What was dropped may have been dropped onto its goal.
        hopeful = memory.trouble.failure in (None, Failure.DROPPED)
        if not hopeful or self.final_failure(memory, now.time) is not None:
            return memory
        return self.replanner.judge(now.senses.see(), memory, now.time)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the object is on its goal, and whether to give up."""
        at_goal = bool(memory.attempt.at_goal)
        out_of_attempts = memory.cycle.attempts >= self.config.max_attempts
        failure = memory.trouble.failure or Failure.MISPLACED
        return Observation(
            arrived=True,
            at_goal=at_goal,
            last_cycle=memory.totals.cycles + 1 >= self.repeat,
            failure=failure if out_of_attempts and not at_goal else None,
        )


class End(BetweenAttempts):
    """Stays where it is: the task is over."""

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Heed nothing."""
        return memory

    def observe(self, memory: PlannerMemory, now: Now) -> Observation:
        """Observe nothing."""
        return Observation()


class Done(End):
    """The object is on its goal, and the arm at home."""

    mode = Mode.DONE


class Failed(End):
    """The planner has given up, for the reason that its status names."""

    mode = Mode.FAILED


_KINDS: tuple[type[TaskMode], ...] = (
    *(Idle, PreGrasp, Grasp, Close, Verify, Lift, Transfer, Place),
    *(Release, Retreat, Home, Done, Failed),
)


def task_modes(
    config: PlannerConfig, replanner: Replanner, repeat: int
) -> dict[Mode, TaskMode]:
    """Return what the planner does in each mode.

    Args:
        config: Times and limits.
        replanner: Plans from what is seen.
        repeat: How many cycles the task has.
    """
    return {kind.mode: kind(config, replanner, repeat) for kind in _KINDS}
