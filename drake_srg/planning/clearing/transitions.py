"""The transition table of clearing a table."""

import dataclasses as dc
from collections.abc import Callable

from drake_srg.planning.state_machine import next_mode
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.types import Failure, Mode


@dc.dataclass(frozen=True)
class Observation:
    """The facts that decide the next mode."""

    ready: bool = False  # a pick is planned, and the planning latency has passed
    pushing: bool = False  # the same of a push
    finished: bool = False  # no grasp takes anything that is left
    unseen: bool = False  # nor was the last load seen where it belongs
    arrived: bool = False  # the mode's motion is over, and the arm has followed it
    stuck: bool = False  # the motion is over, but something has stopped the arm
    astray: bool = False  # the arm is where something has stopped it
    moved: bool = False  # what was to be taken has moved
    placing: bool = False  # the load is to be set down, not dropped
    still: bool = False  # the fingers have come to rest
    clear: bool = False  # nothing is near the fingers
    failure: Failure | None = None  # the reason to give up


def _released(o: Observation, t: float, c: PlannerConfig) -> bool:
    waited = t >= max(c.gripper_reaction, c.release_wait)
    return (waited and o.clear) or t >= c.gripper_timeout


_Condition = Callable[[Observation, float, PlannerConfig], bool]
# mode: [(condition on the observation o, the time t in the mode [s] and the planner's
#         configuration c; next mode)]. The first condition that holds decides.
TRANSITIONS: dict[Mode, list[tuple[_Condition, Mode]]] = {
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
    Mode.CLOSE: [
        (lambda o, t, c: t >= max(c.gripper_reaction, c.grip_wait) and o.still,
         Mode.LIFT),
        (lambda o, t, c: t >= c.gripper_timeout, Mode.LIFT),
    ],
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


def transition(
    mode: Mode, observation: Observation, t: float, config: PlannerConfig
) -> Mode:
    """Return the mode that follows, by the table `TRANSITIONS`.

    From every mode, a failure leads to FAILED.

    Args:
        mode: The mode now.
        observation: What is known now.
        t: Time since the mode began [s].
        config: The waits and the times of the gripper count here.
    """
    over = mode in (Mode.DONE, Mode.FAILED)
    if observation.failure is not None and not over:
        return Mode.FAILED
    return next_mode(TRANSITIONS, mode, observation, t, config)
