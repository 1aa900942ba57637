"""Picking and placing with a visual servo for the grasp."""

from __future__ import annotations

import functools
from collections.abc import Mapping

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.planning.task.pick_and_place import PickAndPlacePlanner
from drake_srg.planning.task.task_motions import TaskPlanner
from drake_srg.servoing.servo_modes import (
    ServoSenses,
    servo_command,
    servo_modes,
    servo_transition,
)
from drake_srg.servoing.status import ServoCommand, ServoStatus
from drake_srg.types import Shape


class ServoingPlanner(PickAndPlacePlanner):
    """Picks and places like its base class, but leaves the grasp to a visual servo.

    .. pydrake_system::

        name: ServoingPlanner
        input_ports:
        - blobs
        - arm_state
        - gripper_state
        - grasped
        - proximity
        - obstacles (optional)
        - external_torque (optional)
        - servo_status
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status
        - servo_command

    The other ports are those of `PickAndPlacePlanner`. `servo_status` (ServoStatus) and
    `servo_command` (ServoCommand) connect to a `VisualServo`, which passes on
    `position_commanded` whenever it is not in charge.

    In front of the object, the planner hands over to the servo, and closes the fingers
    once that has reached the object. Meanwhile the servo follows the object as it last
    moved. Once the grasp is verified, the servo raises the hand a little and brakes,
    and the planner plans the rest of the cycle from there. If the servo fails, the
    planner draws the hand back, goes home and tries again.

    Args:
        task_planner: Plans the motions.
        object_name: Name of the blobs of the object to take.
        shape: The object's known shape.
        goal: Where the object must go, X_WO [m].
        tolerance: Distance from the goal that counts as placed [m].
        obstacles: Names and shapes of the other objects.
        repeat: How many cycles.
        config: Times, speeds and limits.
        time_limit: Time after which the servo counts as failed [s].
    """

    def __init__(
        self,
        task_planner: TaskPlanner,
        object_name: str,
        shape: Shape,
        goal: RigidTransform,
        tolerance: float = 0.005,
        obstacles: Mapping[str, Shape] | None = None,
        repeat: int = 1,
        config: PlannerConfig | None = None,
        time_limit: float = 6.0,
    ) -> None:
        super().__init__(
            task_planner,
            object_name,
            shape,
            goal,
            tolerance,
            obstacles,
            repeat,
            config,
            make_modes=functools.partial(servo_modes, time_limit=time_limit),
            transition=servo_transition,
        )
        self._servo = self.DeclareAbstractInputPort(
            name="servo_status", model_value=AbstractValue.Make(ServoStatus())
        )
        self.DeclareAbstractOutputPort(
            name="servo_command",
            alloc=lambda: AbstractValue.Make(ServoCommand.PASS),
            calc=self._calc_command,
            prerequisites_of_calc={self.state_ticket},
        )

    def sense(self, context: Context) -> ServoSenses:
        """Return the measurements, and what the servo reports."""
        senses = super().sense(context)
        return ServoSenses(**vars(senses), servo=self._servo.Eval(context))

    def _calc_command(self, context: Context, output: AbstractValue) -> None:
        state = self.state(context)
        output.set_value(servo_command(state.mode, state.memory))
