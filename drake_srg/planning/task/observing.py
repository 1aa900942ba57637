"""What the planner feels, and what it concludes from that."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable

import numpy as np

from drake_srg.planning.task.config import PlannerConfig
from drake_srg.planning.task.planner_memory import PlannerMemory
from drake_srg.planning.task.transitions import Observation
from drake_srg.types import Failure, Mode, Vector

_STILL = 0.05  # joint speed below which the fingers rest [rad/s]
_CLEAR = 0.001  # distance at which resting fingers have let go of an object [m]
_ARRIVED = 0.005  # joint error within which the arm is where it was sent [rad]
CARRYING = (Mode.LIFT, Mode.TRANSFER, Mode.PLACE)


@dc.dataclass(frozen=True)
class Senses:
    """Measurements of one time."""

    q: Vector  # the arm's joints, shape (N,) [rad]
    fingers: Vector  # the gripper's joints, shape (n,) [rad]
    finger_speeds: Vector  # shape (n,) [rad/s]
    grasped: bool  # both fingers sense something
    proximity: Vector  # shape (m,) [m]
    external_torque: Vector | None = None  # at the arm's joints, shape (N,) [N m]


def arrived(memory: PlannerMemory, senses: Senses, time: float) -> bool:
    """Whether the mode's motion is over and the arm follows."""
    if memory.trajectory is None:
        return True
    if time < memory.due:
        return False
    return bool(np.max(np.abs(senses.q - memory.destination)) < _ARRIVED)


def holding(memory: PlannerMemory, senses: Senses) -> bool:
    """Whether both fingers sense something, and not just one another."""
    if memory.motions is None or memory.lost or not senses.grasped:
        return False
    return memory.motions.grasp.holds(senses.fingers, senses.proximity)


def watch_grasp(
    memory: PlannerMemory, senses: Senses, time: float, config: PlannerConfig
) -> PlannerMemory:
    """Stop the motion of an arm whose hand loses what it carries.

    That is where nothing is sensed between the fingers for `config.slip_time`, or where
    they close by `config.slip_closing` in about that time.
    """
    if memory.mode not in CARRYING or memory.lost:
        return memory
    since = np.inf if holding(memory, senses) else min(memory.unheld_since, time)
    closing = senses.fingers - memory.grip
    if time - since >= config.slip_time or np.mean(closing) > config.slip_closing:
        return dc.replace(memory.stopped(time), lost=True)
    grip = memory.grip + min(config.period / config.slip_time, 1.0) * closing
    return dc.replace(memory, unheld_since=since, grip=grip)


def watch_touch(
    memory: PlannerMemory, senses: Senses, config: PlannerConfig
) -> PlannerMemory:
    """Stop a moving arm where it is when it meets something."""
    limits, torque = config.max_external_torque, senses.external_torque
    ended = memory.mode in (Mode.DONE, Mode.FAILED)
    if limits is None or torque is None or memory.trajectory is None or ended:
        return memory
    excess = np.abs(torque) - limits
    joint = int(np.argmax(excess))
    if excess[joint] <= 0.0:
        return memory
    # Its own path might lead on into what it has met, and so might its lag behind that.
    return dc.replace(
        memory,
        q_rest=senses.q.copy(),
        trajectory=None,
        stopped_at=None,
        touched=f"the arm touches something: joint {joint + 1} feels "
        f"{abs(torque[joint]):.2g} N m from outside, {limits[joint]:.2g} are allowed",
    )


def observe(
    memory: PlannerMemory,
    senses: Senses,
    time: float,
    config: PlannerConfig,
    is_at_goal: Callable[[], bool],
    repeat: int,
) -> Observation:
    """Evaluate what the mode's transitions need, and only that.

    Args:
        memory: Of the planner.
        senses: What is measured now.
        time: Now [s].
        config: Times and limits.
        is_at_goal: Looks whether the object is on its goal.
        repeat: How many cycles are to be done.
    """
    mode = memory.mode
    if memory.touched or time - memory.started > config.time_budget:
        touched = bool(memory.touched)
        return Observation(failure=Failure.STOPPED if touched else Failure.TIME_BUDGET)
    if mode is Mode.IDLE:
        due = time >= memory.ready_at
        planned = memory.motions is not None
        stuck = memory.escape is not None
        return Observation(
            ready=due and planned,
            stuck=due and stuck,
            failure=memory.failure if due and not (planned or stuck) else None,
        )
    if mode in (Mode.CLOSE, Mode.VERIFY, Mode.RELEASE):
        return Observation(
            still=bool(np.max(np.abs(senses.finger_speeds)) < _STILL),
            holding=holding(memory, senses),
            clear=time >= memory.ready_at and bool(np.min(senses.proximity) > _CLEAR),
        )
    there = arrived(memory, senses, time)
    if not there and time > memory.due + config.arrival_timeout:
        return Observation(failure=Failure.STOPPED)
    if mode is not Mode.HOME or not there:
        return Observation(
            arrived=there,
            ready=time >= memory.ready_at,
            moved=memory.moved,
            holding=there and holding(memory, senses),
            failure=memory.failure if mode is Mode.TRANSFER else None,
        )
    # What was dropped may have been dropped where it shall be.
    at_goal = memory.failure in (None, Failure.DROPPED) and is_at_goal()
    attempts = memory.attempts - memory.attempts_before
    out_of_attempts = attempts >= config.max_attempts
    return Observation(
        arrived=True,
        at_goal=at_goal,
        last_cycle=memory.cycles + 1 >= repeat,
        failure=(memory.failure or Failure.MISPLACED)
        if out_of_attempts and not at_goal
        else None,
    )
