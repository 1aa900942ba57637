"""The modes of the five-axis arm's thesis: six waypoints, one look."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, TypeAlias

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning import state_machine
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.planner_machine import (
    MotionMemory,
    Observation,
    PlannerConfig,
    PlannerMode,
    Table,
    Transitions,
    planning_clock,
)
from drake_srg.planning.taught.taught_motions import TaughtMotions
from drake_srg.types import Blob, Failure, Mode, PlannerStatus, Vector


@dc.dataclass(frozen=True)
class Senses:
    """What the planner measures."""

    q: Vector  # the arm's joints, shape (N,) [rad]
    gripped: bool  # both fingers sense something
    see: Callable[[], Sequence[Blob]]  # looks through the camera


@dc.dataclass
class TaughtMemory(MotionMemory):
    """All that the planner remembers."""

    motions: Mapping[Mode, Trajectory] = dc.field(default_factory=dict)
    gripped_since: float = np.inf  # s
    ready_at: float = np.inf  # when the planned motions may begin [s]
    next_look: float = 0.0  # s
    report: PlannerStatus = dc.field(default_factory=PlannerStatus)

    def status(self, mode: Mode) -> PlannerStatus:
        """Return the planner's report on its task in a mode."""
        return dc.replace(self.report, mode=mode)


Now: TypeAlias = state_machine.Moment[Senses]
Entry: TypeAlias = state_machine.Entry[Senses, Mode, Observation]

# In the words of the thesis: IDLE, GOTO_P1, GOTO_P2, GRASP, GOTO_P3, GOTO_P4, RELEASE,
# GOTO_P0 with CLOSE_AT_HOME, END. The conditions take the observation o, the time t in
# the mode [s] and the planner's configuration c.
TRANSITIONS: Table = {
    Mode.IDLE: [(lambda o, t, c: o.ready, Mode.PRE_GRASP)],
    Mode.PRE_GRASP: [(lambda o, t, c: o.arrived, Mode.GRASP)],
    Mode.GRASP: [(lambda o, t, c: o.arrived, Mode.CLOSE)],
    Mode.CLOSE: [(lambda o, t, c: o.holding, Mode.LIFT)],
    Mode.LIFT: [(lambda o, t, c: o.arrived, Mode.PLACE)],
    Mode.PLACE: [(lambda o, t, c: o.arrived, Mode.RELEASE)],
    Mode.RELEASE: [(lambda o, t, c: t >= c.release_wait, Mode.HOME)],
    Mode.HOME: [(lambda o, t, c: o.arrived, Mode.DONE)],
    Mode.DONE: [],
    Mode.FAILED: [],
}
transition = Transitions(TRANSITIONS)


class TaughtMode(PlannerMode[TaughtMemory, Senses]):
    """A mode that moves the arm or waits, and commands the fingers.

    Attributes:
        commands: What it commands the fingers as it begins, 0 open .. 1 closed; None:
            as before.
        planner: Plans the motions.
        config: Waits and limits.
        name: Of the blob to take.
    """

    commands: ClassVar[float | None] = None

    def __init__(
        self, planner: TaughtMotions, config: PlannerConfig, name: str
    ) -> None:
        self.planner = planner
        self.config = config
        self.name = name

    def trajectory(self, memory: TaughtMemory) -> Trajectory | None:
        """Return the planned motion of the mode, None where the arm rests."""
        return memory.motions.get(self.mode)

    def enter(self, memory: TaughtMemory, entry: Entry) -> TaughtMemory:
        """Begin the mode's motion and command the fingers."""
        memory.gripped_since = np.inf
        if self.commands is not None:
            memory.closure = self.commands
        return super().enter(memory, entry)

    def update(self, memory: TaughtMemory, now: Now) -> TaughtMemory:
        """Notice since when both fingers have sensed something."""
        since = min(memory.gripped_since, now.time)
        memory.gripped_since = since if now.senses.gripped else np.inf
        return memory

    def final_failure(self, memory: TaughtMemory, time: float) -> Failure | None:
        """Return that the time is up, if it is."""
        over = time - memory.report.localized_at > self.config.time_budget
        return Failure.TIME_BUDGET if over else None

    def observe_mode(self, memory: TaughtMemory, now: Now) -> Observation:
        """Report whether the arm has arrived, and the grip has lasted."""
        return Observation(
            arrived=memory.motion.arrived(now.senses.q, now.time),
            holding=now.time - memory.gripped_since >= self.config.grip_wait,
        )


class Idle(TaughtMode):
    """Looks until a blob has been sent, and plans all motions from it."""

    mode = Mode.IDLE

    def update(self, memory: TaughtMemory, now: Now) -> TaughtMemory:
        """Look when a look is due, and plan once there is something to grasp."""
        if memory.motions or now.time < memory.next_look:
            return memory
        memory.next_look = now.time + self.config.search_period
        grasp = self.planner.config.grasp
        p_WT = self._look(memory, now) if grasp is None else np.array(grasp)
        if p_WT is None:
            return memory
        with planning_clock.running():
            planned = self.planner.plan(p_WT)
        memory.ready_at = now.time + self.config.latency
        memory.report = dc.replace(memory.report, localized_at=now.time)
        if isinstance(planned, PlanningFailure):
            memory.report = dc.replace(
                memory.report, failure=planned.failure, message=planned.message
            )
        else:
            memory.motions = planned
        return memory

    def _look(self, memory: TaughtMemory, now: Now) -> Vector | None:
        """Return where the tip must grasp (3,) [m]; None if there is no blob."""
        seen = tuple(now.senses.see())
        report = dc.replace(memory.report, looks=memory.report.looks + 1, blobs=seen)
        memory.report = report
        blob = next((b for b in seen if b.object_name == self.name), None)
        if blob is None:
            return None
        memory.report = dc.replace(
            report, localization=blob, sighting=blob, sighted_at=now.time
        )
        return blob.position

    def observe(self, memory: TaughtMemory, now: Now) -> Observation:
        """Report motions, or why there are none, once planning has taken its time."""
        late = now.time > self.config.search_time
        unseen = Failure.NOT_SEEN if late and not memory.motions else None
        return Observation(
            ready=now.time >= memory.ready_at and bool(memory.motions),
            failure=memory.report.failure or unseen,
        )


class PreGrasp(TaughtMode):
    """Moves the open hand beside the object."""

    mode, commands = Mode.PRE_GRASP, 0.0


class Grasp(TaughtMode):
    """Moves the open hand around the object."""

    mode = Mode.GRASP

    def enter(self, memory: TaughtMemory, entry: Entry) -> TaughtMemory:
        """Count the attempt, and go."""
        memory.report = dc.replace(memory.report, attempts=1)
        return super().enter(memory, entry)


class Close(TaughtMode):
    """Closes the fingers until both have sensed something for a while."""

    mode, commands = Mode.CLOSE, 1.0


class Lift(TaughtMode):
    """Moves the arm to the taught posture above."""

    mode = Mode.LIFT


class Place(TaughtMode):
    """Moves the arm to the taught posture at the goal."""

    mode = Mode.PLACE


class Release(TaughtMode):
    """Opens the fingers."""

    mode, commands = Mode.RELEASE, 0.0


class Home(TaughtMode):
    """Moves the arm home, waits there, and closes the hand."""

    mode = Mode.HOME

    @property
    def wait(self) -> float:
        """Time at home, including that for the fingers to close [s]."""
        return self.config.home_wait + self.config.close_at_home

    def update(self, memory: TaughtMemory, now: Now) -> TaughtMemory:
        """Close the empty hand at the end."""
        if 0.0 < self.config.close_at_home >= memory.motion.due - now.time:
            memory.closure = 1.0
        return memory


class End(TaughtMode):
    """Stays where it is: the task is over."""

    def observe(self, memory: TaughtMemory, now: Now) -> Observation:
        """Observe nothing."""
        return Observation()


class Done(End):
    """The arm is home; whether the object is on its goal, this planner cannot tell."""

    mode = Mode.DONE

    def enter(self, memory: TaughtMemory, entry: Entry) -> TaughtMemory:
        """Count the cycle."""
        memory.report = dc.replace(memory.report, cycles=1)
        return super().enter(memory, entry)


class Failed(End):
    """The planner has given up, for the reason that its status names."""

    mode = Mode.FAILED

    def enter(self, memory: TaughtMemory, entry: Entry) -> TaughtMemory:
        """Remember why."""
        observed = entry.observation.failure if entry.observation else None
        failure = memory.report.failure or observed
        memory.report = dc.replace(memory.report, failure=failure)
        return super().enter(memory, entry)


KINDS: tuple[type[TaughtMode], ...] = (
    *(Idle, PreGrasp, Grasp, Close, Lift, Place, Release, Home, Done, Failed),
)
