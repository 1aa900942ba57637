"""The planner that inserts a peg into a hole: its transitions and its system."""

from __future__ import annotations

from collections.abc import Mapping

from pydrake.math import RigidTransform

from drake_srg.common.geometry import Solid
from drake_srg.planning.insertion.config import Insert, InsertMemory, InsertMode, Task
from drake_srg.planning.insertion.modes import insertion_modes
from drake_srg.planning.pick_and_place.knowledge import FATAL, TRANSITIONS
from drake_srg.planning.pick_and_place.modes import TaskMode, task_modes
from drake_srg.planning.pick_and_place.planner import PickAndPlacePlanner
from drake_srg.planning.pick_and_place.replanning import Replanner
from drake_srg.planning.pick_and_place.task_motions import TaskPlanner
from drake_srg.planning.planner_machine import (
    Condition,
    Observation,
    PlannerConfig,
    Table,
    Transitions,
)
from drake_srg.planning.servoing.hand_motion import ServoArm
from drake_srg.types import AnyMode, Box, Cylinder, Failure, Mode

NOT_INSERTED = (Failure.NO_HOLE, Failure.HOLE_BLOCKED, Failure.TOO_TIGHT)


def _lost(o: Observation, t: float, c: PlannerConfig) -> bool:
    return o.arrived and not o.holding


def _then(strategy: str) -> Condition:
    """Return the condition that a mode has ended, with this strategy next."""
    return lambda o, t, c: o.arrived and getattr(c, "strategy", "") == strategy


def _ended(mode: AnyMode) -> list[tuple[Condition, AnyMode]]:
    """Return the row of a mode with one successor, unless the peg is lost."""
    return [(_lost, Mode.RELEASE), (lambda o, t, c: o.arrived, mode)]


INSERT_TRANSITIONS: Table = {
    **TRANSITIONS,
    Mode.PLACE: _ended(InsertMode.TILT),
    InsertMode.TILT: _ended(InsertMode.SEARCH),
    InsertMode.SEARCH: [
        (_lost, Mode.RELEASE),
        (_then("push"), InsertMode.PRESS),
        (_then("spiral"), InsertMode.SPIRAL),
        (_then("tilt"), InsertMode.SLIDE),
    ],
    InsertMode.SPIRAL: [
        (lambda o, t, c: o.stuck, InsertMode.WITHDRAW),
        *_ended(InsertMode.PRESS),
    ],
    InsertMode.SLIDE: [
        (lambda o, t, c: o.stuck, InsertMode.WITHDRAW),
        *_ended(InsertMode.UPRIGHT),
    ],
    InsertMode.UPRIGHT: _ended(InsertMode.PRESS),
    InsertMode.PRESS: [
        (lambda o, t, c: o.arrived and o.at_goal, Mode.RELEASE),
        *_ended(InsertMode.WITHDRAW),
    ],
    InsertMode.WITHDRAW: _ended(InsertMode.TILT),
}
insert_transition = Transitions(INSERT_TRANSITIONS, (*FATAL, *NOT_INSERTED))


class InsertionPlanner(PickAndPlacePlanner):
    """Picks a peg like its base class, and inserts it into a hole.

    Its ports are those of `PickAndPlacePlanner`. Instead of setting the peg down, it
    carries the peg over the hole and moves set-points of a yielding arm: see the modes
    in `drake_srg.planning.insertion.modes`.

    Args:
        task_planner: Plans the motions.
        object_name: Name of the peg.
        shape: Its shape.
        goal: The seated peg, X_WO [m].
        config: Forces, speeds and limits.
        tolerance: Distance from the goal that counts as placed [m].
        obstacles: Names and shapes of the other objects.
        repeat: Number of cycles.

    Raises:
        ValueError: If the peg is neither cylinder nor box.
    """

    def __init__(
        self,
        task_planner: TaskPlanner,
        object_name: str,
        shape: Solid,
        goal: RigidTransform,
        config: Insert,
        tolerance: float = 0.005,
        obstacles: Mapping[str, Solid] | None = None,
        repeat: int = 1,
    ) -> None:
        if not isinstance(shape, Cylinder | Box):
            raise ValueError(
                f"objects.{object_name}: must be a cylinder or a box to be inserted, "
                f"or have such a proxy, got {shape}"
            )
        arm = ServoArm(task_planner.scene.plant)
        task = Task(config, arm, shape, goal, tolerance)

        def make_modes(
            config: PlannerConfig, replanner: Replanner, repeat: int
        ) -> Mapping[AnyMode, TaskMode]:
            modes = task_modes(config, replanner, repeat)
            return insertion_modes(task, modes, replanner, repeat)

        above = RigidTransform([0.0, 0.0, config.depth + config.hover])
        super().__init__(
            task_planner,
            object_name,
            shape,
            above @ goal,
            tolerance,
            obstacles,
            repeat,
            config,
            make_modes=make_modes,
            transition=insert_transition,
            make_memory=InsertMemory,
        )
        self.goal = goal
