"""The modes of picking and placing: their commands, looks and observations.

`knowledge.TRANSITIONS` has their successors. A mode holds no state: it changes the
planner's memory.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, TypeAlias

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning import state_machine
from drake_srg.planning.pick_and_place.knowledge import (
    Attempt,
    Cycle,
    PlannerMemory,
    Senses,
    holding,
    watch_grasp,
    watch_touch,
)
from drake_srg.planning.pick_and_place.replanning import Replanner
from drake_srg.planning.planner_machine import (
    GIVES_UP,
    Observation,
    PlannerConfig,
    PlannerMode,
)
from drake_srg.types import AnyMode, Failure, Mode

# Contact while setting down an object counts as reaching its goal if all joints are
# this near to the motion's end [rad]: 5 to 8 mm at the hand of an iiwa.
_SET_DOWN = 0.01

Now: TypeAlias = state_machine.Moment[Senses]
Entry: TypeAlias = state_machine.Entry[Senses, AnyMode, Observation]

_MESSAGES = {
    **GIVES_UP,
    Failure.NO_GRASP: "the fingers closed, but nothing of the right size is in them",
    Failure.DROPPED: "the object was in the hand and got lost",
    Failure.MISPLACED: "the object is not seen on its goal",
}


class TaskMode(PlannerMode[PlannerMemory, Senses]):
    """A mode of the task, which checks the time budget and external torques.

    For a mode of your own, derive from this class, `Moving` or `Carrying`, and set
    `mode`. If you override `enter` or `update`, call that of the base class.

    Attributes:
        mode: Its own mode.
        motion_of: Mode whose planned motion it uses; None: its own.
        config: Times and limits.
        replanner: Plans from sightings.
        repeat: Number of the task's cycles.
    """

    motion_of: ClassVar[AnyMode | None] = None

    def __init__(
        self, config: PlannerConfig, replanner: Replanner, repeat: int
    ) -> None:
        self.config = config
        self.replanner = replanner
        self.repeat = repeat

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Begin the mode's planned motion, if there is one."""
        memory.attempt.ready_at, memory.attempt.looked = entry.time, False
        return super().enter(memory, entry)

    def trajectory(self, memory: PlannerMemory) -> Trajectory | None:
        """Return the planned motion of the mode; None if the arm rests."""
        planned = memory.attempt.motions
        return planned.motions.get(self.motion_of or self.mode) if planned else None

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Stop the arm if it touches something."""
        watch_touch(memory, now.senses, self.config)
        return memory

    def final_failure(self, memory: PlannerMemory, time: float) -> Failure | None:
        """Return the failure that ends the task in any mode, or None."""
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
        if there and not memory.attempt.looked:
            self.look(memory, now)
        return memory

    def look(self, memory: PlannerMemory, now: Now) -> None:
        """Look at the end of the motion."""

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report that the arm has arrived, or that something has stopped it."""
        if memory.motion.arrived(now.senses.q, now.time):
            return self.observe_arrived(memory, now)
        late = now.time > memory.motion.due + self.config.arrival_timeout
        return Observation(failure=Failure.STOPPED if late else None)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Return the observation for the mode's transitions after the arm's arrival."""
        return Observation(arrived=True)


class Carrying(Moving):
    """A mode that moves the arm with the object in the hand."""

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Record the fingers' hold, unless an earlier mode has, and move."""
        if not len(memory.grip.angles):
            memory.grip.angles = entry.senses.fingers.copy()
            memory.grip.unheld_since = np.inf
        return super().enter(memory, entry)

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Stop the arm if the hand loses the object."""
        watch_grasp(memory, now.senses, now.time, self.config)
        return super().update(memory, now)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the object is still in the hand."""
        return Observation(arrived=True, holding=holding(memory, now.senses))


class Verifying(Carrying):
    """A mode that carries the object, and then verifies the grasp at rest."""

    @property
    def wait(self) -> float:
        """Time to verify the grasp [s]."""
        return self.config.verify_time


class BetweenAttempts(TaskMode):
    """A mode without a plan, which begins by discarding the previous plan."""

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Judge the attempt that has ended, and discard its plan."""
        attempt, trouble = memory.attempt, memory.trouble
        observed = entry.observation.failure if entry.observation else None
        failure = observed or trouble.failure
        if entry.previous is None:
            memory.cycle = Cycle(started=entry.time)
        elif attempt.at_goal:
            failure, trouble.message = None, ""
            memory.totals.cycles += 1
            memory.cycle = Cycle(started=entry.time)
        elif attempt.at_goal is False:
            failure = failure or Failure.MISPLACED
        # The motion planner's own message is more specific.
        worded = entry.previous is Mode.IDLE or attempt.trapped
        if failure is not None and not worded:
            trouble.message = trouble.touched or _MESSAGES.get(failure, trouble.message)
        trouble.failure = failure
        memory.motion = memory.motion.ended(entry.time)
        memory.attempt = Attempt(began=entry.time, next_look=entry.time)
        return memory


class Idle(BetweenAttempts):
    """Looks for the object, and plans all motions."""

    mode = Mode.IDLE

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Look, and plan, whenever a look is due."""
        memory = super().update(memory, now)
        if now.time >= memory.attempt.next_look:
            self.look(memory, now)
        return memory

    def look(self, memory: PlannerMemory, now: Now) -> None:
        """Look, and plan from the sighting."""
        self.replanner.plan(now.senses.see(), memory, now.time)

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report motions, an escape or a failure, once the planning latency is over."""
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
        """Open the fingers as far as the object needs, and move."""
        grasp = memory.attempt.planned.grasp
        memory.closure = grasp.closure_open
        memory.grip.fingers_open = grasp.fingers_open
        return super().enter(memory, entry)

    def look(self, memory: PlannerMemory, now: Now) -> None:
        """Check that the object is still where the grasp was planned."""
        if self.config.look_before_grasp:
            self.replanner.compare(now.senses.see(), memory, now.time)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether anything has moved."""
        return Observation(arrived=True, moved=memory.attempt.moved)


class Grasp(Moving):
    """Moves the open hand around the object."""

    mode = Mode.GRASP

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Count the attempt, and move."""
        memory.cycle.attempts += 1
        memory.totals.attempts += 1
        return super().enter(memory, entry)


class Close(TaskMode):
    """Closes the fingers on the object."""

    mode: ClassVar[AnyMode] = Mode.CLOSE

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Close the fingers, and forget any earlier hold."""
        memory.closure = memory.attempt.planned.grasp.closure_closed
        memory.grip.angles = np.zeros(0)
        return super().enter(memory, entry)

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the fingers rest, and whether they hold the object."""
        senses = now.senses
        return Observation(still=senses.still, holding=holding(memory, senses))


class Verify(TaskMode):
    """Verifies that the fingers hold the object."""

    mode = Mode.VERIFY

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the fingers hold the object."""
        return Observation(holding=holding(memory, now.senses))


class Lift(Verifying):
    """Lifts the object off its support."""

    mode = Mode.LIFT


class Transfer(Verifying):
    """Carries the object above its goal, and looks at it there."""

    mode = Mode.TRANSFER

    def look(self, memory: PlannerMemory, now: Now) -> None:
        """Find the object's pose in the hand, and correct the placement."""
        if self.config.look_before_place and not memory.attempt.lost:
            self.replanner.correct(now.senses.see(), memory, now.time)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the object is held, and the result of planning."""
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
        """Accept contact near the end: an object that hangs askew arrives early."""
        touched = memory.trouble.touched
        left = np.max(np.abs(memory.motion.destination - now.senses.q))
        memory = super().update(memory, now)
        if memory.trouble.touched and left < _SET_DOWN:
            memory.trouble.touched = touched
        return memory


class Release(TaskMode):
    """Opens the fingers, and plans an escape if the object was lost."""

    mode: ClassVar[AnyMode] = Mode.RELEASE

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Open the fingers."""
        grasp = memory.attempt.planned.grasp
        memory.closure = grasp.closure_open
        memory = super().enter(memory, entry)
        if entry.previous is Mode.PLACE and not memory.attempt.lost:
            return memory
        held = entry.previous is not Mode.VERIFY
        memory.trouble.failure = Failure.DROPPED if held else Failure.NO_GRASP
        memory.cycle.tried = (*memory.cycle.tried, grasp.name)
        self.replanner.escape(memory, entry.time)
        return memory

    def observe_entry(self, memory: PlannerMemory) -> Observation | None:
        """Report that the arm has no escape."""
        if not memory.attempt.trapped:
            return None
        return Observation(failure=memory.trouble.failure)

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the fingers rest, and are clear once an escape is planned."""
        clear = now.time >= memory.attempt.ready_at and now.senses.clear
        return Observation(still=now.senses.still, clear=clear)


class Retreat(Moving):
    """Draws the hand back from the object."""

    mode: ClassVar[AnyMode] = Mode.RETREAT

    def trajectory(self, memory: PlannerMemory) -> Trajectory | None:
        """Return the escape, if there is one, or the planned motion."""
        escape = memory.attempt.escape
        return escape[0] if escape else super().trajectory(memory)


class Home(Moving):
    """Moves the arm home, and checks from there whether the object is on its goal."""

    mode: ClassVar[AnyMode] = Mode.HOME

    @property
    def wait(self) -> float:
        """Time at home, including the time for the fingers to close [s]."""
        return self.config.home_wait + self.config.close_at_home

    def trajectory(self, memory: PlannerMemory) -> Trajectory | None:
        """Return the escape, if there is one, or the planned motion."""
        escape = memory.attempt.escape
        return escape[1] if escape else super().trajectory(memory)

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Close the empty fingers towards the end, if the configuration says so."""
        if 0.0 < self.config.close_at_home >= memory.motion.due - now.time:
            memory.closure = 1.0
        return super().update(memory, now)

    def look(self, memory: PlannerMemory, now: Now) -> None:
        """Check that the object is on its goal."""
        # The object may have been dropped onto its goal.
        hopeful = memory.trouble.failure in (None, Failure.DROPPED)
        if hopeful and self.final_failure(memory, now.time) is None:
            self.replanner.judge(now.senses.see(), memory, now.time)

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
        """Keep the memory."""
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
    config: PlannerConfig,
    replanner: Replanner,
    repeat: int,
    kinds: Iterable[type[TaskMode]] = (),
) -> dict[AnyMode, TaskMode]:
    """Return the actions of each mode.

    Args:
        config: Times and limits.
        replanner: Plans from sightings.
        repeat: Number of the task's cycles.
        kinds: Additional modes, or replacements of those of picking and placing.
    """
    return {kind.mode: kind(config, replanner, repeat) for kind in (*_KINDS, *kinds)}
