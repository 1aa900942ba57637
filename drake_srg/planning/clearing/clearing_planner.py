"""The planner that clears a table, and its modes."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Sequence
from typing import ClassVar, TypeAlias

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.trajectories import Trajectory

from drake_srg.planning import state_machine
from drake_srg.planning.clearing.choosing import PickPlanner
from drake_srg.planning.clearing.destination import AROUND
from drake_srg.planning.clearing.knowledge import ClearingMemory, transition
from drake_srg.planning.clearing.maps import (
    completed,
    has_moved,
    is_still,
    without_hand,
)
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.planner_machine import (
    GIVES_UP,
    SEARCH_PERIOD,
    SLIP_CLOSING,
    HandSenses,
    Observation,
    PlannerMachine,
    PlannerMode,
)
from drake_srg.types import AnyMode, Failure, HeightMap, Mode

# Time after which the planner picks things that still move [s].
_PATIENCE = 3.0
_NO_MAP = HeightMap(np.zeros(2), 1.0, np.zeros((0, 0)))


@dc.dataclass(frozen=True)
class Senses(HandSenses[HeightMap]):
    """Measurements at one time; `see` returns the height map of the table."""

    # Looks at the destinations; returns None without a camera for them.
    see_destinations: Callable[[], HeightMap | None]


Now: TypeAlias = state_machine.Moment[Senses]
Entry: TypeAlias = state_machine.Entry[Senses, AnyMode, Observation]


class ClearingMode(PlannerMode[ClearingMemory, Senses]):
    """A mode that moves the arm, or waits; every mode checks the time budget.

    Attributes:
        yields: Whether the arm stops once it is off its path by `path_tolerance`.
            Otherwise, it would press things into each other, such as a plate into a box
            with 500 N.
        planner: Plans the picks.
        config: Times and limits.
    """

    yields: ClassVar[bool] = False

    def __init__(self, planner: PickPlanner) -> None:
        self.planner = planner
        self.config = planner.config

    def trajectory(self, memory: ClearingMemory) -> Trajectory | None:
        """Return the planned motion of the mode, None if the arm rests."""
        return memory.pick.motions.get(self.mode) if memory.pick else None

    def final_failure(self, memory: ClearingMemory, time: float) -> Failure | None:
        """Return the failure that ends the task in any mode, or None."""
        over = time > self.config.time_budget
        return memory.failure or (Failure.TIME_BUDGET if over else None)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report whether the arm has arrived, or something stops it."""
        motion, q = memory.motion, now.senses.q
        if motion.arrived(q, now.time):
            return Observation(arrived=True)
        late = now.time > motion.due + self.config.arrival_timeout
        allowed = self.config.path_tolerance
        if self.yields and allowed is not None:
            late |= motion.error(q, now.time) > allowed
        return Observation(stuck=late)

    @staticmethod
    def look_for_load(memory: ClearingMemory, seen: HeightMap | None) -> None:
        """Judge by a map of the destinations whether the last load has arrived.

        Args:
            memory: The planner's.
            seen: The map; None without a camera for it.
        """
        if seen is None:
            return
        pick, load = memory.pick, memory.loads.pending
        if pick is not None and load is not None:
            # The hand at the next grasp must not count as a load beside the bin.
            kept = load.destination.contains(seen)
            seen = without_hand(seen, pick.grasp.p_WC, kept)
        memory.view.looks += 1
        if memory.loads.look(seen) and pick is not None:
            # Forget earlier pushes: the table has changed.
            memory.attempts.pushed = ()


class Idle(ClearingMode):
    """Looks until nothing moves any more, and plans the next pick."""

    mode = Mode.IDLE

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Rest."""
        memory.motion = memory.motion.ended(entry.time)
        memory.view.rested_at = entry.time
        return memory

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Look periodically, beginning with the last look before `search_time`."""
        view, done = memory.view, memory.pick or memory.push or memory.finished
        if done or now.time < view.next_look:
            return memory
        view.next_look = now.time + SEARCH_PERIOD
        if view.next_look + self.config.period < self.config.search_time:
            return memory
        before, view.latest = view.latest, now.senses.see()
        view.looks += 1
        if before is None or now.time < self.config.search_time:
            return memory
        waited = now.time > view.rested_at + _PATIENCE
        if waited or is_still(before, view.latest):
            self.plan(memory, view.latest, now.time)
        return memory

    def plan(self, memory: ClearingMemory, seen: HeightMap, time: float) -> None:
        """Plan the next pick on a map of things at rest."""
        self.planner.plan(memory, seen, time)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report a pick or a push after the planning latency, or the end."""
        pick, push = memory.pick, memory.push
        return Observation(
            ready=pick is not None and now.time >= pick.ready_at,
            pushing=push is not None and now.time >= push.ready_at,
            finished=memory.finished,
            unseen=memory.loads.pending is not None,
        )


class Push(ClearingMode):
    """Pushes the top off a heap with the closed hand, and goes back over the bin."""

    mode = Mode.PUSH
    yields = True

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Close the hand, and begin the first motion."""
        assert memory.push is not None, "this mode needs a planned push"
        memory.closure = 1.0
        memory.attempts.pushed = (*memory.attempts.pushed, memory.push)
        return self._next_motion(memory, entry.time)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Begin the next motion when one is over."""
        over = memory.motion.arrived(now.senses.q, now.time)
        if over and memory.push is not None:
            self._next_motion(memory, now.time)
        return memory

    @staticmethod
    def _next_motion(memory: ClearingMemory, time: float) -> ClearingMemory:
        """Return the memory with the next motion of the push begun."""
        assert memory.push is not None
        motion, *rest = memory.push.motions
        memory.push = dc.replace(memory.push, motions=tuple(rest)) if rest else None
        memory.motion = memory.motion.followed_by(motion, time)
        return memory


class PreGrasp(ClearingMode):
    """Moves the open hand above the grasp, unless the thing there moves meanwhile.

    A thing that stands on an edge takes seconds to fall over. The planner looks
    halfway, where the hand does not hide the thing yet. If the thing has moved, the
    hand goes back, at most once per pick.

    Tips that were bent at the release are still bent if the hand could not open far: by
    Algorithm 1, they straighten only while it opens. In this case, the hand first opens
    fully.
    """

    mode = Mode.PRE_GRASP

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Open the fingers as far as the grasp needs, and go."""
        grasp = memory.planned.grasp
        straight = grasp.fingers.straight(entry.senses.fingers)
        memory.closure = grasp.closure_open if straight else 0.0
        return super().enter(memory, entry)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Look at the thing halfway."""
        pick, motion = memory.pick, memory.motion
        if pick is None:
            return memory
        if pick.grasp.fingers.straight(now.senses.fingers):
            memory.closure = pick.grasp.closure_open
        halfway = now.time >= 0.5 * (motion.departed + motion.due)
        if pick.confirmed or memory.attempts.doubtful or not halfway:
            return memory
        pick.confirmed = not has_moved(
            pick.height_map, now.senses.see(), pick.grasp.p_WC
        )
        memory.view.looks += 1
        if not pick.confirmed:
            memory.pick, memory.attempts.doubtful = None, True
            memory.motion = motion.stopped(now.time)
        return memory

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report the arrival with straight fingers, and whether there is still a pick.

        The wait for bent fingers lasts at most as long as they take to open.
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
        memory.closure = memory.planned.grasp.closure_open
        memory.attempts.picks += 1
        memory.attempts.doubtful = False
        return super().enter(memory, entry)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report the arrival. Fingers that something stops close where they are."""
        observed = super().observe_mode(memory, now)
        return Observation(arrived=observed.arrived or observed.stuck)


class Close(ClearingMode):
    """Closes the fingers, and looks for the previous load, now that the arm is away."""

    mode = Mode.CLOSE

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Close the fingers, and judge the previous load."""
        memory.closure = memory.planned.grasp.closure_closed
        self.look_for_load(memory, entry.senses.see_destinations())
        return super().enter(memory, entry)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report whether the fingers rest."""
        return Observation(still=now.senses.still)


class Lift(ClearingMode):
    """Lifts the load, straight up at first."""

    mode = Mode.LIFT

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Remember how far the fingers have closed, and go."""
        memory.planned.angles = entry.senses.fingers.copy()
        return super().enter(memory, entry)


class Transfer(ClearingMode):
    """Carries the load over the bin."""

    mode = Mode.TRANSFER

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Check by touch, on arrival, whether the hand still holds the load."""
        pick, senses = memory.planned, now.senses
        if not memory.motion.arrived(senses.q, now.time):
            return memory
        if pick.grasp.detectable:
            plausible = pick.grasp.holds(senses.fingers, senses.proximity)
        else:  # fingers that lose such a thin load close further
            closing = np.mean(senses.fingers - pick.angles)
            plausible = bool(closing < SLIP_CLOSING)
        pick.held = senses.grasped and plausible
        return memory

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
        """Let go, judge the pick by the map, and plan the next one.

        To drop a load, the hand opens fully: the load may have slipped up to where the
        fingers are closer to each other. To set a load down, it opens less, because
        there may be other things beside it. A stuck arm stops where it is. Its pick has
        failed, unless it was setting the load down.
        """
        pick, released = memory.planned, memory.released
        grasp, placing = pick.grasp, pick.placing
        memory.closure = grasp.closure_open if placing else 0.0
        released.at, released.hand = entry.time, grasp.fingers
        released.fingers = grasp.fingers_open if placing else {}
        stuck = entry.observation is not None and entry.observation.stuck
        ended = memory.motion.ended(entry.time)
        memory.motion = Motion(entry.senses.q.copy()) if stuck else ended
        if stuck and entry.previous is not Mode.PLACE:
            self.planner.give_up(memory)
            return memory
        memory.view.looks += 1
        seen = pick.without_load(entry.senses.see())
        self.planner.judge(memory, seen)
        if placing:  # the hand must first leave the load that it has placed
            way_out = None if stuck else self.planner.way_out(memory, pick)
            released.astray, released.way_out = True, way_out
            if way_out is None:
                return memory
        self.planner.plan(memory, seen, entry.time)
        return memory

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Open fully if the fingers rest without having let go.

        They would lift the load again. It may have turned between the base links. Or it
        may lie on tips that are still bent, because something, such as the wall of a
        bin, has pushed the fingers open.
        """
        # Fingers also rest for a moment after their tips have straightened.
        late = now.time >= memory.released.at + 0.5 * self.config.gripper_timeout
        if late and now.senses.still and not self._has_let_go(memory, now):
            memory.closure, memory.released.fingers = 0.0, {}
        return memory

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report whether the fingers have let go, and whether the arm must retreat."""
        # A load may touch partly open fingers again.
        open_ = memory.closure == 0.0 or now.senses.still
        clear = open_ and self._has_let_go(memory, now)
        return Observation(clear=clear, astray=memory.released.astray)

    @staticmethod
    def _has_let_go(memory: ClearingMemory, now: Now) -> bool:
        """Return whether the fingers are straight, and nothing is near them."""
        hand, senses = memory.released.hand, now.senses
        return senses.clear and (hand is None or hand.straight(senses.fingers))


class LastChance(ClearingMode):
    """A mode that gives up if something stops the arm."""

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report whether the arm has arrived; give up if something stops it."""
        observed = super().observe_mode(memory, now)
        failure = Failure.STOPPED if observed.stuck else None
        return Observation(arrived=observed.arrived, failure=failure)

    def begun(
        self,
        memory: ClearingMemory,
        entry: Entry,
        motion: Trajectory | PlanningFailure,
        wait: float = 0.0,
    ) -> ClearingMemory:
        """Return the memory with a motion begun, or with the failure of its plan."""
        if isinstance(motion, PlanningFailure):
            memory.failure, memory.message = motion.failure, motion.message
        else:
            memory.motion = memory.motion.followed_by(motion, entry.time, wait)
            memory.released.astray = False
        return memory


class Retreat(LastChance):
    """Moves the open hand up and over the bin after it got stuck or set a load down."""

    mode = Mode.RETREAT

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Follow the planned way out; without one, plan from where the arm is."""
        released = memory.released
        way_out, released.way_out = released.way_out, None
        if way_out is not None:
            return self.begun(memory, entry, way_out)
        q = entry.senses.q.copy()
        memory.motion, memory.push = Motion(q), None
        fingers = released.fingers if released.astray else {}
        motion = self.planner.plan_retreat(memory, q, fingers)
        return self.begun(memory, entry, motion)


class Verify(LastChance):
    """Moves the arm aside, and looks for the last load and for things that missed."""

    mode = Mode.VERIFY

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Plan the way aside, and go."""
        q, planner = memory.motion.destination, self.planner
        return self.begun(memory, entry, planner.motions.plan_way(q, planner.q_aside))

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Look once the arm is aside, and plan a pick if anything is left."""
        load = memory.loads.pending
        if load is None or not memory.motion.arrived(now.senses.q, now.time):
            return memory
        seen = now.senses.see()
        around = load.destination.contains(seen, AROUND)
        height = np.where(around, seen.height, np.nan)
        seen = completed(dc.replace(seen, height=height), memory.view.latest)
        self.look_for_load(memory, now.senses.see_destinations())
        self.planner.plan(memory, seen, now.time)
        return memory

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report the arrival once the planner has looked."""
        observed, looked = super().observe_mode(memory, now), not memory.loads.pending
        return dc.replace(observed, arrived=observed.arrived and looked)


class Home(LastChance):
    """Moves the arm home."""

    mode = Mode.HOME

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Plan the way home, and go. Wait there until the last load has settled."""
        motions = self.planner.motions
        motion = motions.plan_way(memory.motion.destination, motions.q_home)
        wait = memory.released.at + self.config.home_wait - entry.time
        if not isinstance(motion, PlanningFailure):
            wait -= motion.end_time()
        return self.begun(memory, entry, motion, max(wait, 0.0))


class End(ClearingMode):
    """Stays where it is: the task is over."""

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Stop, and remember why."""
        failure = entry.observation.failure if entry.observation else None
        memory.motion = memory.motion.ended(entry.time)
        memory.failure = failure
        if failure is not None:
            memory.message = memory.message or GIVES_UP.get(failure, "")
        return memory

    def observe(self, memory: ClearingMemory, now: Now) -> Observation:
        """Observe nothing."""
        return Observation()


class Done(End):
    """No grasp fits anything that is left, and the arm is home."""

    mode = Mode.DONE


class Failed(End):
    """The planner has given up, for the reason that its status names."""

    mode = Mode.FAILED


MODES: tuple[type[ClearingMode], ...] = (
    *(Idle, Push, PreGrasp, Grasp, Close, Lift, Transfer, Place, Release),
    *(Retreat, Verify, Home, Done, Failed),
)


class ClearingPlanner(PlannerMachine[ClearingMemory, Senses]):
    """Takes one thing after the other from a table and drops it into a bin.

    .. pydrake_system::

        name: ClearingPlanner
        input_ports:
        - height_map
        - destination_map (optional)
        - arm_state
        - gripper_state
        - grasped
        - proximity
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    Inputs: `height_map` and `destination_map` (HeightMap each), of the table and of the
    destinations, evaluated only when the planner looks; `arm_state` (2N) and
    `gripper_state` (2n), [q; v] in rad and rad/s; `grasped` (1), nonzero once both
    fingers sense something; `proximity` (m), signed distances [m].

    Outputs: `position_commanded` (N) [rad]; `closure_commanded` (1), 0 open .. 1
    closed; `mode` (Mode); `status` (PlannerStatus).

    The planner knows no shapes. It looks while the arm is over the bin and hides
    nothing. It takes the best grasp within reach, and carries the load over the bin. A
    pick counts as held if the fingers feel something there (touch, proximity and their
    angles), and if the thing at the grasp is gone from the table. The planner avoids
    grasps that failed. After `config.max_attempts` failures in one place, it leaves the
    thing there.

    A load counts as cleared once it is seen at its destination. The planner looks for
    it when the arm is at the next grasp or, after the last one, aside. A load that it
    does not see there is among `status.left`. Without `destination_map`, a load counts
    as soon as it was held.

    DONE means that the table is empty, or that `status.left` lists the remaining things
    with reasons.

    `planner` can be read from the system.

    Args:
        planner: Plans the picks.
        num_fingers: Number n of the gripper's measured joints.
        num_sensors: Number m of its proximity readings.
        modes: The modes.
        memory: Class of its memory.
    """

    def __init__(
        self,
        planner: PickPlanner,
        num_fingers: int,
        num_sensors: int,
        modes: Sequence[type[ClearingMode]] = MODES,
        memory: type[ClearingMemory] = ClearingMemory,
    ) -> None:
        super().__init__(
            {kind.mode: kind(planner) for kind in modes},
            memory=memory(Motion(q_rest=planner.motions.q_home)),
            transition=transition,
            config=planner.config,
        )
        self.planner = planner
        self._map, self._destinations = (
            self.DeclareAbstractInputPort(
                name=name, model_value=AbstractValue.Make(_NO_MAP)
            )
            for name in ("height_map", "destination_map")
        )
        self.declare_hand_inputs(num_fingers, num_sensors)

    def sense(self, context: Context) -> Senses:
        """Return the measurements; the cameras are read only when a mode looks."""
        return Senses(
            **vars(self.hand_senses(context, lambda: self._map.Eval(context))),
            see_destinations=lambda: (
                self._destinations.Eval(context)
                if self._destinations.HasValue(context)
                else None
            ),
        )
