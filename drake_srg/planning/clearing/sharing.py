"""Two arms that clear one table at the same time, and never meet.

A vertical plane halfway between the arms divides the table. Within `SHARED` of it lies
a strip that only one arm at a time may enter, the one that claimed it first. The other
one then stays `GAP` away from the strip. So there is always a plane between the arms
that neither crosses. Walls in the planners' scenes keep their motions there.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context
from pydrake.trajectories import Trajectory

from drake_srg.lifetime import LeafSystem
from drake_srg.planning.clearing.choosing import PickPlanner, Route
from drake_srg.planning.clearing.clearing_planner import (
    MODES,
    ClearingMode,
    ClearingPlanner,
    Entry,
    Idle,
    Now,
    Release,
    Senses,
    Verify,
)
from drake_srg.planning.clearing.destination import Spots
from drake_srg.planning.clearing.knowledge import ClearingMemory, Pick
from drake_srg.planning.clearing.maps import thing_at
from drake_srg.planning.clearing.motions import ClearingMotions
from drake_srg.planning.clearing.placing import BinMotions
from drake_srg.planning.grasps.top_grasps import GraspPlan, GraspPlanner, TopGrasp
from drake_srg.planning.motion.planning_scene import PlanningFailure, PlanningScene
from drake_srg.planning.planner_machine import Observation, PlannerConfig
from drake_srg.types import (
    AnyMode,
    Box,
    Failure,
    HeightMap,
    Mode,
    PlannerStatus,
    Remaining,
    Vector,
)

# Half the width of the strip [m]. Each hand, open along the closing direction, needs
# 0.12 m on the far side of a grasp, so that both arms can take things in the middle.
SHARED = 0.16
# Distance of the other arm from the strip [m]. It is more than arms lag behind their
# commands, 0.02 m each at a joint error of 0.02 rad.
GAP = 0.05
# A hand takes nothing nearer than this to a wall [m]: half the palm's width.
_ROOM = 0.04
_SIZE = 6.0  # of a wall [m]
_SAMPLES = 40  # of a motion with a load
_LOADED = (Mode.LIFT, Mode.TRANSFER, Mode.PLACE)


@dc.dataclass(frozen=True, eq=False)
class Frontier:
    """The vertical plane between two arms, from the side of one of them.

    Attributes:
        middle: A point of it, x and y in world, shape (2,) [m].
        inward: Direction from there to the arm, shape (2,).
    """

    middle: Vector
    inward: Vector

    @classmethod
    def between(cls, p_WA: Vector, p_WB: Vector) -> Frontier:
        """Return the plane halfway between two arms, from the side of the first.

        Args:
            p_WA: Base of the first arm, shape (2 or 3,) [m].
            p_WB: That of the second.
        """
        apart = p_WA[:2] - p_WB[:2]
        return cls(0.5 * (p_WA[:2] + p_WB[:2]), apart / np.linalg.norm(apart))

    def depth(self, p_W: Vector) -> Vector:
        """Return how far points (..., 2 or more) are on the arm's side, (...) [m]."""
        depth: Vector = (p_W[..., :2] - self.middle) @ self.inward
        return depth


@dc.dataclass(frozen=True, eq=False)
class Wall:
    """A wall that keeps an arm at a depth, parallel to a frontier."""

    frontier: Frontier
    depth: float  # of its face [m]; negative beyond the frontier

    @classmethod
    def of_side(cls, frontier: Frontier) -> Wall:
        """Return the wall of an arm that stays out of the strip."""
        return cls(frontier, SHARED + GAP)

    @classmethod
    def of_strip(cls, frontier: Frontier) -> Wall:
        """Return the wall of an arm that may enter the strip."""
        return cls(frontier, -SHARED)

    def AddTo(self, scene: PlanningScene) -> None:
        """Add the wall to an arm's scene, for good."""
        inward = self.frontier.inward
        x, y = self.frontier.middle + (self.depth - 0.5 * _SIZE) * inward
        R_WO = RotationMatrix.MakeZRotation(float(np.arctan2(inward[1], inward[0])))
        scene.AddFixture(Box([_SIZE, _SIZE, _SIZE]), RigidTransform(R_WO, [x, y, 0.0]))


class WalledMotions(BinMotions):
    """Plans picks on one side of a wall, where all of the load stays, too.

    Args:
        wall: The wall, which is in the scene.
        *args: As of `ClearingMotions`.
        **others: As of `ClearingMotions`.
    """

    def __init__(self, wall: Wall, *args: Any, **others: Any) -> None:
        super().__init__(*args, **others)
        self.wall = wall

    def reaches(self, grasp: TopGrasp) -> bool:
        """Return whether there is room for a hand between a grasp and the wall."""
        depth = self.wall.frontier.depth(grasp.p_WC)
        return bool(depth > self.wall.depth + _ROOM)

    def plan(
        self,
        q_start: Vector,
        grasp: TopGrasp,
        height_map: HeightMap,
        number: int = 0,
        *,
        filled: float = -np.inf,
        spots: Spots = Spots(),  # noqa: B008  # it is immutable
    ) -> dict[AnyMode, Trajectory] | PlanningFailure:
        """See `ClearingMotions`; in any direction, the load stays clear of the wall."""
        motions = super().plan(
            q_start, grasp, height_map, number, filled=filled, spots=spots
        )
        if isinstance(motions, PlanningFailure):
            return motions
        away = thing_at(height_map, self._table, grasp.p_WC) - grasp.p_WC[:2]
        length = float(np.max(np.linalg.norm(away, axis=1)))
        for mode in _LOADED:
            if mode not in motions:
                continue
            times = np.linspace(0.0, motions[mode].end_time(), _SAMPLES)
            for q in motions[mode].vector_values(times).T:
                p_WG = self.scene.X_WG(q).translation()
                if self.wall.frontier.depth(p_WG) < self.wall.depth + length:
                    message = "the load would reach over to the other arm"
                    return PlanningFailure(Failure.BLOCKED, message)
        return motions


@dc.dataclass(frozen=True, eq=False)
class SharedHeightMap(HeightMap):
    """A height map of an arm's own side and the strip.

    Where the other arm may be in the strip, the map shows nothing of it.
    """

    open: bool = True  # whether the map shows the strip


@dc.dataclass(frozen=True)
class SharingSenses(Senses):
    """Measurements at one time, and when the other arm claimed the strip."""

    others: float = np.inf  # [s]; inf: it does not


@dc.dataclass
class SharingMemory(ClearingMemory):
    """The planner's memory.

    Attributes:
        claim: When it claimed the strip [s]; inf: it does not. A claim ends once the
            arm is over its bin again.
    """

    claim: float = np.inf


def is_open(claim: float, others: float, *, first: bool) -> bool:
    """Return whether the other arm is not in the strip, and does not enter it.

    Args:
        claim: When this arm claimed it [s]; inf: it does not.
        others: When the other one did.
        first: Whether this arm's claim counts before a simultaneous one.
    """
    return others == np.inf or claim < others or (first and claim == others)


def may_enter(claim: float, others: float, time: float, *, first: bool) -> bool:
    """Return whether an arm may enter the strip.

    Its claim is then at least one update old. So it knows all earlier claims of the
    other arm, whose updates are at the same times.

    Args:
        claim: See `is_open`.
        others: See `is_open`.
        time: Now [s].
        first: See `is_open`.
    """
    return claim < time and is_open(claim, others, first=first)


class SharingPickPlanner(PickPlanner):
    """Plans picks on an arm's own side, and once none is left, in the strip.

    Nothing is pushed.

    Args:
        grasps: Finds grasps in a height map.
        motions: Motions on the own side.
        strip: Motions that may enter the strip.
        config: Attempts and latency.
        q_aside: See `PickPlanner`.
        first: See `is_open`.
    """

    def __init__(
        self,
        grasps: GraspPlanner,
        motions: WalledMotions,
        strip: WalledMotions,
        config: PlannerConfig,
        q_aside: Vector,
        *,
        first: bool,
    ) -> None:
        super().__init__(grasps, motions, config, q_aside=q_aside)
        self._own, self.strip, self.first = motions, strip, first

    def route(
        self, grasp: TopGrasp, height_map: HeightMap
    ) -> tuple[int, ClearingMotions] | None:
        """Return the motions on the own side, if a grasp may be in their reach."""
        return (-1, self._own) if self._own.reaches(grasp) else None

    def _next_pick(
        self,
        memory: ClearingMemory,
        found: GraspPlan,
        height_map: HeightMap,
        time: float,
        route: Route | None = None,
    ) -> tuple[Pick | None, list[Remaining]]:
        pick, missed = super()._next_pick(memory, found, height_map, time)
        assert isinstance(memory, SharingMemory)
        assert isinstance(height_map, SharedHeightMap)
        claim, memory.claim = min(memory.claim, time), np.inf
        if pick is not None:
            return pick, missed
        if height_map.open:
            pick, missed = super()._next_pick(
                memory, found, height_map, time, self._into_strip
            )
        if pick is not None:
            pick.shared = True
        if pick is not None or not height_map.open:
            memory.claim = claim
        return pick, missed

    def _into_strip(
        self, grasp: TopGrasp, height_map: HeightMap
    ) -> tuple[int, ClearingMotions] | None:
        return (-1, self.strip) if self.strip.reaches(grasp) else None

    def plan(self, memory: ClearingMemory, height_map: HeightMap, time: float) -> None:
        """See `PickPlanner`; finish only once the map shows the strip."""
        super().plan(memory, height_map, time)
        assert isinstance(height_map, SharedHeightMap)
        memory.finished &= height_map.open

    def plan_retreat(
        self, memory: ClearingMemory, q: Vector, fingers: Mapping[str, float]
    ) -> Trajectory | PlanningFailure:
        """See `PickPlanner`; an arm with a claim may be in the strip."""
        assert isinstance(memory, SharingMemory)
        motion = super().plan_retreat(memory, q, fingers)
        if isinstance(motion, PlanningFailure) and memory.claim < np.inf:
            return self.strip.plan_retreat(q, fingers)
        return motion


class SharingMode(ClearingMode):
    """A mode that knows of the strip."""

    planner: SharingPickPlanner

    def may_enter(self, memory: ClearingMemory, now: Now) -> bool:
        """Return whether the arm may enter the strip."""
        assert isinstance(memory, SharingMemory)
        assert isinstance(now.senses, SharingSenses)
        others, first = now.senses.others, self.planner.first
        return may_enter(memory.claim, others, now.time, first=first)


class SharingIdle(SharingMode, Idle):
    """Waits for its turn where the next pick is in the strip.

    If the other arm's turn comes first, the strip will look different. The pick is
    planned again then.
    """

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Rest; an arm that plans nothing in the strip has left it."""
        assert isinstance(memory, SharingMemory)
        if memory.pick is None:
            memory.claim = np.inf
        return super().enter(memory, entry)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Forget a pick in the strip if the other arm comes first, and look."""
        pick = memory.pick
        if pick is not None and pick.shared and not self.may_enter(memory, now):
            memory.pick = None
        return super().update(memory, now)

    def observe_mode(self, memory: ClearingMemory, now: Now) -> Observation:
        """Report a pick in the strip only if the arm may enter it."""
        observed, pick = super().observe_mode(memory, now), memory.pick
        if pick is not None and pick.shared and not self.may_enter(memory, now):
            return dc.replace(observed, ready=False)
        return observed


class SharingRelease(SharingMode, Release):
    """Ends the claim, because the arm is over its bin."""

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Let the other arm go first next time, unless something has stopped this one.

        The view is from before, so it shows the strip.
        """
        assert isinstance(memory, SharingMemory)
        stuck = entry.observation is not None and entry.observation.stuck
        if not stuck:
            memory.claim = np.inf
        return super().enter(memory, entry)


class SharingVerify(SharingMode, Verify):
    """Looks in the end once the other arm is not in the strip."""

    def enter(self, memory: ClearingMemory, entry: Entry) -> ClearingMemory:
        """Claim the strip, which the look must show, and go."""
        assert isinstance(memory, SharingMemory)
        memory.claim = min(memory.claim, entry.time)
        return super().enter(memory, entry)

    def update(self, memory: ClearingMemory, now: Now) -> ClearingMemory:
        """Look once it is this arm's turn."""
        return super().update(memory, now) if self.may_enter(memory, now) else memory


_SHARING = (SharingIdle, SharingRelease, SharingVerify)
_MODES = (*(m for m in MODES if not issubclass(m, (Idle, Release, Verify))), *_SHARING)


class SharingPlanner(ClearingPlanner):
    """Clears one side of a table, and the strip that two arms share.

    .. pydrake_system::

        name: SharingPlanner
        input_ports:
        - height_map
        - destination_map (optional)
        - arm_state
        - gripper_state
        - grasped
        - proximity
        - others_claim
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status
        - claim

    Connect `claim` (1) to `others_claim` (1) of the other arm's planner, and the
    reverse. It is the time at which the arm claimed the strip [s], inf if it does not.
    The earlier claim comes first. An arm that waits has a claim, and one in the strip
    ends its claim before it claims anew. So neither waits for more than one pick of the
    other.

    Args:
        planner: Plans the picks.
        num_fingers: Number n of the gripper's measured joints.
        num_sensors: Number m of its proximity readings.
    """

    planner: SharingPickPlanner

    def __init__(
        self, planner: SharingPickPlanner, num_fingers: int, num_sensors: int
    ) -> None:
        super().__init__(planner, num_fingers, num_sensors, _MODES, SharingMemory)
        self._others = self.DeclareVectorInputPort("others_claim", 1)
        self.DeclareVectorOutputPort(
            "claim", 1, self._calc_claim, prerequisites_of_calc={self.state_ticket}
        )

    def sense(self, context: Context) -> SharingSenses:
        """Return the measurements, with maps of what this arm may see."""
        senses = super().sense(context)
        others = float(self._others.Eval(context)[0])
        claim = self._memory(context).claim
        shown = is_open(claim, others, first=self.planner.first)
        own = {**vars(senses), "see": lambda: self._cropped(senses.see(), shown)}
        return SharingSenses(**own, others=others)

    def _memory(self, context: Context) -> SharingMemory:
        memory = self.state(context).memory
        assert isinstance(memory, SharingMemory)
        return memory

    def _cropped(self, seen: HeightMap, shown: bool) -> SharedHeightMap:
        """Return a map without the other arm's side, and without a strip it may hide.

        The camera is on this arm's side, so the other arm hides nothing there.
        """
        wall = self.planner.strip.wall
        depth = wall.frontier.depth(seen.centers())
        least = wall.depth if shown else SHARED + 0.5 * GAP
        height = np.where(depth > least, seen.height, np.nan)
        return SharedHeightMap(seen.origin, seen.resolution, height, shown)

    def _calc_claim(self, context: Context, output: BasicVector) -> None:
        output[0] = self._memory(context).claim


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
    """Reports what several planners do as if they were one.

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
