"""What the pick-and-place planner remembers, and what follows from that alone."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.planning.task.task_motions import Obstacles, TaskMotions
from drake_srg.planning.task.transitions import Observation
from drake_srg.types import Blob, Failure, Mode, PlannerStatus, Vector

# Duration of a stop in the middle of a motion [s]: at the iiwa's top speed, 1.5 to 2.4
# rad/s, that brakes with less than half of its acceleration limits.
_STOP_TIME = 0.4
_MESSAGES = {
    Failure.STOPPED: "the arm does not get where it is sent; something is in its way",
    Failure.TIME_BUDGET: "the time budget is used up",
    Failure.NO_GRASP: "the fingers closed, but nothing of the right size is in them",
    Failure.DROPPED: "the object was in the hand and got lost",
    Failure.MISPLACED: "the object is not seen on its goal",
}


@dc.dataclass(frozen=True)
class PlannerMemory:
    """The planner's state. Never changed, only replaced, so copies share it."""

    q_rest: Vector  # where the arm is without a motion, shape (N,) [rad]
    mode: Mode = Mode.IDLE
    since: float = 0.0  # when the mode began [s]
    started: float = 0.0  # when the task began [s]
    next_look: float = 0.0  # when the object is looked for next [s]
    ready_at: float = np.inf  # when the planned motion may begin [s]
    attempts: int = 0  # grasps begun
    attempts_before: int = 0  # those of earlier cycles
    detours: int = 0  # approaches broken off because the object had moved
    cycles: int = 0  # times the object has been placed
    looks: int = 0  # evaluations of `blobs`
    X_WO: RigidTransform | None = None  # where the object was seen [m]
    X_WO_return: RigidTransform | None = None  # where every second cycle puts it [m]
    motions: TaskMotions | None = None
    moved: bool = False  # the object is not where the motions take it
    lost: bool = False  # the object was seen elsewhere than in the hand
    looked: bool = False  # the look that the mode ends with has been taken
    obstacles: Obstacles = ()  # other objects seen
    escape: tuple[Trajectory, Trajectory] | None = None  # retreat and home
    trajectory: Trajectory | None = None  # of the mode
    departed: float = 0.0  # when that motion began [s]
    due: float = 0.0  # when it is over [s]
    stopped_at: float | None = None  # time in the trajectory where a stop began [s]
    # Angles of the gripper's joints with an object, smoothed over time, (n,) [rad].
    grip: Vector = dc.field(default_factory=lambda: np.zeros(0))
    unheld_since: float = np.inf  # when the fingers began to sense nothing [s]
    tried: tuple[str, ...] = ()  # names of grasps that failed in this cycle
    closure: float = 0.0
    # Angles of the gripper's joints, open as they were last, by name [rad].
    fingers: Mapping[str, float] = dc.field(default_factory=dict)
    touched: str = ""  # what the arm has met, in words
    failure: Failure | None = None  # what went wrong last
    localization: Blob | None = None  # the first one that led to a plan
    localized_at: float = 0.0  # s
    message: str = ""
    planning_wall: float = 0.0  # s

    def __deepcopy__(self, memo: dict[int, Any]) -> PlannerMemory:
        return self

    def position(self, time: float) -> Vector:
        """The commanded position at a time, shape (N,) [rad]."""
        if self.trajectory is None:
            return self.q_rest
        t = time - self.departed
        if self.stopped_at is not None:
            t = min(t - self.stopped_at, _STOP_TIME)
            t = self.stopped_at + t - 0.5 * t * t / _STOP_TIME
        q: Vector = self.trajectory.value(min(t, self.trajectory.end_time()))[:, 0]
        return q

    @property
    def destination(self) -> Vector:
        """The position in which the commands end, shape (N,) [rad]."""
        return self.position(np.inf)

    def stopped(self, time: float) -> PlannerMemory:
        """A motion that is under way comes to rest along its own path."""
        if self.trajectory is None or self.stopped_at is not None:
            return self
        return dc.replace(self, stopped_at=time - self.departed, due=time + _STOP_TIME)

    def status(self) -> PlannerStatus:
        """What the planner says of its task."""
        return PlannerStatus(
            mode=self.mode,
            failure=self.failure if self.mode is Mode.FAILED else None,
            attempts=self.attempts,
            cycles=self.cycles,
            looks=self.looks,
            localization=self.localization,
            localized_at=self.localized_at,
            message=self.message,
            planning_wall=self.planning_wall,
        )

    def end_attempt(self, mode: Mode, o: Observation, time: float) -> PlannerMemory:
        """Forget the motions, but not what went wrong; `mode` begins."""
        memory, previous = self, self.mode
        failure = o.failure or self.failure
        looked = previous is Mode.HOME and o.arrived
        if looked and self.failure in (None, Failure.DROPPED):
            memory = dc.replace(memory, looks=self.looks + 1)  # for `at_goal`
            if o.at_goal:
                failure = None
                memory = dc.replace(
                    memory,
                    cycles=self.cycles + 1,
                    attempts_before=self.attempts,
                    started=time,
                    detours=0,
                    tried=(),
                    message="",
                )
            elif failure is None:
                failure = Failure.MISPLACED
        if failure is not None and previous is not Mode.IDLE:
            message = self.touched or _MESSAGES.get(failure, self.message)
            memory = dc.replace(memory, message=message)
        if self.trajectory is not None and time < self.due:
            memory = memory.stopped(time)
        else:
            memory = dc.replace(memory, trajectory=None, stopped_at=None)
        return dc.replace(
            memory,
            mode=mode,
            since=time,
            q_rest=self.position(time),
            failure=failure,
            motions=None,
            escape=None,
            moved=False,
            lost=False,
            looked=False,
            next_look=time,
            ready_at=np.inf,
        )
