"""The modes of clearing a table: what each commands, looks at and observes."""

from __future__ import annotations

import dataclasses as dc
from typing import ClassVar, TypeAlias

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning import state_machine
from drake_srg.planning.clearing.clearing_memory import ClearingMemory
from drake_srg.planning.clearing.comparing import is_still
from drake_srg.planning.clearing.picking import PickPlanner
from drake_srg.planning.clearing.transitions import Observation
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.planner_machine import GIVES_UP
from drake_srg.planning.senses import HandSenses
from drake_srg.types import Failure, HeightMap, Mode

# Things that never quite come to rest are picked all the same after this time [s].
_PATIENCE = 3.0

Senses: TypeAlias = HandSenses[HeightMap]
Now: TypeAlias = state_machine.Moment[Senses]
Entry: TypeAlias = state_machine.Entry[Senses, Mode, Observation]


class ClearingMode(
    state_machine.ModeActions[Mode, ClearingMemory, Senses, Observation]
):
    """A mode that moves the arm, or waits; every mode checks the time budget.

    Attributes:
        mode: Which mode it is.
        planner: Plans the picks.
        config: Times and limits.
    """

    mode: ClassVar[Mode]

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
        if memory.motion.arrived(now.senses.q, now.time):
            return Observation(arrived=True)
        late = now.time > memory.motion.due + self.config.arrival_timeout
        return Observation(stuck=late)


class Idle(ClearingMode):
    """Looks until nothing moves any more, and plans the next pick."""

    mode = Mode.IDLE

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Rest."""
        motion = memory.motion.ended(entry.time)
        return dc.replace(memory, motion=motion, rested_at=entry.time)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Look whenever a look is due."""
        done = memory.pick is not None or memory.finished
        if done or now.time < memory.next_look:
            return memory
        before, seen = memory.height_map, now.senses.see()
        memory = dc.replace(
            memory,
            looks=memory.looks + 1,
            height_map=seen,
            next_look=now.time + self.config.search_period,
        )
        if before is None or now.time < self.config.search_time:
            return memory
        waited = now.time > memory.rested_at + _PATIENCE
        if not (waited or is_still(before, seen)):
            return memory
        return self.planner.plan(memory, seen, now.time)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report a pick once planning has taken its time, or that there is none."""
        pick = memory.pick
        ready = pick is not None and now.time >= pick.ready_at
        return Observation(ready=ready, finished=memory.finished)


class PreGrasp(ClearingMode):
    """Moves the open hand above the grasp."""

    mode = Mode.PRE_GRASP

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Open the fingers as far as the grasp needs, and go."""
        closure = memory.planned.grasp.closure_open
        return dc.replace(super().enter(memory, entry), closure=closure)


class Grasp(ClearingMode):
    """Moves the open hand down around the thing."""

    mode = Mode.GRASP

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Count the pick, and go."""
        return dc.replace(super().enter(memory, entry), picks=memory.picks + 1)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report the arrival; fingers that stand on something close where they are."""
        observed = super().observe_mode(memory, now)
        return Observation(arrived=observed.arrived or observed.stuck)


class Close(ClearingMode):
    """Closes the fingers."""

    mode = Mode.CLOSE

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Close the fingers."""
        closure = memory.planned.grasp.closure_closed
        return dc.replace(super().enter(memory, entry), closure=closure)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report whether the fingers rest."""
        return Observation(still=now.senses.still)


class Lift(ClearingMode):
    """Lifts straight up what the fingers have closed on."""

    mode = Mode.LIFT

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Remember how far the fingers have closed, and go."""
        memory = super().enter(memory, entry)
        pick = dc.replace(memory.planned, angles=entry.senses.fingers.copy())
        return dc.replace(memory, pick=pick)


class Transfer(ClearingMode):
    """Carries the load over the bin."""

    mode = Mode.TRANSFER

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Feel whether the load is still there when the arm arrives."""
        pick = memory.planned
        if not memory.motion.arrived(now.senses.q, now.time):
            return memory
        senses = now.senses
        if pick.grasp.tellable:
            told = pick.grasp.holds(senses.fingers, senses.proximity)
        else:  # fingers that lose so thin a load at least close further
            closing = np.mean(senses.fingers - pick.angles)
            told = bool(closing < self.config.slip_closing)
        held = senses.grasped and told
        return dc.replace(memory, pick=dc.replace(pick, held=held))


class Release(ClearingMode):
    """Opens the fingers over the bin; meanwhile, looks at the table and plans."""

    mode = Mode.RELEASE

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Let go, judge the pick by what is seen, and plan the next one.

        An arm that is stuck presses no further, and the pick has failed.
        """
        memory = dc.replace(memory, closure=memory.planned.grasp.closure_open)
        if entry.observation is not None and entry.observation.stuck:
            memory = dc.replace(memory, motion=Motion(entry.senses.q.copy()))
            return self.planner.give_up(memory)
        motion, looks = memory.motion.ended(entry.time), memory.looks + 1
        memory = dc.replace(memory, motion=motion, looks=looks)
        seen = entry.senses.see()
        return self.planner.plan(self.planner.judge(memory, seen), seen, entry.time)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report whether the fingers have let go, and whether the arm is stuck."""
        return Observation(clear=now.senses.clear, astray=memory.astray)


class LastChance(ClearingMode):
    """Moves after which nothing else is tried if something stops the arm."""

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report whether the arm has arrived; give up where something stops it."""
        observed = super().observe_mode(memory, now)
        failure = Failure.STOPPED if observed.stuck else None
        return Observation(arrived=observed.arrived, failure=failure)

    def planned(
        self,
        memory: ClearingMemory,
        entry: Entry,
        motion: Trajectory | PlanningFailure,
        wait: float = 0.0,
    ) -> ClearingMemory:
        """Return the memory with a motion begun, or with why there is none."""
        if isinstance(motion, PlanningFailure):
            return dc.replace(memory, failure=motion.failure, message=motion.message)
        followed = memory.motion.followed_by(motion, entry.time, wait)
        return dc.replace(memory, motion=followed, astray=False)


class Retreat(LastChance):
    """Moves the open hand up and over the bin from where something stopped it."""

    mode = Mode.RETREAT

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Plan the way back from where the arm is, and go."""
        fingers = memory.tried[-1].fingers_open
        motion = self.planner.motions.plan_retreat(memory.motion.q_rest, fingers)
        return self.planned(memory, entry, motion)


class Home(LastChance):
    """Moves the arm home."""

    mode = Mode.HOME

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Plan the way home, and go."""
        motion = self.planner.motions.plan_home(memory.motion.destination)
        return self.planned(memory, entry, motion, self.config.home_wait)


class End(ClearingMode):
    """Stays where it is: the task is over."""

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Stop, and remember why."""
        failure = entry.observation.failure if entry.observation else None
        message = memory.message
        if failure is not None:
            message = message or GIVES_UP.get(failure, "")
        motion = memory.motion.ended(entry.time)
        return dc.replace(memory, motion=motion, failure=failure, message=message)

    def observe(self, memory: ClearingMemory, now: Now) -> Observation:
        """Observe nothing."""
        return Observation()


class Done(End):
    """Nothing is left that a grasp takes, and the arm is home."""

    mode = Mode.DONE


class Failed(End):
    """The planner has given up, for the reason that its status names."""

    mode = Mode.FAILED


_KINDS: list[type[ClearingMode]] = [Idle, PreGrasp, Grasp, Close, Lift]
_KINDS += [Transfer, Release, Retreat, Home, Done, Failed]


def clearing_modes(planner: PickPlanner) -> dict[Mode, ClearingMode]:
    """Return what the planner does in each mode.

    Args:
        planner: Plans the picks.
    """
    return {kind.mode: kind(planner) for kind in _KINDS}
