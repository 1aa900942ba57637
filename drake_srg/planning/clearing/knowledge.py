"""Knowledge and transitions of the planner that clears a table."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping

import cv2
import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.destination import AROUND, BESIDE, Destination
from drake_srg.planning.clearing.loads import Load, Loads
from drake_srg.planning.clearing.maps import (
    completed,
    fallen,
    has_come,
    parts,
    volume_gone,
    volume_taken,
)
from drake_srg.planning.clearing.pushing import Push
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.top_grasps import TopGrasp
from drake_srg.planning.planner_machine import (
    MotionMemory,
    Observation,
    PlannerConfig,
    Table,
    Transitions,
)
from drake_srg.planning.state_machine import Memory
from drake_srg.types import (
    AnyMode,
    Failure,
    HeightMap,
    Mode,
    PlannerStatus,
    Remaining,
    Vector,
)

# An object that falls out of the bin rolls this far at most [m].
_ROLLED = 0.3
# Most of the volume that disappears this near to the grasp belongs to the load [m].
_CORE = 0.03
# A rise may be the hand with its load if at least this share of it is near the bin. A
# long thing that was pushed there would lie on both sides of the limit.
_LEAST_NEAR = 0.8
# Noise also changes cells at the edges of a rise: they go with it.
_EDGES = np.ones((5, 5), np.uint8)


@dc.dataclass
class Pick(Memory):
    """A grasp, the motions around it, and the map for which they were planned."""

    grasp: TopGrasp
    motions: Mapping[AnyMode, Trajectory]
    height_map: HeightMap
    destination: Destination  # of the target
    ready_at: float  # when planning has taken its time [s]
    label: int = -1  # of the target, on labelled maps; -1: none
    confirmed: bool = False  # the target was seen again on the way there
    # Angles of the gripper's joints as the lift begins, shape (n,) [rad].
    angles: Vector = dc.field(default_factory=lambda: np.zeros(0))
    held: bool = False  # the fingers felt something until the arm was over the bin

    @property
    def placing(self) -> bool:
        """Whether a load is set down or laid, not dropped.

        A hand that has lost its load does not go down into a bin. Over a row, it always
        goes down, because nothing may be dropped there.
        """
        felt = self.held or self.destination.rim is None
        return felt and Mode.PLACE in self.motions

    def without_load(self, seen: HeightMap) -> HeightMap:
        """Return a map without the hand over a bin and its load.

        A load that reaches over the edge of the bin would look like a thing on the
        table, and so would an end of it beyond the region near the bin. So a rise is
        removed whole, unless over a fifth of it lies outside that region. A thing that
        really lies there appears in later looks.
        """
        if self.destination.rim is None:
            return seen
        near = self.destination.contains(seen, AROUND)
        risen = near & ~(seen.height <= self.height_map.height)
        for part in parts(fallen(self.height_map, seen) < 0.0, seen.resolution):
            if np.mean(near[part]) < _LEAST_NEAR:
                risen &= ~part
            else:
                risen |= cv2.dilate(part.astype(np.uint8), _EDGES) > 0
        height = np.where(risen, np.nan, seen.height)
        return completed(dc.replace(seen, height=height), self.height_map)

    def load(self, after: HeightMap, *, felt: bool) -> Load:
        """Return the load of this pick, by the map of the table after it.

        Args:
            after: The map.
            felt: Whether the fingers felt the load, and it is gone from the table.
        """
        return Load(
            destination=self.destination,
            volume=volume_taken(self.height_map, after, self.grasp.p_WC),
            height=self.grasp.height,
            core=volume_gone(self.height_map, after, self.grasp.p_WC, _CORE),
            felt=felt,
            laid=self.placing,
            label=self.label,
        )


@dc.dataclass
class View(Memory):
    """Views of the table so far.

    Attributes:
        latest: The latest map; None before the first look.
        lowest: The least heights of all maps since the first pick was planned.
        looks: Number of looks, including those at the destinations.
        next_look: Time of the next look while the arm rests [s].
        rested_at: Time at which the arm came to rest for a look [s].
    """

    latest: HeightMap | None = None
    lowest: HeightMap | None = None
    looks: int = 0
    next_look: float = 0.0
    rested_at: float = 0.0


@dc.dataclass
class Attempts(Memory):
    """Attempts so far.

    Attributes:
        picks: Number of grasps begun.
        tried: Grasps that failed.
        stopped: Those that failed because the arm got stuck.
        pushed: Pushes begun since the last load was taken.
        doubtful: Whether the last approach was abandoned because its target moved.
    """

    picks: int = 0
    tried: tuple[TopGrasp, ...] = ()
    stopped: tuple[TopGrasp, ...] = ()
    pushed: tuple[Push, ...] = ()
    doubtful: bool = False


@dc.dataclass
class Released(Memory):
    """The hand since its last release.

    Attributes:
        at: Time of the release [s].
        hand: Model of its fingers; None before the first release.
        fingers: Angles of the gripper's joints since then, by name [rad].
        astray: Whether the arm is still where it got stuck or set a thing down.
        way_out: The way up after the last load was laid down. The next pick is planned
            from its end.
    """

    at: float = -np.inf
    hand: Fingers | None = None
    fingers: Mapping[str, float] = dc.field(default_factory=dict)
    astray: bool = False
    way_out: Trajectory | None = None


@dc.dataclass
class ClearingMemory(MotionMemory):
    """The planner's memory.

    Attributes:
        view: Knowledge of the table from the cameras.
        pick: The pick under way, or the next one.
        push: Rest of the push under way, or the next one.
        finished: Whether no grasp fits anything that is left.
        left: Things that remain, and why.
        attempts: The attempts so far.
        released: The hand since its last release.
        loads: Loads that the hand has released, and where they are.
        first_seen_at: Time at which the first pick was planned [s].
        failure: Why the planner gives up.
        message: The same in words.
    """

    view: View = dc.field(default_factory=View)
    pick: Pick | None = None
    push: Push | None = None
    finished: bool = False
    left: tuple[Remaining, ...] = ()
    attempts: Attempts = dc.field(default_factory=Attempts)
    released: Released = dc.field(default_factory=Released)
    loads: Loads = dc.field(default_factory=Loads)
    first_seen_at: float = np.inf
    failure: Failure | None = None
    message: str = ""

    @property
    def planned(self) -> Pick:
        """The planned pick, for modes that need one."""
        assert self.pick is not None, "this mode needs a planned pick"
        return self.pick

    @property
    def departure(self) -> Vector:
        """Joint positions at which the next pick begins, shape (N,) [rad]."""
        way_out = self.released.way_out
        if way_out is None:
            return self.motion.destination
        q: Vector = way_out.value(way_out.end_time())[:, 0]
        return q

    def fell_out(self, pick: Pick, volume: float, after: HeightMap) -> bool:
        """Return whether a pick's thing may have fallen out of the bin earlier.

        Most of it must have appeared beside the bin since the first pick. Farther away,
        it must also be as large as a load that has disappeared from the bin.

        Args:
            pick: The pick.
            volume: Volume of the thing [m³].
            after: The map without the thing.
        """
        p_WC, earlier = pick.grasp.p_WC[:2], self.view.lowest
        margin = _ROLLED if self.loads.has_lost(volume) else BESIDE
        if earlier is None or not pick.destination.encloses(p_WC, margin):
            return False
        return has_come(earlier, pick.height_map, after, p_WC)

    def status(self, mode: AnyMode) -> PlannerStatus:
        """Return the planner's report on its task in a mode."""
        return PlannerStatus(
            mode=mode,
            failure=self.failure if mode is Mode.FAILED else None,
            attempts=self.attempts.picks,
            cycles=self.loads.arrived,
            multi_object_picks=self.loads.several,
            looks=self.view.looks,
            localized_at=self.first_seen_at if self.attempts.picks else 0.0,
            message=self.message,
            left=self.left + self.loads.lost,
        )


def _closed(o: Observation, t: float, c: PlannerConfig) -> bool:
    waited = t >= max(c.gripper_reaction, c.grip_wait)
    return waited and (o.still or t >= c.gripper_timeout)


def _released(o: Observation, t: float, c: PlannerConfig) -> bool:
    waited = t >= max(c.gripper_reaction, c.release_wait)
    return waited and (o.clear or t >= c.gripper_timeout)


TRANSITIONS: Table = {
    Mode.IDLE: [
        (lambda o, t, c: o.ready, Mode.PRE_GRASP),
        (lambda o, t, c: o.pushing, Mode.PUSH),
        (lambda o, t, c: o.finished and o.unseen, Mode.VERIFY),
        (lambda o, t, c: o.finished, Mode.HOME),
    ],
    Mode.VERIFY: [(lambda o, t, c: o.arrived, Mode.IDLE)],
    Mode.PUSH: [
        (lambda o, t, c: o.arrived, Mode.IDLE),
        (lambda o, t, c: o.stuck, Mode.RETREAT),
    ],
    Mode.PRE_GRASP: [
        (lambda o, t, c: o.moved and (o.arrived or o.stuck), Mode.RETREAT),
        (lambda o, t, c: o.arrived, Mode.GRASP),
        (lambda o, t, c: o.stuck, Mode.RELEASE),
    ],
    Mode.GRASP: [(lambda o, t, c: o.arrived, Mode.CLOSE)],
    Mode.CLOSE: [(_closed, Mode.LIFT)],
    Mode.LIFT: [
        (lambda o, t, c: o.arrived, Mode.TRANSFER),
        (lambda o, t, c: o.stuck, Mode.RELEASE),
    ],
    Mode.TRANSFER: [
        (lambda o, t, c: o.arrived and o.placing, Mode.PLACE),
        (lambda o, t, c: o.arrived or o.stuck, Mode.RELEASE),
    ],
    Mode.PLACE: [(lambda o, t, c: o.arrived or o.stuck, Mode.RELEASE)],
    Mode.RELEASE: [
        (lambda o, t, c: o.astray and _released(o, t, c), Mode.RETREAT),
        (_released, Mode.IDLE),
    ],
    Mode.RETREAT: [(lambda o, t, c: o.arrived, Mode.IDLE)],
    Mode.HOME: [(lambda o, t, c: o.arrived, Mode.DONE)],
    Mode.DONE: [],
    Mode.FAILED: [],
}  # fmt: skip

transition = Transitions(TRANSITIONS)
