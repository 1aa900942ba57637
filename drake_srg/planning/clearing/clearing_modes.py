"""The modes of clearing a table that look and push, and all modes together."""

from __future__ import annotations

import dataclasses as dc

from drake_srg.planning.clearing.clearing_memory import ClearingMemory
from drake_srg.planning.clearing.clearing_mode import (
    ClearingMode,
    Entry,
    Now,
)
from drake_srg.planning.clearing.comparing import is_still
from drake_srg.planning.clearing.ending_modes import (
    Done,
    Failed,
    Home,
    Retreat,
    Verify,
)
from drake_srg.planning.clearing.picking import PickPlanner
from drake_srg.planning.clearing.picking_modes import (
    Close,
    Grasp,
    Lift,
    Place,
    PreGrasp,
    Release,
    Transfer,
)
from drake_srg.planning.planner_machine import Observation
from drake_srg.types import Mode

# Things that never quite come to rest are picked all the same after this time [s].
_PATIENCE = 3.0


class Idle(ClearingMode):
    """Looks until nothing moves any more, and plans the next pick."""

    mode = Mode.IDLE

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Rest."""
        motion = memory.motion.ended(entry.time)
        return dc.replace(memory, motion=motion, rested_at=entry.time)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Look whenever a look is due, from the last look before `search_time` on."""
        done = memory.pick or memory.push or memory.finished
        if done or now.time < memory.next_look:
            return memory
        next_look = now.time + self.config.search_period
        if next_look + self.config.period < self.config.search_time:
            return dc.replace(memory, next_look=next_look)
        before, seen = memory.height_map, now.senses.see()
        memory = dc.replace(
            memory,
            looks=memory.looks + 1,
            height_map=seen,
            next_look=next_look,
        )
        if before is None or now.time < self.config.search_time:
            return memory
        waited = now.time > memory.rested_at + _PATIENCE
        if not (waited or is_still(before, seen)):
            return memory
        return self.planner.plan(memory, seen, now.time)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report a pick or a push once planning has taken its time, or the end."""
        pick, push = memory.pick, memory.push
        return Observation(
            ready=pick is not None and now.time >= pick.ready_at,
            pushing=push is not None and now.time >= push.ready_at,
            finished=memory.finished,
            unseen=memory.drop is not None,
        )


class Push(ClearingMode):
    """Pushes the top off a heap with the closed hand, and goes back over the bin."""

    mode = Mode.PUSH
    yields = True

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Close the hand, and begin the first motion."""
        assert memory.push is not None, "this mode needs a planned push"
        pushed = (*memory.pushed, memory.push.push)
        memory = dc.replace(memory, closure=1.0, pushed=pushed)
        return _next_motion(memory, entry.time)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Begin the next motion when one is over."""
        over = memory.motion.arrived(now.senses.q, now.time)
        return _next_motion(memory, now.time) if over and memory.push else memory


def _next_motion(memory: ClearingMemory, time: float) -> ClearingMemory:
    """Return the memory with the next motion of the push begun."""
    assert memory.push is not None
    motion, *rest = memory.push.motions
    push = dc.replace(memory.push, motions=tuple(rest)) if rest else None
    motion = memory.motion.followed_by(motion, time)
    return dc.replace(memory, motion=motion, push=push)


_KINDS: list[type[ClearingMode]] = [Idle, Push, PreGrasp, Grasp, Close, Lift]
_KINDS += [Transfer, Place, Release, Retreat, Verify, Home, Done, Failed]


def clearing_modes(planner: PickPlanner) -> dict[Mode, ClearingMode]:
    """Return what the planner does in each mode.

    Args:
        planner: Plans the picks.
    """
    return {kind.mode: kind(planner) for kind in _KINDS}
