"""The memory of the clearing planner."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping

import cv2
import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.comparing import (
    completed,
    fallen,
    has_come,
    parts,
    volume_gone,
    volume_taken,
)
from drake_srg.planning.clearing.destination import (
    AROUND,
    BESIDE,
    Destination,
    Spots,
)
from drake_srg.planning.clearing.loads import Drop, Received
from drake_srg.planning.clearing.pushing import Push
from drake_srg.planning.clearing.receiving import SeenLoad
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.top_grasp import TopGrasp
from drake_srg.planning.planner_machine import MotionMemory
from drake_srg.types import Failure, HeightMap, Left, Mode, PlannerStatus, Vector

# What falls out of the bin rolls this far at most [m].
_ROLLED = 0.3
# What is gone from so near to the grasp belongs to the load for the most part [m].
_CORE = 0.03
# Of what a hand over the bin holds, at least this share is near the bin. A long thing
# that was pushed there lies on both sides of the limit.
_LEAST_NEAR = 0.8
# Noise raises the cells at the edges of what has risen.
_EDGES = np.ones((5, 5), np.uint8)


@dc.dataclass(frozen=True)
class Pick:
    """A grasp, the motions of the modes around it, and the map they are planned on."""

    grasp: TopGrasp
    motions: Mapping[Mode, Trajectory]
    height_map: HeightMap
    destination: Destination  # of what it takes
    ready_at: float  # when planning has taken its time [s]
    confirmed: bool = False  # what it takes was seen again on the way there
    # Angles of the gripper's joints as the lift begins, shape (n,) [rad].
    angles: Vector = dc.field(default_factory=lambda: np.zeros(0))
    held: bool = False  # the fingers felt something until the arm was over the bin

    @property
    def placing(self) -> bool:
        """Whether a load is set down or laid, not dropped.

        A hand that has lost its load does not go down in a bin. Over a row it always
        does, because things must not be dropped there.
        """
        felt = self.held or self.destination.rim is None
        return felt and Mode.PLACE in self.motions

    def without_load(self, seen: HeightMap) -> HeightMap:
        """Return a map without the hand over a bin and its load.

        What reaches over the edge of the bin would look like a thing on the table, and
        so would the end of it that reaches further than what is left out. Something
        that really comes to lie there is seen in later looks, or now, if most of it
        does.
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

    def volume(self, after: HeightMap) -> float:
        """Return the volume of what it has taken, by the map of the table after it."""
        return volume_taken(self.height_map, after, self.grasp.p_WC)

    def drop(self, after: HeightMap, sure: bool, again: bool) -> Drop:
        """Return what it has let go, by the map of the table after it.

        Args:
            after: The map.
            sure: Whether the fingers felt it, and it is gone from the table.
            again: Whether it passes for a load that is missed.
        """
        volume = self.volume(after)
        core = volume_gone(self.height_map, after, self.grasp.p_WC, _CORE)
        load = SeenLoad(volume, self.grasp.height, sure, core)
        return Drop(self.destination, load, self.placing, again)

    def fell_out(self, memory: ClearingMemory, after: HeightMap) -> bool:
        """Return whether what it takes may have fallen out of the bin before.

        Most of it has come to lie beside the bin since the first pick. Further away, it
        must also be as large as a load that the bin has received, and that is there no
        more.

        Args:
            memory: The planner's.
            after: The map without it.
        """
        p_WC, earlier = self.grasp.p_WC[:2], memory.lowest_map
        volume = self.volume(after)
        known = any(
            load.is_like(volume) and load.has_left(memory.destinations)
            for load in memory.received
        )
        margin = _ROLLED if known else BESIDE
        if earlier is None or not self.destination.encloses(p_WC, margin):
            return False
        return has_come(earlier, self.height_map, after, p_WC)


@dc.dataclass(frozen=True)
class PlannedPush:
    """A push, and its motions, one after the other."""

    push: Push
    motions: tuple[Trajectory, ...]
    ready_at: float  # when planning has taken its time [s]


@dc.dataclass
class ClearingMemory(MotionMemory):
    """All that the planner remembers."""

    height_map: HeightMap | None = None  # the latest
    # The least heights of all maps since the first pick was planned.
    lowest_map: HeightMap | None = None
    next_look: float = 0.0  # s
    rested_at: float = 0.0  # when the arm came to rest to look [s]
    pick: Pick | None = None  # the one under way, or the next one
    tried: tuple[TopGrasp, ...] = ()  # grasps that failed
    stopped: tuple[TopGrasp, ...] = ()  # those of them on whose way the arm got stuck
    hand: Fingers | None = None  # the one that last let go
    # Angles of the gripper's joints since then, by name [rad].
    fingers: Mapping[str, float] = dc.field(default_factory=dict)
    doubtful: bool = False  # what the pick before was to take has moved meanwhile
    astray: bool = False  # the arm is still where it got stuck or has set a thing down
    # The way up from where the last load was laid down, from whose end the next pick
    # is planned.
    way_out: Trajectory | None = None
    push: PlannedPush | None = None  # what is left of the push under way, or the next
    pushed: tuple[Push, ...] = ()  # begun since anything was taken
    finished: bool = False  # nothing is left that a grasp takes
    picks: int = 0  # grasps begun
    taken: int = 0  # things that were felt in the hand and are gone from the table
    destinations: HeightMap | None = None  # the latest map of where loads go
    drop: Drop | None = None  # the load that was let go last, until it is looked for
    arrived: int = 0  # things that were taken and seen where they belong
    received: tuple[Received, ...] = ()  # the same things
    released_at: float = -np.inf  # when the hand let go last [s]
    lost: tuple[Left, ...] = ()  # where things were let go that were not
    multi_object_picks: int = 0  # after which several things were seen there
    labels: frozenset[int] = frozenset()  # of what was taken, on labelled maps
    looks: int = 0
    first_seen_at: float = np.inf  # when the first pick was planned [s]
    left: tuple[Left, ...] = ()
    failure: Failure | None = None
    message: str = ""

    @property
    def planned(self) -> Pick:
        """The pick, for modes that begin only with one."""
        assert self.pick is not None, "this mode needs a planned pick"
        return self.pick

    @property
    def departure(self) -> Vector:
        """Where the next pick begins, shape (N,) [rad]."""
        if self.way_out is None:
            return self.motion.destination
        q: Vector = self.way_out.value(self.way_out.end_time())[:, 0]
        return q

    def filled(self, destination: Destination) -> float:
        """Return the world z up to which a destination may be filled [m].

        The load that was let go last has not been looked for yet: it may lie on top.
        """
        if self.destinations is None:
            return -np.inf
        return destination.top(self.destinations) + self._unseen(destination)

    def spots(self, destination: Destination) -> Spots:
        """Return where loads are laid or set down in a bin; a row has no such places.

        A bin counts as empty until the first look.
        """
        if destination.rim is None:
            return Spots()
        laid = self.drop is not None and self.drop.laid
        unseen = self._unseen(destination) if laid else 0.0
        return destination.spots(self.destinations).raised(unseen)

    def _unseen(self, destination: Destination) -> float:
        """Return the height of a load that has not been looked for there yet [m]."""
        if self.drop is None or self.drop.destination is not destination:
            return 0.0
        return self.drop.load.height

    def status(self, mode: Mode) -> PlannerStatus:
        """Return the planner's report on its task in a mode."""
        return PlannerStatus(
            mode=mode,
            failure=self.failure if mode is Mode.FAILED else None,
            attempts=self.picks,
            cycles=self.arrived,
            multi_object_picks=self.multi_object_picks,
            looks=self.looks,
            localized_at=self.first_seen_at if self.picks else 0.0,
            message=self.message,
            left=self.left + self.lost,
        )
