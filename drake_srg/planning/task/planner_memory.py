"""The memory of the pick-and-place planner."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.task.task_motions import Obstacles, TaskMotions
from drake_srg.types import Blob, Failure, Mode, PlannerStatus, Vector


@dc.dataclass(frozen=True)
class Attempt:
    """One try at picking and placing: its plan, and what was noticed on the way."""

    began: float = 0.0  # when the planner began to look for the object [s]
    next_look: float = 0.0  # when it looks next [s]
    ready_at: float = np.inf  # when the planned motions may begin [s]
    X_WO: RigidTransform | None = None  # where the object was seen [m]
    motions: TaskMotions | None = None
    escape: tuple[Trajectory, Trajectory] | None = None  # retreat and home
    trapped: bool = False  # not even an escape could be planned
    looked: bool = False  # the look that the mode ends with has been taken
    moved: bool = False  # the object is not where the motions take it
    lost: bool = False  # the object has left the hand
    at_goal: bool | None = None  # whether it was seen on its goal; None: not looked

    @property
    def planned(self) -> TaskMotions:
        """The motions, for modes that begin only with motions."""
        assert self.motions is not None, "this mode needs planned motions"
        return self.motions


@dc.dataclass(frozen=True)
class Grip:
    """The command of the fingers, and how they hold the object."""

    closure: float = 0.0  # commanded, 0 open .. 1 closed
    # Angles of the gripper's joints when they were last opened, by name [rad].
    fingers_open: Mapping[str, float] = dc.field(default_factory=dict)
    # Angles of the gripper's joints with an object, smoothed over time, (n,) [rad].
    angles: Vector = dc.field(default_factory=lambda: np.zeros(0))
    unheld_since: float = np.inf  # when the fingers began to sense nothing [s]


@dc.dataclass(frozen=True)
class Cycle:
    """Counts of one cycle, which lasts until the object has been placed."""

    started: float = 0.0  # s
    attempts: int = 0  # grasps begun
    detours: int = 0  # approaches broken off because something had moved
    tried: tuple[str, ...] = ()  # names of grasps that failed


@dc.dataclass(frozen=True)
class Totals:
    """Counts of the whole task."""

    attempts: int = 0  # grasps begun
    cycles: int = 0  # times the object has been placed
    looks: int = 0  # evaluations of `blobs`
    planning_wall: float = 0.0  # wall-clock time spent on planning [s]


@dc.dataclass(frozen=True)
class Seen:
    """Sightings that the planner remembers after an attempt."""

    localization: Blob | None = None  # the first one that led to a plan
    localized_at: float = 0.0  # s
    blobs: tuple[Blob, ...] = ()  # all in the latest look
    latest: Blob | None = None  # the latest one that was used
    latest_at: float = 0.0  # s
    X_WO_goal: RigidTransform | None = None  # where this cycle puts it [m]
    X_WO_return: RigidTransform | None = None  # where it stood at first, upright [m]
    obstacles: Obstacles = ()


@dc.dataclass(frozen=True)
class Trouble:
    """The latest failure."""

    failure: Failure | None = None
    message: str = ""
    touched: str = ""  # what the arm has touched, in words


@dc.dataclass(frozen=True)
class PlannerMemory:
    """The planner's memory. It is never changed, only replaced, so copies share it."""

    motion: Motion
    attempt: Attempt = dc.field(default_factory=Attempt)
    grip: Grip = dc.field(default_factory=Grip)
    cycle: Cycle = dc.field(default_factory=Cycle)
    totals: Totals = dc.field(default_factory=Totals)
    seen: Seen = dc.field(default_factory=Seen)
    trouble: Trouble = dc.field(default_factory=Trouble)

    def __deepcopy__(self, memo: dict[int, Any]) -> PlannerMemory:
        return self

    @property
    def closure(self) -> float:
        """The commanded closure, 0 open .. 1 closed."""
        return self.grip.closure

    def status(self, mode: Mode) -> PlannerStatus:
        """Return the planner's report on its task in a mode."""
        return PlannerStatus(
            mode=mode,
            failure=self.trouble.failure if mode is Mode.FAILED else None,
            attempts=self.totals.attempts,
            cycles=self.totals.cycles,
            looks=self.totals.looks,
            blobs=self.seen.blobs,
            localization=self.seen.localization,
            localized_at=self.seen.localized_at,
            sighting=self.seen.latest,
            sighted_at=self.seen.latest_at,
            message=self.trouble.message,
            planning_wall=self.totals.planning_wall,
        )
