"""The modes of a handover: motions, forces and observations of both arms.

Up to the lift, the giver goes through the modes of picking and placing. From the
transfer on, the receiver does. These are the modes in between.
"""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.planning.handover.config import (
    Handover,
    HandoverMemory,
    HandoverMode,
    HandoverSenses,
    Side,
)
from drake_srg.planning.handover.motions import (
    GIVER,
    RECEIVER,
    HandoverMotions,
    HandoverTaskPlanner,
)
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.pick_and_place.knowledge import (
    Attempt,
    PlannerMemory,
    Senses,
)
from drake_srg.planning.pick_and_place.modes import (
    Carrying,
    Close,
    Entry,
    Home,
    Idle,
    Moving,
    Now,
    Place,
    Release,
    Retreat,
    TaskMode,
    Transfer,
    Verifying,
)
from drake_srg.planning.pick_and_place.replanning import Replanner
from drake_srg.planning.pick_and_place.sightings import Sightings, View
from drake_srg.planning.planner_machine import Observation
from drake_srg.types import Failure, Mode, Vector

_UP = np.array([0.0, 0.0, 1.0])


class HandoverReplanner(Replanner):
    """Plans for one arm, with the other as an obstacle where it is now.

    Args:
        planner: Plans the motions of both arms.
        sightings: Finds the task's objects in views.
        config: Times and distances.
        receiver: Whether it plans the receiver's motions.
    """

    def __init__(
        self,
        planner: HandoverTaskPlanner,
        sightings: Sightings,
        config: Handover,
        *,
        receiver: bool,
    ) -> None:
        super().__init__(planner.receiver if receiver else planner, sightings, config)
        self.both, self._arm = planner, RECEIVER if receiver else GIVER

    def correct(self, view: View, memory: PlannerMemory, time: float) -> None:
        """Find the object's pose in the hand, and plan the rest from there."""
        q, fingers = _stance(memory_of(memory).other)
        with self.both.pair.beside(self._arm, q, fingers):
            super().correct(view, memory, time)

    def escape(self, memory: PlannerMemory, time: float) -> None:
        """Plan a retreat from here, and home; if there is none, the arm is trapped."""
        q, fingers = _stance(memory_of(memory).other)
        with self.both.pair.beside(self._arm, q, fingers):
            super().escape(memory, time)


def memory_of(memory: PlannerMemory) -> HandoverMemory:
    """Return the memory, cast to a handover's type."""
    assert isinstance(memory, HandoverMemory)
    return memory


def _stance(side: Side) -> tuple[Vector, dict[str, float]]:
    """Return the end of an arm's motion, and the angles of its fingers."""
    if side.attempt.motions is None:
        return side.motion.destination, dict(side.grip.fingers_open)
    grasp = side.attempt.motions.grasp
    closed = side.closure >= grasp.closure_closed
    fingers = grasp.fingers_closed if closed else grasp.fingers_open
    return side.motion.destination, dict(fingers)


def _senses_of_other(senses: Senses) -> Senses:
    assert isinstance(senses, HandoverSenses)
    assert senses.other is not None
    return senses.other


def other_holds(memory: HandoverMemory, senses: Senses) -> bool:
    """Return whether the other arm holds the object."""
    motions = memory.other.attempt.motions
    others = _senses_of_other(senses)
    if motions is None or not others.grasped:
        return False
    return motions.grasp.holds(others.fingers, others.proximity)


class _Turn(TaskMode):
    """A mode of one of the arms, which gets the turn as the mode begins."""

    receiver: bool = False

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Give the arm the turn, and begin."""
        mine = memory_of(memory)
        if mine.receiving != self.receiver:
            before = entry.senses
            mine.turn_to(receiver=self.receiver)
            swapped = HandoverSenses(
                **{**vars(_senses_of_other(before)), "other": before}
            )
            entry = dc.replace(entry, senses=swapped)
        return super().enter(mine, entry)


class _ReceiversTurn(_Turn):
    receiver = True


class Begin(Idle):
    """Looks for the object, and plans the whole handover, which the giver begins."""

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Judge the attempt of the arm that had the turn; then begin anew."""
        mine = memory_of(super().enter(memory, entry))
        mine.turn_to(receiver=False)
        mine.motion = mine.motion.ended(entry.time)
        mine.attempt = Attempt(began=entry.time, next_look=entry.time)
        mine.other.attempt = Attempt()
        mine.takes, mine.taken = 0, False
        return mine

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Once there is a plan, open the receiver's fingers as far as it needs."""
        mine = memory_of(super().update(memory, now))
        plan = mine.attempt.motions
        if isinstance(plan, HandoverMotions):
            mine.other.closure = plan.receiver.grasp.closure_open
        return mine


class Carry(_Turn, Verifying):
    """Carries the object near the meeting point."""

    mode = HandoverMode.CARRY
    motion_of = Mode.TRANSFER


class Present(_Turn, Carrying):
    """Presents the object where the receiver can take it."""

    mode = HandoverMode.PRESENT
    motion_of = Mode.PLACE


class Approach(_ReceiversTurn, Moving):
    """Moves the receiver's open hand in front of the object."""

    mode = HandoverMode.APPROACH

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Begin the receiver's motions, and open its fingers."""
        mine = memory_of(memory)
        mine.turn_to(receiver=True)
        plan = mine.other.attempt.planned
        assert isinstance(plan, HandoverMotions)
        mine.takes += 1
        mine.attempt = Attempt(began=entry.time, motions=plan.receiver, X_WO=plan.X_WO)
        grasp = plan.receiver.grasp
        mine.closure, mine.grip.fingers_open = grasp.closure_open, grasp.fingers_open
        return super().enter(mine, entry)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the giver still holds the object."""
        return Observation(
            arrived=True, holding=other_holds(memory_of(memory), now.senses)
        )


class Reach(Approach):
    """Moves the receiver's open hand around the object."""

    mode = HandoverMode.REACH

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Begin the motion."""
        return super(Approach, self).enter(memory, entry)


class Take(_ReceiversTurn, Close):
    """Closes the receiver's fingers on the object that the giver holds."""

    mode = HandoverMode.TAKE


class Pull(_ReceiversTurn, Carrying):
    """Pulls the object gently out of the giver's hand, until the giver feels it."""

    mode = HandoverMode.PULL
    config: Handover
    replanner: HandoverReplanner

    @property
    def wait(self) -> float:
        """Time for the filtered force to settle after the pull [s]."""
        return 3.0 * self.config.pull_time

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Record the giver's torques, and begin to pull."""
        memory = super().enter(memory, entry)
        mine = memory_of(memory)
        torque = _senses_of_other(entry.senses).external_torque
        assert torque is not None, "the planner's `feels` asks for it"
        mine.torque_before = mine.torque = torque.copy()
        return memory

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Average the giver's torques, and stop once it feels the pull."""
        memory = super().update(memory, now)
        mine, giver = memory_of(memory), _senses_of_other(now.senses)
        assert giver.external_torque is not None
        share = min(self.config.period / self.config.pull_time, 1.0)
        mine.torque = mine.torque + share * (giver.external_torque - mine.torque)
        if not mine.taken and self.felt(mine, giver.q) >= self.config.pull_force:
            mine.taken = True
            mine.motion = mine.motion.stopped(now.time)
        return mine

    def felt(self, memory: HandoverMemory, q: Vector) -> float:
        """Return the change of force at the giver's hand along the pull [N].

        Args:
            memory: Memory with the torques.
            q: The giver's posture, shape (N,) [rad].
        """
        torque = memory.torque - memory.torque_before
        jacobian = self.replanner.both.scene.jacobian(q)
        # Torques of a wrench at the hand: tau = J' F.
        wrench, *_ = np.linalg.lstsq(jacobian.T, torque, rcond=None)
        return float(wrench[:3] @ -_UP)

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report that the pull is over, or that the receiver has lost the object."""
        if memory.attempt.lost:
            return Observation(arrived=True)
        return super().observe_mode(memory, now)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the object has been taken."""
        return Observation(arrived=True, ready=memory_of(memory).taken)


class LetGo(_Turn, Release):
    """Opens the giver's fingers: the receiver has the object, or it is lost."""

    mode = HandoverMode.LET_GO

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Open the fingers; plan an escape if the receiver has not taken the object."""
        mine = memory_of(memory)
        if not mine.taken:
            return super().enter(mine, entry)
        mine.turn_to(receiver=False)
        mine.closure = mine.attempt.planned.grasp.closure_open
        mine.attempt.escape, mine.attempt.ready_at = None, entry.time
        return TaskMode.enter(self, mine, entry)


class Withdraw(_Turn, Retreat):
    """Draws the giver's hand back."""

    mode = HandoverMode.WITHDRAW


class Clear(_Turn, Home):
    """Moves the giver home."""

    mode = HandoverMode.CLEAR

    def look(self, memory: PlannerMemory, now: Now) -> None:
        """Look for the object only if neither arm holds it."""
        if not memory_of(memory).taken:
            super().look(memory, now)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report whether the receiver has the object, or whether to give up."""
        if memory_of(memory).taken:
            return Observation(arrived=True, ready=True)
        return super().observe_arrived(memory, now)


class Secure(_ReceiversTurn, Verifying):
    """Moves the object, in the receiver's hand alone, back to the start of the pull."""

    mode = HandoverMode.SECURE
    replanner: HandoverReplanner

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Plan the way back over the few millimetres of the pull."""
        memory = super().enter(memory, entry)
        mine = memory_of(memory)
        plan, rest = mine.other.attempt.planned, mine.motion.ended(entry.time)
        assert isinstance(plan, HandoverMotions)
        back = self.replanner.both.back(rest.destination, plan)
        if isinstance(back, PlanningFailure):
            mine.attempt.trapped = True
            mine.trouble.failure, mine.trouble.message = back.failure, back.message
        else:
            mine.motion = rest.followed_by(back, entry.time, self.wait)
        return mine


class Raise(_ReceiversTurn, Carrying):
    """Lifts the object in the receiver's hand."""

    mode = HandoverMode.RAISE
    motion_of = Mode.LIFT


class ReleaseReceived(Release):
    """Opens the receiver's fingers, on the goal or after a failed take."""

    mode = Mode.RELEASE

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Open the fingers; record a failure if the receiver never had the object."""
        mine = memory_of(memory)
        giver = mine.other.attempt.planned.grasp if not mine.taken else None
        memory = super().enter(mine, entry)
        if giver is None:
            return memory
        lost = not other_holds(mine, entry.senses)
        mine.trouble.failure = Failure.DROPPED if lost else Failure.NOT_TAKEN
        mine.trouble.message = _MESSAGES[mine.trouble.failure]
        mine.cycle.tried = mine.cycle.tried[:-1]  # the giver's grasp did not fail
        return memory


_MESSAGES = {
    Failure.DROPPED: "the giver has lost the object that it presented",
    Failure.NOT_TAKEN: "the receiver's hand has closed, but the giver feels no pull",
}


class HomeReceived(Home):
    """Moves the receiver home, and checks whether the object is on its goal."""

    mode = Mode.HOME
    config: Handover

    def look(self, memory: PlannerMemory, now: Now) -> None:
        """Look only if the object has been taken: the giver may still hold it."""
        if memory_of(memory).taken:
            super().look(memory, now)

    def observe_arrived(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report the end of the task, or that the giver still presents the object."""
        mine = memory_of(memory)
        if mine.taken:
            return super().observe_arrived(mine, now)
        if not other_holds(mine, now.senses):
            return Observation(arrived=True, stuck=True)
        if mine.takes < self.config.max_takes:
            return Observation(arrived=True, moved=True)
        return Observation(arrived=True, failure=Failure.NOT_TAKEN)


GIVERS = (Begin, Carry, Present, LetGo, Withdraw, Clear)
RECEIVERS = (
    *(Approach, Reach, Take, Pull, Secure, Raise),
    *(Transfer, Place, ReleaseReceived, Retreat, HomeReceived),
)
