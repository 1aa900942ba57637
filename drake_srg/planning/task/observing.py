"""The planner's senses, and conclusions from them."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.senses import HandSenses
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.planning.task.planner_memory import PlannerMemory
from drake_srg.planning.task.sightings import View
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class Senses(HandSenses[View]):
    """Measurements at one time."""

    external_torque: Vector | None = None  # at the arm's joints, shape (N,) [N m]


def holding(memory: PlannerMemory, senses: Senses) -> bool:
    """Return whether both fingers sense something, and not just one another."""
    attempt = memory.attempt
    if attempt.motions is None or attempt.lost or not senses.grasped:
        return False
    return attempt.motions.grasp.holds(senses.fingers, senses.proximity)


def watch_grasp(
    memory: PlannerMemory, senses: Senses, time: float, config: PlannerConfig
) -> PlannerMemory:
    """Stop the motion of an arm whose hand loses what it carries.

    The object is lost where nothing is sensed between the fingers for
    `config.slip_time`, or where they close by `config.slip_closing` in about that time.
    """
    if memory.attempt.lost:
        return memory
    grip = memory.grip
    since = np.inf if holding(memory, senses) else min(grip.unheld_since, time)
    closing = senses.fingers - grip.angles
    if time - since >= config.slip_time or np.mean(closing) > config.slip_closing:
        return dc.replace(
            memory,
            motion=memory.motion.stopped(time),
            attempt=dc.replace(memory.attempt, lost=True),
        )
    angles = grip.angles + min(config.period / config.slip_time, 1.0) * closing
    return dc.replace(memory, grip=dc.replace(grip, unheld_since=since, angles=angles))


def watch_touch(
    memory: PlannerMemory, senses: Senses, config: PlannerConfig
) -> PlannerMemory:
    """Stop a moving arm where it is when it meets something."""
    limits, torque = config.max_external_torque, senses.external_torque
    if limits is None or torque is None or memory.motion.trajectory is None:
        return memory
    excess = np.abs(torque) - limits
    joint = int(np.argmax(excess))
    if excess[joint] <= 0.0:
        return memory
    touched = (
        f"the arm touches something: joint {joint + 1} feels "
        f"{abs(torque[joint]):.2g} N m from outside (allowed: {limits[joint]:.2g} N m)"
    )
    # Its own path might lead on into what it has met, and so might its lag behind that.
    return dc.replace(
        memory,
        motion=Motion(senses.q.copy()),
        trouble=dc.replace(memory.trouble, touched=touched),
    )
