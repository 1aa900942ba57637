"""Two arms that clear one table at the same time without meeting.

A vertical plane halfway between the arms divides the table. An arm at a depth stays at
least that far behind the plane, on its own side. With a negative depth, it may go that
far beyond the plane. The depths of both arms always add up to `GAP` or more, which
keeps the arms apart. At the depth `SIDE`, an arm never conflicts with the other one. To
go farther, it claims a lesser depth. If two claims exclude each other, the earlier one
comes first. Walls in the planners' scenes keep each motion at its depth.
"""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context
from pydrake.trajectories import Trajectory

from drake_srg.lifetime import LeafSystem
from drake_srg.planning.clearing.choosing import PickPlanner
from drake_srg.planning.clearing.clearing_planner import (
    MODES,
    ClearingMode,
    ClearingPlanner,
    Entry,
    Failed,
    Idle,
    Now,
    Release,
    Senses,
    Verify,
)
from drake_srg.planning.clearing.knowledge import ClearingMemory, Pick
from drake_srg.planning.clearing.motions import ClearingMotions
from drake_srg.planning.clearing.walls import (
    BEYOND,
    GAP,
    LOADED,
    SIDE,
    SharedHeightMap,
    WalledMotions,
)
from drake_srg.planning.grasps.top_grasps import GraspPlan, GraspPlanner, TopGrasp
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.planner_machine import Observation, PlannerConfig
from drake_srg.types import (
    AnyMode,
    HeightMap,
    Mode,
    PlannerStatus,
    Remaining,
    Vector,
)

_ROUNDING = 1e-6  # in sums of depths [m]
# Most grasps have enough room at this distance from a wall [m].
_HAND = 0.12


@dc.dataclass(frozen=True)
class Claim:
    """A claim of an arm to a depth."""

    since: float = np.inf  # when it was made [s]; inf: no claim; -inf: for good
    depth: float = SIDE  # [m]

    @property
    def for_good(self) -> bool:
        """Whether it never ends, because the arm has failed there."""
        return self.since == -np.inf

    def comes_first(self, other: Claim, *, first: bool) -> bool:
        """Return whether this claim need not wait for that of the other arm.

        Args:
            other: The other claim.
            first: Whether this claim precedes a simultaneous one.
        """
        if self.depth + other.depth > GAP - _ROUNDING:
            return True
        return self.since < other.since or (first and self.since == other.since)

    def granted(self, other: Claim, time: float, *, first: bool) -> bool:
        """Return whether the arm may go to the claimed depth.

        The claim must be at least one update old. Both arms are updated at the same
        times, so the arm then knows all earlier claims of the other one.

        Args:
            other: See `comes_first`.
            time: Now [s].
            first: See `comes_first`.
        """
        return self.since < time and self.comes_first(other, first=first)

    def changed(self, depth: float, time: float) -> Claim:
        """Return a claim to another depth; only a lesser depth costs its priority.

        Args:
            depth: The depth [m].
            time: Now [s].
        """
        return Claim(min(self.since, time) if depth >= self.depth else time, depth)


NO_CLAIM = Claim()


@dc.dataclass(frozen=True)
class SharingSenses(Senses):
    """Measurements at one time, and the other arm's claim."""

    other: Claim = NO_CLAIM


@dc.dataclass
class SharingMemory(ClearingMemory):
    """The planner's memory.

    Attributes:
        claim: Its claim, which ends once the arm is over its bin again.
        searched: The last map, if a plan on it found no pick and the arm rests.
    """

    claim: Claim = NO_CLAIM
    searched: SharedHeightMap | None = None


class SharingPickPlanner(PickPlanner):
    """Plans picks at each depth.

    Picks at the depth `SIDE` are possible at any time. The planner saves them for when
    the other arm crosses the plane, unless that arm is waiting to do so. It never
    pushes.

    Args:
        grasps: Finds grasps in a height map.
        motions: Motions at the depths `SIDE`, `HALF` and `BEYOND`.
        config: Attempts and latency.
        q_aside: See `PickPlanner`.
        first: See `Claim`.
    """

    def __init__(
        self,
        grasps: GraspPlanner,
        motions: Sequence[WalledMotions],
        config: PlannerConfig,
        q_aside: Vector,
        *,
        first: bool,
    ) -> None:
        super().__init__(grasps, motions[0], config, q_aside=q_aside)
        self.by_depth = tuple(motions)
        self.first = first

    def depth_of(self, q: Vector) -> float:
        """Return the depth of an arm with an open, empty hand: one of the three [m]."""
        depths = [m.wall.depth for m in self.by_depth if m.contains(q)]
        return max(depths, default=BEYOND)

    def _next_pick(
        self,
        memory: ClearingMemory,
        found: GraspPlan,
        height_map: HeightMap,
        time: float,
    ) -> tuple[Pick | None, list[Remaining]]:
        assert isinstance(memory, SharingMemory)
        assert isinstance(height_map, SharedHeightMap)
        before, memory.claim = memory.claim, NO_CLAIM
        side, half, beyond = self.by_depth
        ways: list[tuple[WalledMotions, WalledMotions | None]]
        ways = [(side, None), (half, None), (beyond, None)]
        if not height_map.wanted:
            ways = [(half, side), (beyond, half), *ways]
        tried: set[tuple[TopGrasp, WalledMotions]] = set()
        missed: list[tuple[float, Remaining]] = []
        for motions, easier in ways:
            depth = motions.wall.depth
            if depth < height_map.least - _ROUNDING:
                continue
            way = functools.partial(_way, motions, easier, tried)
            pick, more = self._first_pick(way, memory, found, height_map, time)
            missed += [(depth, thing) for thing in more]
            if pick is not None:
                if depth < SIDE:
                    memory.claim = before.changed(depth, time)
                return pick, more
        if not height_map.open:
            memory.claim = before.changed(BEYOND, time)
        missed.sort(key=lambda pair: pair[0])  # least depth first: its reasons count
        return None, [thing for _, thing in missed]

    def plan(self, memory: ClearingMemory, height_map: HeightMap, time: float) -> None:
        """Plan the next pick; finish only once the map shows everything."""
        super().plan(memory, height_map, time)
        assert isinstance(height_map, SharedHeightMap)
        memory.finished &= height_map.open

    def plan_retreat(
        self, memory: ClearingMemory, q: Vector, fingers: Mapping[str, float]
    ) -> Trajectory | PlanningFailure:
        """Plan the way back over the bin, at the greatest depth that works."""
        assert isinstance(memory, SharingMemory)
        # No lesser depth than the claim. With a pick planned, the claim is for that
        # pick, and the arm is over its bin.
        least = memory.claim.depth if memory.pick is None else SIDE
        for motions in self.by_depth:
            motion = motions.plan_retreat(q, fingers)
            if not isinstance(motion, PlanningFailure) or motions.wall.depth <= least:
                break
        return motion


def _way(
    motions: WalledMotions,
    easier: WalledMotions | None,
    tried: set[tuple[TopGrasp, WalledMotions]],
    grasp: TopGrasp,
    height_map: HeightMap,
) -> tuple[int, ClearingMotions] | None:
    """Route a grasp by some motions, if it is new and has room beside their wall.

    Args:
        motions: The motions.
        easier: Motions at a greater depth. Grasps that these reach are saved for later;
            None: no grasps are saved.
        tried: Grasps and motions so far; a new pair is added.
        grasp: The grasp.
        height_map: The map.
    """
    kept = easier is not None and easier.reaches(grasp, _HAND)
    if kept or (grasp, motions) in tried or not motions.reaches(grasp):
        return None
    tried.add((grasp, motions))
    return -1, motions


class SharingMode(ClearingMode):
    """A mode that knows the claims."""

    planner: SharingPickPlanner

    def may_enter(self, memory: ClearingMemory, now: Now) -> bool:
        """Return whether the arm may go to the depth of its claim, or needs none."""
        assert isinstance(memory, SharingMemory)
        assert isinstance(now.senses, SharingSenses)
        claim, other = memory.claim, now.senses.other
        granted = claim.granted(other, now.time, first=self.planner.first)
        return claim.depth >= SIDE or granted


class SharingIdle(SharingMode, Idle):
    """Waits for its turn, if the next pick needs a claim.

    If the other arm comes first, the table will look different, and the pick is planned
    anew.
    """

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Rest; without a pick, end the claim: the arm is over its bin."""
        assert isinstance(memory, SharingMemory)
        memory.searched = None
        if memory.pick is None:
            memory.claim = NO_CLAIM
        return super().enter(memory, entry)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Forget a pick if the other arm comes first, and look."""
        if not self.may_enter(memory, now):
            memory.pick = None
        return super().update(memory, now)

    def plan(self, memory: ClearingMemory, seen: HeightMap, time: float) -> None:
        """Plan, unless the last plan found nothing and the map is still the same."""
        assert isinstance(memory, SharingMemory)
        assert isinstance(seen, SharedHeightMap)
        if memory.searched is not None and seen.is_like(memory.searched):
            return
        super().plan(memory, seen, time)
        memory.searched = seen if memory.pick is None else None

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report a pick only if the arm may go there."""
        observed = super().observe_mode(memory, now)
        return dc.replace(
            observed, ready=observed.ready and self.may_enter(memory, now)
        )


class SharingRelease(SharingMode, Release):
    """Ends the claim, because the arm is over its bin."""

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Let the other arm go first next time, unless something has stopped this one.

        This look still uses the ended claim, so it shows where the load was.
        """
        assert isinstance(memory, SharingMemory)
        stuck = entry.observation is not None and entry.observation.stuck
        if not stuck:
            memory.claim = NO_CLAIM
        return super().enter(memory, entry)


class SharingVerify(SharingMode, Verify):
    """Takes the last look once the other arm is on its own side."""

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Claim the area that the look must show, and go."""
        assert isinstance(memory, SharingMemory)
        memory.claim = Claim(entry.time, BEYOND)
        return super().enter(memory, entry)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Look once it is this arm's turn, or at once if that never comes."""
        assert isinstance(now.senses, SharingSenses)
        may_look = self.may_enter(memory, now) or now.senses.other.for_good
        return super().update(memory, now) if may_look else memory


class SharingFailed(SharingMode, Failed):
    """Claims the arm's depth for good, unless the arm is on its own side.

    The other arm then keeps clear of it, but no longer waits for its turn.
    """

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Stop, and claim."""
        assert isinstance(memory, SharingMemory)
        depth = memory.claim.depth
        if entry.previous not in LOADED:
            depth = max(depth, self.planner.depth_of(entry.senses.q))
        memory.claim = Claim(-np.inf, depth) if depth < SIDE else NO_CLAIM
        return super().enter(memory, entry)


_SHARING: tuple[type[ClearingMode], ...] = (
    SharingIdle,
    SharingRelease,
    SharingVerify,
    SharingFailed,
)
_MODES: dict[AnyMode, type[ClearingMode]] = {
    kind.mode: kind for kind in (*MODES, *_SHARING)
}


class SharingPlanner(ClearingPlanner):
    """Clears one side of a table, and what lies in the middle between two arms.

    .. pydrake_system::

        name: SharingPlanner
        input_ports:
        - height_map
        - destination_map (optional)
        - arm_state
        - gripper_state
        - grasped
        - proximity
        - other_claim
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status
        - claim

    Connect `claim` (2) to `other_claim` (2) of the other arm's planner, and vice versa.
    It has the time at which the claim was made [s], inf without a claim, and the depth
    [m]. The earlier claim comes first. Each arm ends its claim after one pick, so the
    other one waits no longer than that. An arm that fails beyond its own side claims
    its depth for good, since -inf. The other arm then clears the rest.

    Args:
        planner: Plans the picks.
        num_fingers: Number n of the gripper's measured joints.
        num_sensors: Number m of its proximity readings.
    """

    planner: SharingPickPlanner

    def __init__(
        self, planner: SharingPickPlanner, num_fingers: int, num_sensors: int
    ) -> None:
        super().__init__(
            planner, num_fingers, num_sensors, tuple(_MODES.values()), SharingMemory
        )
        self._other = self.DeclareVectorInputPort("other_claim", 2)
        self.DeclareVectorOutputPort(
            "claim", 2, self._calc_claim, prerequisites_of_calc={self.state_ticket}
        )

    def sense(self, context: Context) -> SharingSenses:
        """Return the measurements, with maps of what this arm may see."""
        senses = super().sense(context)
        since, depth = self._other.Eval(context)
        other = Claim(float(since), float(depth))

        def see() -> SharedHeightMap:
            return self._cropped(senses.see(), self._claim(context), other)

        return SharingSenses(**{**vars(senses), "see": see}, other=other)

    def _claim(self, context: Context) -> Claim:
        memory = self.state(context).memory
        assert isinstance(memory, SharingMemory)
        return memory.claim

    def _cropped(self, seen: HeightMap, claim: Claim, other: Claim) -> SharedHeightMap:
        """Return a map without the area in which the other arm may be.

        The camera is on this arm's side, so the other arm hides nothing there.
        """
        waits = not other.comes_first(claim, first=not self.planner.first)
        beyond = SIDE if waits else other.depth
        side, *_ = self.planner.by_depth
        whole = SharedHeightMap(
            seen.origin,
            seen.resolution,
            seen.height,
            least=max(BEYOND, GAP - beyond),
            wanted=waits,
            for_good=other.for_good,
        )
        shown = side.wall.frontier.depth(seen.centers()) > whole.edge
        return dc.replace(whole, height=np.where(shown, seen.height, np.nan))

    def _calc_claim(self, context: Context, output: BasicVector) -> None:
        claim = self._claim(context)
        output.SetFromVector([claim.since, claim.depth])


def joint_status(statuses: Mapping[str, PlannerStatus]) -> PlannerStatus:
    """Return the report of several arms on their common task.

    Its mode is that of the first arm that still works. In the end, it is FAILED if any
    arm has failed.

    Args:
        statuses: Their own reports, by the arms' names.
    """
    reports = list(statuses.values())
    begun = [report.localized_at for report in reports if report.attempts]
    joint = PlannerStatus(
        mode=Mode.DONE,
        attempts=sum(report.attempts for report in reports),
        cycles=sum(report.cycles for report in reports),
        multi_object_picks=sum(report.multi_object_picks for report in reports),
        looks=sum(report.looks for report in reports),
        localized_at=min(begun, default=0.0),
        left=tuple(thing for report in reports for thing in report.left),
    )
    for report in reports:
        if not report.ended:
            return dc.replace(joint, mode=report.mode)
    for name, report in statuses.items():
        if not report.done:
            words = f"{name}: {report.message}"
            joint = dc.replace(
                joint, mode=report.mode, failure=report.failure, message=words
            )
            break
    return joint


class JointStatus(LeafSystem):
    """Reports on several planners as if they were one.

    .. pydrake_system::

        name: JointStatus
        input_ports:
        - ARM.status
        output_ports:
        - mode
        - status

    There is an input for every arm. See `joint_status`.

    Args:
        arms: Names of the arms.
    """

    def __init__(self, arms: Sequence[str]) -> None:
        super().__init__()
        model = AbstractValue.Make(PlannerStatus())
        self._inputs = {
            name: self.DeclareAbstractInputPort(f"{name}.status", model)
            for name in arms
        }
        self.DeclareAbstractOutputPort(
            "mode",
            lambda: Value[object](Mode.IDLE),
            self._calc_mode,
            {self.all_input_ports_ticket()},
        )
        self.DeclareAbstractOutputPort(
            "status",
            lambda: AbstractValue.Make(PlannerStatus()),
            self._calc_status,
            {self.all_input_ports_ticket()},
        )

    def _status(self, context: Context) -> PlannerStatus:
        ports = self._inputs.items()
        return joint_status({name: port.Eval(context) for name, port in ports})

    def _calc_mode(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._status(context).mode)

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._status(context))
