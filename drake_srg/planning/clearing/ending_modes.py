"""The modes of clearing a table in which the arm goes back, or the task ends."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.arriving import look_for_load
from drake_srg.planning.clearing.clearing_memory import ClearingMemory
from drake_srg.planning.clearing.clearing_mode import ClearingMode, Entry, Now
from drake_srg.planning.clearing.comparing import completed
from drake_srg.planning.clearing.destination import AROUND
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.planner_machine import GIVES_UP, Observation
from drake_srg.types import Failure, Mode


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
    """Moves the open hand up and over the bin from where it got stuck or has placed."""

    mode = Mode.RETREAT

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Plan the way back from where the arm is, unless there is one, and go."""
        if memory.way_out is not None:
            return self.planned(dc.replace(memory, way_out=None), entry, memory.way_out)
        q = entry.senses.q.copy()
        memory = dc.replace(memory, motion=Motion(q), push=None)
        fingers = memory.fingers if memory.astray else {}
        motion = self.planner.motions.plan_retreat(q, fingers)
        return self.planned(memory, entry, motion)


class Verify(LastChance):
    """Moves the arm aside and looks for the last load, and for anything beside it."""

    mode = Mode.VERIFY

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Plan the way aside, and go."""
        planner = self.planner
        motion = planner.motions.plan_way(memory.motion.destination, planner.q_aside)
        return self.planned(memory, entry, motion)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Look once the arm is aside, and plan a pick of what is there after all."""
        if memory.drop is None or not memory.motion.arrived(now.senses.q, now.time):
            return memory
        seen = now.senses.see()
        around = memory.drop.destination.contains(seen, AROUND)
        height = np.where(around, seen.height, np.nan)
        seen = completed(dc.replace(seen, height=height), memory.height_map)
        memory = look_for_load(memory, now.senses.see_destinations())
        return self.planner.plan(memory, seen, now.time)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report the arrival once the planner has looked."""
        observed = super().observe_mode(memory, now)
        return dc.replace(observed, arrived=observed.arrived and memory.drop is None)


class Home(LastChance):
    """Moves the arm home."""

    mode = Mode.HOME

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Plan the way home, and go; wait there until the last load has settled."""
        motions = self.planner.motions
        motion = motions.plan_way(memory.motion.destination, motions.q_home)
        wait = memory.released_at + self.config.home_wait - entry.time
        if not isinstance(motion, PlanningFailure):
            wait -= motion.end_time()
        return self.planned(memory, entry, motion, max(wait, 0.0))


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
