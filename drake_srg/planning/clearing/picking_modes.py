"""The modes of one pick, from above the grasp until the hand has let go."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.planning.clearing.arriving import look_for_load
from drake_srg.planning.clearing.clearing_memory import ClearingMemory
from drake_srg.planning.clearing.clearing_mode import (
    ClearingMode,
    Entry,
    Now,
)
from drake_srg.planning.clearing.comparing import has_moved
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.planner_machine import Observation
from drake_srg.types import Mode


class PreGrasp(ClearingMode):
    """Moves the open hand above the grasp, unless the thing there moves meanwhile.

    A thing that stands on an edge takes seconds to fall over. Halfway, the hand does
    not hide it yet. If it has moved, the hand goes back. It does so once for a pick.

    Tips that were bent as the hand let go are still bent if it could not open far: by
    Algorithm 1, they stretch only while it opens. Then it first opens fully.
    """

    mode = Mode.PRE_GRASP

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Open the fingers as far as the grasp needs, and go."""
        straight = memory.planned.grasp.fingers.straight(entry.senses.fingers)
        closure = memory.planned.grasp.closure_open if straight else 0.0
        return dc.replace(super().enter(memory, entry), closure=closure)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Look at the thing halfway."""
        if memory.pick and memory.pick.grasp.fingers.straight(now.senses.fingers):
            closure = memory.pick.grasp.closure_open
            memory = dc.replace(memory, closure=closure)
        pick, motion = memory.pick, memory.motion
        if pick is None or pick.confirmed or memory.doubtful:
            return memory
        if now.time < 0.5 * (motion.departed + motion.due):
            return memory
        moved = has_moved(pick.height_map, now.senses.see(), pick.grasp.p_WC)
        memory = dc.replace(memory, looks=memory.looks + 1)
        if not moved:
            return dc.replace(memory, pick=dc.replace(pick, confirmed=True))
        stopped = motion.stopped(now.time)
        return dc.replace(memory, pick=None, doubtful=True, motion=stopped)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report the arrival with straight fingers, and whether there is still a pick.

        Fingers that stay bent are not waited for longer than they take to open.
        """
        observed = super().observe_mode(memory, now)
        if memory.pick is None:
            return dc.replace(observed, moved=True)
        ready = memory.closure == memory.pick.grasp.closure_open
        ready |= now.time > memory.motion.due + self.config.gripper_timeout
        return dc.replace(observed, arrived=observed.arrived and ready)


class Grasp(ClearingMode):
    """Moves the open hand down around the thing."""

    mode = Mode.GRASP

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Count the pick, and go."""
        return dc.replace(
            super().enter(memory, entry),
            closure=memory.planned.grasp.closure_open,
            picks=memory.picks + 1,
            doubtful=False,
        )

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report the arrival; fingers that stand on something close where they are."""
        observed = super().observe_mode(memory, now)
        return Observation(arrived=observed.arrived or observed.stuck)


class Close(ClearingMode):
    """Closes the fingers; meanwhile, looks for the load before, away from the arm."""

    mode = Mode.CLOSE

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Close the fingers, and judge the load before."""
        closure = memory.planned.grasp.closure_closed
        memory = look_for_load(memory, entry.senses.see_destinations())
        return dc.replace(super().enter(memory, entry), closure=closure)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report whether the fingers rest."""
        return Observation(still=now.senses.still)


class Lift(ClearingMode):
    """Lifts what the fingers have closed on, straight up at first."""

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

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report the arrival, and whether the load is to be set down."""
        observed = super().observe_mode(memory, now)
        return dc.replace(observed, placing=memory.planned.placing)


class Place(ClearingMode):
    """Lowers the load to where it is set down."""

    mode = Mode.PLACE
    yields = True


class Release(ClearingMode):
    """Opens the fingers over the bin; meanwhile, looks at the table and plans."""

    mode = Mode.RELEASE

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Let go, judge the pick by what is seen, and plan the next one.

        What is dropped may have slipped up to where the fingers are nearer to each
        other: the hand opens fully. Beside what is set down, there may be others.

        An arm that is stuck presses no further. The pick has failed then, unless the
        load already stands on something.
        """
        pick = memory.planned
        grasp, placing = pick.grasp, pick.placing
        closure = grasp.closure_open if placing else 0.0
        fingers = grasp.fingers_open if placing else {}
        memory = dc.replace(
            memory,
            closure=closure,
            hand=grasp.fingers,
            fingers=fingers,
            released_at=entry.time,
        )
        stuck = entry.observation is not None and entry.observation.stuck
        if stuck and entry.previous is not Mode.PLACE:
            memory = dc.replace(memory, motion=Motion(entry.senses.q.copy()))
            return self.planner.give_up(memory)
        ended = memory.motion.ended(entry.time)
        motion = Motion(entry.senses.q.copy()) if stuck else ended
        looks = memory.looks + 1
        memory = dc.replace(memory, motion=motion, looks=looks)
        seen = pick.without_load(entry.senses.see())
        memory = self.planner.judge(memory, seen)
        if placing:  # then the hand must first leave what it has placed
            way_out = None if stuck else self.planner.way_out(memory, pick)
            memory = dc.replace(memory, astray=True, way_out=way_out)
            if way_out is None:
                return memory
        return self.planner.plan(memory, seen, entry.time)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Open fully if the fingers have come to rest and would lift the load again.

        It may have turned between their bases, or stand on tips that are still bent,
        because something has pushed these fingers open, such as the wall of a bin.
        """
        # Fingers also rest for a moment once their tips have stretched.
        late = now.time >= memory.released_at + 0.5 * self.config.gripper_timeout
        if not (late and now.senses.still) or _has_let_go(memory, now):
            return memory
        return dc.replace(memory, closure=0.0, fingers={})

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report whether the fingers have let go, and whether the arm must retreat."""
        # A load may touch fingers again that do not open fully.
        open_ = memory.closure == 0.0 or now.senses.still
        clear = open_ and _has_let_go(memory, now)
        return Observation(clear=clear, astray=memory.astray)


def _has_let_go(memory: ClearingMemory, now: Now) -> bool:
    """Return whether nothing is near the fingers, which are straight."""
    hand, senses = memory.hand, now.senses
    return senses.clear and (hand is None or hand.straight(senses.fingers))
