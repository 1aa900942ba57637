"""A planner that thinks elsewhere, with a visual servo here."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Mapping

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from drake_srg.hardware.exchange import PlannerLink, Tick
from drake_srg.hardware.remote_planner import RemotePlanner
from drake_srg.servoing.sightings import Sighting
from drake_srg.servoing.status import ServoCommand, ServoStatus
from drake_srg.types import Vector

# Without an answer for so long, a servo must not go on [s]. The planner answers every
# period unless it plans, and it does that only while the hand rests.
_PATIENCE = 0.5


class RemoteServoingPlanner(RemotePlanner):
    """Stands in for a `ServoingPlanner` in another process, where the tracker is, too.

    .. pydrake_system::

        name: RemoteServoingPlanner
        input_ports:
        - ROOM.MEASUREMENT (each of the station)
        - safety.state (optional)
        - arm.position_held (optional)
        - servo_status
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status
        - servo_command
        - sighting

    The other ports are those of `RemotePlanner`. `servo_status` (ServoStatus) goes to
    the planner with every tick. `servo_command` (ServoCommand) and `sighting` (a
    Sighting with its stamp, NaN unless the servo tracks) come with its answers. While
    the arm is stopped, and where the planner ends or does not answer for half a second,
    a servo that is in charge is told to hold.

    Args:
        planner: The connection.
        home: Where the arm rests at first, shape (N,) [rad].
        sizes: Of the measurements, by name.
        period: Time between commands [s].
        planner_period: The planner's own period [s].
        patience: Longest time for a plan [s].
    """

    def __init__(
        self,
        planner: PlannerLink,
        home: Vector,
        sizes: Mapping[str, int],
        period: float,
        planner_period: float,
        patience: float = math.inf,
    ) -> None:
        super().__init__(planner, home, sizes, period, planner_period, patience)
        self._servo = self.DeclareAbstractInputPort(
            name="servo_status", model_value=AbstractValue.Make(ServoStatus())
        )
        self.DeclareAbstractOutputPort(
            name="servo_command",
            alloc=lambda: AbstractValue.Make(ServoCommand.PASS),
            calc=self._calc_command,
            prerequisites_of_calc={self.plan_ticket, self.time_ticket()},
        )
        self.DeclareAbstractOutputPort(
            name="sighting",
            alloc=lambda: AbstractValue.Make(Sighting()),
            calc=self._calc_sighting,
            prerequisites_of_calc={self.plan_ticket},
        )

    def tick(self, context: Context) -> Tick:
        """Return what the planner gets to know now."""
        return dc.replace(super().tick(context), servo=self._servo.Eval(context))

    def _calc_command(self, context: Context, output: AbstractValue) -> None:
        plan = self.plan(context)
        silent = context.get_time() - plan.answered > _PATIENCE
        command = plan.command
        if command is not ServoCommand.PASS and (silent or plan.pause is not None):
            command = ServoCommand.HOLD
        output.set_value(command)

    def _calc_sighting(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self.plan(context).sighting or Sighting())
