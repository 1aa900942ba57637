"""What the planners that act by a policy share: they look once, and then act."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import BasicVector, Context, EventStatus, State

from drake_srg.common.minimum_jerk import minimum_jerk_blend
from drake_srg.envs.movers import Mover
from drake_srg.envs.physics import CONTROL_PERIOD
from drake_srg.lifetime import LeafSystem
from drake_srg.planning.planner_machine import AddPlannerOutputs
from drake_srg.types import (
    Blob,
    Cylinder,
    Failure,
    Mode,
    PlannerStatus,
    Shape,
    Vector,
)

# How long the localizer may take to find the object [s].
_PATIENCE = 1.0
# Greatest mean speed of the hand on its way [m/s, rad/s]: at its peak, a minimum-jerk
# motion is 1.9 times as fast, which is that of the environments.
_SPEED = np.array([0.2, 0.2, 0.2, 1.0])
_UPRIGHT = np.cos(np.deg2rad(15.0))  # as far as a localizer's boxes may lean


@dc.dataclass(frozen=True, eq=False)
class Command:
    """What the hand does until the next control period.

    Attributes:
        mode: As reported; DONE and FAILED end the attempt.
        pose: Of the hand, [x, y, z, yaw], shape (4,) [m, rad].
        closure: 0 open .. 1 closed.
        message: Why it has failed.
    """

    mode: Mode
    pose: Vector
    closure: float = 0.0
    message: str = ""


@dc.dataclass(frozen=True, eq=False)
class _Memory:
    """What the planner remembers.

    Attributes:
        q: Commanded positions of the arm's joints, shape (N,).
        before: The same one period ago.
        ticks: Control periods since the start.
        closure: Commanded.
        attempt: What the subclass remembers; None before the object was found.
        status: What is reported.
    """

    q: Vector
    before: Vector
    ticks: int = 0
    closure: float = 0.0
    attempt: Any = None
    status: PlannerStatus = dc.field(default_factory=PlannerStatus)


class CellPlanner(LeafSystem):
    """Base of planners that act by a policy once they have seen the object.

    The input `blobs` (list[Blob]) shows it, from home. Every control period of the
    environments, `position_commanded` (N) moves on to its next value; it is linear in
    between. `closure_commanded` (1) is 0 .. 1. `mode` (Mode) and `status`
    (PlannerStatus) end as DONE, whether or not the hand holds anything, or as FAILED:
    `not_seen` if no blob shows the object standing, `time_budget` if the policy has not
    come to an end.

    Args:
        mover: Of the arm; see `drake_srg.envs.movers.MakeMover`.
        home: Positions of the arm's joints at the start, shape (N,).
        name: Of the object.
        shape: Of the object, about the origin of its frame.
        table: Height of the table [m].
    """

    def __init__(
        self, mover: Mover, home: Sequence[float], name: str, shape: Shape, table: float
    ) -> None:
        super().__init__()
        self.mover, self.name, self.shape, self.table = mover, name, shape, table
        q = np.array(home, float)
        self.start = mover.pose(q)
        self._blobs = self.DeclareAbstractInputPort(
            "blobs", AbstractValue.Make(list[Blob]())
        )
        index = self.DeclareAbstractState(AbstractValue.Make(_Memory(q, q)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(CONTROL_PERIOD, 0.0, self._update)
        tickets = {self.abstract_state_ticket(index)}
        AddPlannerOutputs(
            self,
            len(q),
            position=self._calc_position,
            closure=self._calc_closure,
            status=self._calc_status,
            prerequisites=tickets,
        )
        self.DeclareAbstractOutputPort(
            name="mode",
            alloc=lambda: AbstractValue.Make(Mode.IDLE),
            calc=self._calc_mode,
            prerequisites_of_calc=tickets,
        )

    def begin(self, estimate: Vector) -> Any:
        """Return what is remembered of the attempt at an object.

        Args:
            estimate: Where it was seen, [x, y, z, yaw] of its centre in world, shape
                (4,) [m, rad].
        """
        raise NotImplementedError

    def act(self, context: Context, attempt: Any) -> tuple[Any, Command]:
        """Return the attempt one control period on, and what to do until then.

        It is not called again after a command that ends the attempt.
        """
        raise NotImplementedError

    def _memory(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(0).get_value()
        return memory

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        memory = self._memory(context)
        share = context.get_time() / CONTROL_PERIOD - (memory.ticks - 1)
        share = min(max(share, 0.0), 1.0)
        output.SetFromVector(memory.before + share * (memory.q - memory.before))

    def _calc_closure(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._memory(context).closure])

    def _calc_status(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._memory(context).status)

    def _calc_mode(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._memory(context).status.mode)

    def _update(self, context: Context, state: State) -> EventStatus:
        memory = self._memory(context)
        memory = dc.replace(memory, ticks=memory.ticks + 1, before=memory.q)
        ended = memory.status.mode in (Mode.DONE, Mode.FAILED)
        if memory.attempt is None and not ended:
            memory = self._look(context, memory)
        if memory.attempt is not None and not ended:
            attempt, command = self.act(context, memory.attempt)
            failed = Failure.TIME_BUDGET if command.mode is Mode.FAILED else None
            status = dc.replace(
                memory.status,
                mode=command.mode,
                failure=failed,
                message=command.message,
            )
            memory = dc.replace(
                memory,
                q=self.mover.follow(memory.q, command.pose),
                closure=command.closure,
                attempt=attempt,
                status=status,
            )
        state.get_mutable_abstract_state(0).set_value(memory)
        return EventStatus.Succeeded()

    def _look(self, context: Context, memory: _Memory) -> _Memory:
        """Begin an attempt at what is seen, or give up."""
        time = context.get_time()
        seen = tuple(self._blobs.Eval(context))
        blobs = [b for b in seen if b.object_name == self.name]
        blob = max(blobs, key=lambda b: (b.certain, b.trust), default=None)
        status = dc.replace(memory.status, looks=memory.status.looks + 1, blobs=seen)
        if blob is None or blob.axis[2] < _UPRIGHT:
            if time >= _PATIENCE:
                what = "does not stand" if blob else "is not seen"
                status = dc.replace(
                    status,
                    mode=Mode.FAILED,
                    failure=Failure.NOT_SEEN,
                    message=f"{self.name} {what}",
                )
            return dc.replace(memory, status=status)
        yaw = RollPitchYaw(blob.X_WO.rotation()).yaw_angle()
        round_ = isinstance(self.shape, Cylinder)
        return dc.replace(
            memory,
            attempt=self.begin(np.append(blob.position, 0.0 if round_ else yaw)),
            status=dc.replace(status, attempts=1, localization=blob, localized_at=time),
        )


def ticks_between(start: Vector, end: Vector) -> int:
    """Return how many control periods a motion between two poses (4) takes."""
    return math.ceil(np.max(np.abs(end - start) / _SPEED) / CONTROL_PERIOD)


def between(start: Vector, end: Vector, tick: int, ticks: int) -> Vector:
    """Return the pose (4) at a control period of a motion that takes `ticks` ones."""
    pose: Vector = start + minimum_jerk_blend(tick / max(ticks, 1)) * (end - start)
    return pose
