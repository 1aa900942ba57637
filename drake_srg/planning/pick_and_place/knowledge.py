"""Knowledge and transitions of the pick-and-place planner.

`modes.py` has the actions of each mode.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.sightings import View
from drake_srg.planning.pick_and_place.task_motions import Obstacles, TaskMotions
from drake_srg.planning.planner_machine import (
    SLIP_CLOSING,
    Condition,
    HandSenses,
    MotionMemory,
    PlannerConfig,
    Table,
    Transitions,
)
from drake_srg.planning.state_machine import Memory
from drake_srg.types import AnyMode, Blob, Failure, Mode, PlannerStatus, Vector


@dc.dataclass
class Attempt(Memory):
    """One attempt at picking and placing: its plan, and its observations."""

    began: float = 0.0  # when the planner began to look for the object [s]
    next_look: float = 0.0  # time of the next look [s]
    ready_at: float = np.inf  # when the planned motions may begin [s]
    X_WO: RigidTransform | None = None  # where the object was seen [m]
    motions: TaskMotions | None = None
    escape: tuple[Trajectory, Trajectory] | None = None  # retreat and home
    trapped: bool = False  # not even an escape could be planned
    looked: bool = False  # the mode has taken its last look
    moved: bool = False  # the object has left the place of the planned grasp
    lost: bool = False  # the object has left the hand
    at_goal: bool | None = None  # whether it was seen on its goal; None: not looked

    @property
    def planned(self) -> TaskMotions:
        """The planned motions, for modes that need them.

        Raises:
            RuntimeError: If there is no plan.
        """
        if self.motions is None:
            raise RuntimeError(
                "this mode needs planned motions: let the transitions lead here only "
                "after IDLE has observed `ready`"
            )
        return self.motions


@dc.dataclass
class Grip(Memory):
    """The fingers' hold on the object."""

    # Angles of the gripper's joints when they were last opened, by name [rad].
    fingers_open: Mapping[str, float] = dc.field(default_factory=dict)
    # Angles of the gripper's joints with an object, smoothed over time, (n,) [rad].
    angles: Vector = dc.field(default_factory=lambda: np.zeros(0))
    unheld_since: float = np.inf  # when the fingers began to sense nothing [s]


@dc.dataclass
class Cycle(Memory):
    """Counts of one cycle, which lasts until the object has been placed."""

    started: float = 0.0  # s
    attempts: int = 0  # grasps begun
    detours: int = 0  # approaches abandoned because something had moved
    tried: tuple[str, ...] = ()  # names of grasps that failed


@dc.dataclass
class Totals(Memory):
    """Counts of the whole task."""

    attempts: int = 0  # grasps begun
    cycles: int = 0  # times the object has been placed
    looks: int = 0  # evaluations of `blobs`


@dc.dataclass
class Seen(Memory):
    """Sightings that outlast an attempt."""

    localization: Blob | None = None  # the first one that led to a plan
    localized_at: float = 0.0  # s
    blobs: tuple[Blob, ...] = ()  # all blobs of the latest look
    latest: Blob | None = None  # the latest one that was used
    latest_at: float = 0.0  # s
    X_WO_goal: RigidTransform | None = None  # where this cycle puts it [m]
    X_WO_return: RigidTransform | None = None  # where it stood at first, upright [m]
    obstacles: Obstacles = ()


@dc.dataclass
class Trouble(Memory):
    """The latest failure."""

    failure: Failure | None = None
    message: str = ""
    touched: str = ""  # what the arm has touched, in words


@dc.dataclass
class PlannerMemory(MotionMemory):
    """The planner's memory."""

    attempt: Attempt = dc.field(default_factory=Attempt)
    grip: Grip = dc.field(default_factory=Grip)
    cycle: Cycle = dc.field(default_factory=Cycle)
    totals: Totals = dc.field(default_factory=Totals)
    seen: Seen = dc.field(default_factory=Seen)
    trouble: Trouble = dc.field(default_factory=Trouble)

    def status(self, mode: AnyMode) -> PlannerStatus:
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
        )


@dc.dataclass(frozen=True)
class Senses(HandSenses[View]):
    """Measurements at one time."""

    external_torque: Vector | None = None  # at the arm's joints, shape (N,) [N m]


def holding(memory: PlannerMemory, senses: Senses) -> bool:
    """Return whether both fingers sense something other than each other."""
    attempt = memory.attempt
    if attempt.motions is None or attempt.lost or not senses.grasped:
        return False
    return attempt.motions.grasp.holds(senses.fingers, senses.proximity)


def watch_grasp(
    memory: PlannerMemory, senses: Senses, time: float, config: PlannerConfig
) -> None:
    """Stop the motion of an arm whose hand loses the object.

    The object is lost if the fingers sense nothing for `config.slip_time`, or if they
    close by `SLIP_CLOSING` in about that time.
    """
    if memory.attempt.lost:
        return
    grip = memory.grip
    if grip.angles.shape != senses.fingers.shape:
        raise RuntimeError(
            "a mode that carries an object needs `memory.grip.angles`: call "
            "`super().enter(memory, entry)` in its `enter`"
        )
    since = np.inf if holding(memory, senses) else min(grip.unheld_since, time)
    closing = senses.fingers - grip.angles
    if time - since >= config.slip_time or np.mean(closing) > SLIP_CLOSING:
        memory.motion = memory.motion.stopped(time)
        memory.attempt.lost = True
        return
    grip.angles = grip.angles + min(config.period / config.slip_time, 1.0) * closing
    grip.unheld_since = since


def watch_touch(memory: PlannerMemory, senses: Senses, config: PlannerConfig) -> None:
    """Stop a moving arm in place when it touches something."""
    limits, torque = config.max_external_torque, senses.external_torque
    if limits is None or torque is None or memory.motion.trajectory is None:
        return
    excess = np.abs(torque) - limits
    joint = int(np.argmax(excess))
    if excess[joint] <= 0.0:
        return
    memory.trouble.touched = (
        f"the arm touches something: joint {joint + 1} feels "
        f"{abs(torque[joint]):.2g} N m from outside (allowed: {limits[joint]:.2g} N m)"
    )
    # Stop here: stopping along the path, the lagging arm could push on into the thing.
    memory.motion = Motion(senses.q.copy())


def carried(
    following: AnyMode, lost: AnyMode = Mode.RELEASE
) -> list[tuple[Condition, AnyMode]]:
    """Return the row of a mode with an object in the hand.

    Args:
        following: The mode that follows the motion.
        lost: The mode that follows if the hand has lost the object.
    """
    return [
        (lambda o, t, c: o.arrived and not o.holding, lost),
        (lambda o, t, c: o.arrived, following),
    ]


TRANSITIONS: Table = {
    Mode.IDLE: [
        (lambda o, t, c: o.failure is not None, Mode.FAILED),
        (lambda o, t, c: o.ready, Mode.PRE_GRASP),
        (lambda o, t, c: o.stuck, Mode.RETREAT),
    ],
    Mode.PRE_GRASP: [
        (lambda o, t, c: o.arrived and o.moved, Mode.IDLE),
        (lambda o, t, c: o.arrived, Mode.GRASP),
    ],
    Mode.GRASP: [(lambda o, t, c: o.arrived, Mode.CLOSE)],
    Mode.CLOSE: [
        (
            lambda o, t, c: t >= c.gripper_reaction and o.holding and o.still,
            Mode.VERIFY,
        ),
        (lambda o, t, c: t >= c.gripper_timeout, Mode.VERIFY),
    ],
    Mode.VERIFY: [
        (lambda o, t, c: not o.holding, Mode.RELEASE),
        (lambda o, t, c: t >= max(c.verify_time, c.grip_wait), Mode.LIFT),
    ],
    Mode.LIFT: carried(Mode.TRANSFER),
    Mode.TRANSFER: [
        (lambda o, t, c: o.arrived and not o.holding, Mode.RELEASE),
        (lambda o, t, c: o.arrived and o.failure is not None, Mode.FAILED),
        (lambda o, t, c: o.arrived and o.ready, Mode.PLACE),
    ],
    Mode.PLACE: [(lambda o, t, c: o.arrived, Mode.RELEASE)],
    Mode.RELEASE: [
        (lambda o, t, c: o.failure is not None, Mode.FAILED),
        (
            lambda o, t, c: t >= c.release_wait and o.clear and o.still,
            Mode.RETREAT,
        ),
        (lambda o, t, c: t >= c.gripper_timeout + c.release_wait, Mode.RETREAT),
    ],
    Mode.RETREAT: [(lambda o, t, c: o.arrived, Mode.HOME)],
    Mode.HOME: [
        (lambda o, t, c: o.arrived and o.at_goal and o.last_cycle, Mode.DONE),
        (lambda o, t, c: o.arrived and o.at_goal, Mode.IDLE),
        (lambda o, t, c: o.arrived and o.failure is not None, Mode.FAILED),
        (lambda o, t, c: o.arrived, Mode.IDLE),
    ],
    Mode.DONE: [],
    Mode.FAILED: [],
}

# After any other failure, the arm first goes home, and may try again.
FATAL = (Failure.TIME_BUDGET, Failure.STOPPED)
transition = Transitions(TRANSITIONS, FATAL)
