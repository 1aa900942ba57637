"""The planner that inserts a peg into a hole: its transitions and its system."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping

from pydrake.math import RigidTransform

from drake_srg.planning.insertion.config import Insert, InsertMemory, InsertMode, Task
from drake_srg.planning.insertion.modes import INSERTION_MODES
from drake_srg.planning.pick_and_place.knowledge import FATAL, TRANSITIONS, carried
from drake_srg.planning.pick_and_place.modes import TaskMode, task_modes
from drake_srg.planning.pick_and_place.planner import PickAndPlacePlanner
from drake_srg.planning.pick_and_place.replanning import Replanner
from drake_srg.planning.pick_and_place.sightings import PickTask
from drake_srg.planning.pick_and_place.task_motions import TaskPlanner
from drake_srg.planning.planner_machine import (
    Condition,
    PlannerConfig,
    Table,
    Transitions,
)
from drake_srg.planning.servoing.hand_motion import ServoArm
from drake_srg.types import AnyMode, Box, Cylinder, Failure, Mode

_RELAXING = 0.5  # time for the pull aside on a seated peg to fade [s]
NOT_INSERTED = (Failure.NO_HOLE, Failure.HOLE_BLOCKED, Failure.TOO_TIGHT)


def _then(strategy: str) -> Condition:
    """Return the condition that a mode has ended and this strategy comes next."""
    return lambda o, t, c: o.arrived and getattr(c, "strategy", "") == strategy


INSERT_TRANSITIONS: Table = {
    **TRANSITIONS,
    Mode.PLACE: carried(InsertMode.TILT),
    InsertMode.TILT: carried(InsertMode.SEARCH),
    InsertMode.SEARCH: [
        (lambda o, t, c: o.arrived and not o.holding, Mode.RELEASE),
        (_then("push"), InsertMode.PRESS),
        (_then("spiral"), InsertMode.SPIRAL),
        (_then("tilt"), InsertMode.SLIDE),
    ],
    InsertMode.SPIRAL: [
        (lambda o, t, c: o.stuck, InsertMode.WITHDRAW),
        *carried(InsertMode.PRESS),
    ],
    InsertMode.SLIDE: [
        (lambda o, t, c: o.stuck, InsertMode.WITHDRAW),
        *carried(InsertMode.UPRIGHT),
    ],
    InsertMode.UPRIGHT: carried(InsertMode.PRESS),
    InsertMode.PRESS: [
        (lambda o, t, c: o.arrived and o.at_goal, InsertMode.RELAX),
        *carried(InsertMode.WITHDRAW),
    ],
    InsertMode.RELAX: [(lambda o, t, c: o.arrived or t >= _RELAXING, Mode.RELEASE)],
    InsertMode.WITHDRAW: carried(InsertMode.TILT),
}
insert_transition = Transitions(INSERT_TRANSITIONS, (*FATAL, *NOT_INSERTED))


class InsertionPlanner(PickAndPlacePlanner):
    """Picks a peg like its base class, and inserts it into a hole.

    Its ports are those of `PickAndPlacePlanner`. Instead of setting the peg down, it
    carries the peg over the hole and moves set-points of a yielding arm: see the modes
    in `drake_srg.planning.insertion.modes`.

    Args:
        task_planner: Plans the motions.
        task: The task, with the seated peg as its goal.
        config: Forces, speeds and limits.

    Raises:
        ValueError: If the peg is neither cylinder nor box.
    """

    def __init__(
        self, task_planner: TaskPlanner, task: PickTask, config: Insert
    ) -> None:
        if not isinstance(task.shape, Cylinder | Box):
            raise ValueError(
                f"objects.{task.object_name}: must be a cylinder or a box to be "
                f"inserted, or have such a proxy, got {task.shape}"
            )
        arm = ServoArm(task_planner.scene.plant)
        known = Task(config, arm, task.shape, task.goal, task.tolerance)

        def make_modes(
            config: PlannerConfig, replanner: Replanner, repeat: int
        ) -> Mapping[AnyMode, TaskMode]:
            return {
                **task_modes(config, replanner, repeat),
                **{k.mode: k(known, replanner, repeat) for k in INSERTION_MODES},
            }

        above = RigidTransform([0.0, 0.0, config.depth + config.hover])
        super().__init__(
            task_planner,
            dc.replace(task, goal=above @ task.goal),
            config,
            make_modes=make_modes,
            transition=insert_transition,
            make_memory=InsertMemory,
        )
        self.task = task
