"""The modes of the five-axis arm's thesis: six waypoints, one look."""

from __future__ import annotations

import dataclasses as dc
import time as wall
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning import state_machine
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.state_machine import next_mode
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.planning.taught.taught_motions import TaughtMotions
from drake_srg.types import Blob, Failure, Mode, PlannerStatus, Vector


@dc.dataclass(frozen=True)
class Senses:
    """What the planner measures."""

    q: Vector  # the arm's joints, shape (N,) [rad]
    gripped: bool  # both fingers sense something
    see: Callable[[], Sequence[Blob]]  # looks through the camera


@dc.dataclass(frozen=True)
class Memory:
    """The planner's memory; it is never changed, only replaced."""

    motion: Motion
    motions: Mapping[Mode, Trajectory] = dc.field(default_factory=dict)
    closure: float = 0.0  # commanded, 0 open .. 1 closed
    gripped_since: float = np.inf  # s
    ready_at: float = np.inf  # when the planned motions may begin [s]
    next_look: float = 0.0  # s
    report: PlannerStatus = dc.field(default_factory=PlannerStatus)

    def __deepcopy__(self, memo: dict[int, Any]) -> Memory:
        return self

    def status(self, mode: Mode) -> PlannerStatus:
        """Return the planner's report on its task in a mode."""
        return dc.replace(self.report, mode=mode)


@dc.dataclass(frozen=True)
class Observation:
    """The facts that decide the next mode."""

    ready: bool = False  # motions are planned, and the planning latency has passed
    arrived: bool = False  # motion and wait are over, and the arm has followed
    # How long both fingers have sensed something [s]; -inf where they do not.
    gripped: float = -np.inf
    failure: Failure | None = None  # the reason to give up


Now: TypeAlias = state_machine.Moment[Senses]
Entry: TypeAlias = state_machine.Entry[Senses, Mode, Observation]

# In the words of the thesis: IDLE, GOTO_P1, GOTO_P2, GRASP, GOTO_P3, GOTO_P4, RELEASE,
# GOTO_P0 with CLOSE_AT_HOME, END. The conditions take the observation o, the time t in
# the mode [s] and the planner's configuration c.
TRANSITIONS: Mapping[
    Mode, Sequence[tuple[Callable[[Observation, float, PlannerConfig], bool], Mode]]
] = {
    Mode.IDLE: [(lambda o, t, c: o.ready, Mode.PRE_GRASP)],
    Mode.PRE_GRASP: [(lambda o, t, c: o.arrived, Mode.GRASP)],
    Mode.GRASP: [(lambda o, t, c: o.arrived, Mode.CLOSE)],
    Mode.CLOSE: [(lambda o, t, c: o.gripped >= c.grip_wait, Mode.LIFT)],
    Mode.LIFT: [(lambda o, t, c: o.arrived, Mode.PLACE)],
    Mode.PLACE: [(lambda o, t, c: o.arrived, Mode.RELEASE)],
    Mode.RELEASE: [(lambda o, t, c: t >= c.release_wait, Mode.HOME)],
    Mode.HOME: [(lambda o, t, c: o.arrived, Mode.DONE)],
    Mode.DONE: [],
    Mode.FAILED: [],
}


def transition(
    mode: Mode, observation: Observation, t: float, config: PlannerConfig
) -> Mode:
    """Return the mode that follows.

    Args:
        mode: The mode now.
        observation: What is known now.
        t: Time since the mode began [s].
        config: The waits count here.
    """
    over = mode in (Mode.DONE, Mode.FAILED)
    if observation.failure is not None and not over:
        return Mode.FAILED
    return next_mode(TRANSITIONS, mode, observation, t, config)


class TaughtMode(state_machine.ModeActions[Mode, Memory, Senses, Observation]):
    """A mode that moves the arm or waits, and commands the fingers.

    Args:
        mode: Which mode it is.
        closure: What it commands the fingers as it begins, 0 open .. 1 closed; None: as
            before.
        config: Waits and limits.
    """

    def __init__(
        self, mode: Mode, config: PlannerConfig, closure: float | None = None
    ) -> None:
        self.mode = mode
        self.config = config
        self.closure = closure

    def enter(self, memory: Memory, entry: Entry) -> Memory:
        """Begin the mode's motion and command the fingers."""
        motion = memory.motion.followed_by(
            memory.motions.get(self.mode), entry.time, self.wait
        )
        closure = memory.closure if self.closure is None else self.closure
        return dc.replace(
            memory,
            motion=motion,
            closure=closure,
            gripped_since=np.inf,
            report=self.report(memory.report, entry),
        )

    def report(self, report: PlannerStatus, entry: Entry) -> PlannerStatus:
        """Return what the planner reports from now on."""
        return dc.replace(report, mode=self.mode)

    @property
    def wait(self) -> float:
        """How long the mode lasts after its motion [s]."""
        return 0.0

    def update(self, memory: Memory, now: Now) -> Memory:
        """Notice since when both fingers have sensed something."""
        since = min(memory.gripped_since, now.time) if now.senses.gripped else np.inf
        return dc.replace(memory, gripped_since=since)

    def observe(self, memory: Memory, now: Now) -> Observation:
        """Report whether the arm has arrived, the grip lasts and the time is up."""
        over = now.time - memory.report.localized_at > self.config.time_budget
        return Observation(
            arrived=memory.motion.arrived(now.senses.q, now.time),
            gripped=now.time - memory.gripped_since,
            failure=Failure.TIME_BUDGET if over else None,
        )


class Idle(TaughtMode):
    """Looks until a blob has been sent, and plans all motions from it."""

    def __init__(self, config: PlannerConfig, planner: TaughtMotions, name: str):
        super().__init__(Mode.IDLE, config)
        self.planner = planner
        self.name = name

    def update(self, memory: Memory, now: Now) -> Memory:
        """Look when a look is due, and plan once there is something to grasp."""
        if memory.motions or now.time < memory.next_look:
            return memory
        taught, report = self.planner.config, memory.report
        next_look = now.time + self.config.search_period
        memory = dc.replace(memory, next_look=next_look)
        if taught.grasp is not None:
            p_WT = np.array(taught.grasp)
        else:
            seen = tuple(now.senses.see())
            report = dc.replace(report, looks=report.looks + 1, blobs=seen)
            memory = dc.replace(memory, report=report)
            blobs = [b for b in seen if b.object_name == self.name]
            if not blobs:
                return memory
            p_WT = blobs[0].position
            report = dc.replace(
                report,
                localization=blobs[0],
                sighting=blobs[0],
                sighted_at=now.time,
            )
        start = wall.perf_counter()
        planned = self.planner.plan(p_WT)
        report = dc.replace(
            report, localized_at=now.time, planning_wall=wall.perf_counter() - start
        )
        if isinstance(planned, PlanningFailure):
            report = dc.replace(
                report, failure=planned.failure, message=planned.message
            )
            planned = {}
        ready_at = now.time + self.config.latency
        return dc.replace(memory, motions=planned, ready_at=ready_at, report=report)

    def observe(self, memory: Memory, now: Now) -> Observation:
        """Report motions, or why there are none, once planning has taken its time."""
        late = now.time > self.config.search_time
        unseen = Failure.NOT_SEEN if late and not memory.motions else None
        return Observation(
            ready=now.time >= memory.ready_at and bool(memory.motions),
            failure=memory.report.failure or unseen,
        )


class Grasp(TaughtMode):
    """Moves the open hand around the object."""

    def report(self, report: PlannerStatus, entry: Entry) -> PlannerStatus:
        """Count the attempt."""
        return dc.replace(super().report(report, entry), attempts=1)


class Home(TaughtMode):
    """Moves the arm home, waits there, and closes the hand."""

    @property
    def wait(self) -> float:
        """Time at home, including that for the fingers to close [s]."""
        return self.config.home_wait + self.config.close_at_home

    def update(self, memory: Memory, now: Now) -> Memory:
        """Close the empty hand at the end."""
        if 0.0 < self.config.close_at_home >= memory.motion.due - now.time:
            return dc.replace(memory, closure=1.0)
        return memory


class End(TaughtMode):
    """Stays where it is: the task is over."""

    def report(self, report: PlannerStatus, entry: Entry) -> PlannerStatus:
        """Report success or failure, as far as this planner can tell."""
        report = super().report(report, entry)
        if self.mode is Mode.DONE:
            return dc.replace(report, cycles=1)
        observed = entry.observation.failure if entry.observation else None
        return dc.replace(report, failure=report.failure or observed)

    def observe(self, memory: Memory, now: Now) -> Observation:
        """Observe nothing."""
        return Observation()


def taught_modes(
    config: PlannerConfig, motions: TaughtMotions, name: str
) -> dict[Mode, TaughtMode]:
    """Return what the planner does in each mode.

    Args:
        config: Waits and limits.
        motions: Plans the motions.
        name: Of the blob to take.
    """
    return {
        Mode.IDLE: Idle(config, motions, name),
        Mode.PRE_GRASP: TaughtMode(Mode.PRE_GRASP, config, closure=0.0),
        Mode.GRASP: Grasp(Mode.GRASP, config),
        Mode.CLOSE: TaughtMode(Mode.CLOSE, config, closure=1.0),
        Mode.LIFT: TaughtMode(Mode.LIFT, config),
        Mode.PLACE: TaughtMode(Mode.PLACE, config),
        Mode.RELEASE: TaughtMode(Mode.RELEASE, config, closure=0.0),
        Mode.HOME: Home(Mode.HOME, config),
        Mode.DONE: End(Mode.DONE, config),
        Mode.FAILED: End(Mode.FAILED, config),
    }
