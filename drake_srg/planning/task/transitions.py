"""The transition table of picking and placing."""

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from drake_srg.planning.state_machine import next_mode
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.types import Failure, Mode


@dc.dataclass(frozen=True)
class Observation:
    """The facts that decide the next mode; each mode fills in what its row needs."""

    ready: bool = False  # motions are planned, and the planning latency has passed
    stuck: bool = False  # no motions can be planned from here, but a way home can
    moved: bool = False  # the object is not where the motions take it
    arrived: bool = False  # the mode's motion is over, and the arm has followed it
    still: bool = False  # the fingers have come to rest
    holding: bool = False  # something of the right size is between the fingers
    clear: bool = False  # nothing is near the fingers
    at_goal: bool = False  # the object has been seen on its goal
    last_cycle: bool = True  # no cycle follows this one
    failure: Failure | None = None  # the reason to give up


# mode: [(condition on the observation o, the time t in the mode [s] and the planner's
#         configuration c; next mode)]. The first condition that holds decides.
Condition: TypeAlias = Callable[[Observation, float, PlannerConfig], bool]
Table: TypeAlias = Mapping[Mode, Sequence[tuple[Condition, Mode]]]
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
    Mode.LIFT: [
        (lambda o, t, c: o.arrived and not o.holding, Mode.RELEASE),
        (lambda o, t, c: o.arrived, Mode.TRANSFER),
    ],
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


def transition(
    mode: Mode,
    observation: Observation,
    t: float,
    config: PlannerConfig | None = None,
    table: Table = TRANSITIONS,
) -> Mode:
    """Return the mode that follows, by a table.

    From every mode, a spent time budget and a stop lead to FAILED.

    Args:
        mode: The mode now.
        observation: What is known now.
        t: Time since the mode began [s].
        config: The waits and the times of the gripper count here.
        table: The transitions.
    """
    if observation.failure in (Failure.TIME_BUDGET, Failure.STOPPED):
        return mode if mode in (Mode.DONE, Mode.FAILED) else Mode.FAILED
    return next_mode(table, mode, observation, t, config or PlannerConfig())
