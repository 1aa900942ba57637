"""The transition table of clearing a table."""

from drake_srg.planning.planner_machine import (
    Observation,
    PlannerConfig,
    Table,
    Transitions,
)
from drake_srg.types import Mode


def _released(o: Observation, t: float, c: PlannerConfig) -> bool:
    waited = t >= max(c.gripper_reaction, c.release_wait)
    return (waited and o.clear) or t >= c.gripper_timeout


TRANSITIONS: Table = {
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
transition = Transitions(TRANSITIONS)
