"""A one-shot grasp in a cell, in place of a planner: look, come down, close, lift."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import Context, EventStatus, State

from drake_srg.common.minimum_jerk import minimum_jerk_blend
from drake_srg.envs.grasp_one_shot import (
    CLOSE,
    DOWN,
    UP,
    Grasp,
    grasp_of,
    one_shot_state,
)
from drake_srg.envs.hand_task import SHAKE
from drake_srg.envs.movers import Mover
from drake_srg.envs.physics import CONTROL_PERIOD
from drake_srg.learning.episodes import Act
from drake_srg.lifetime import LeafSystem
from drake_srg.planning.planner_outputs import AddPlannerOutputs
from drake_srg.simulation.bench import shake
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
# Greatest mean speed of the hand on its way over the object [m/s, rad/s]: at its peak,
# a minimum-jerk motion is 1.9 times as fast, which is that of the environments.
_SPEED = np.array([0.2, 0.2, 0.2, 1.0])
_UPRIGHT = np.cos(np.deg2rad(15.0))  # as far as a localizer's boxes may lean


@dc.dataclass(frozen=True, eq=False)
class _Memory:
    """What the planner remembers.

    Attributes:
        q: Commanded positions of the arm's joints, shape (N,).
        before: The same one period ago.
        ticks: Control periods since the start.
        begun: The tick at which the object was found.
        grasp: What to do; None before that.
        status: What is reported.
    """

    q: Vector
    before: Vector
    ticks: int = 0
    begun: int = 0
    grasp: Grasp | None = None
    status: PlannerStatus = dc.field(default_factory=PlannerStatus)


class GraspPlanner(LeafSystem):
    """Grasps, lifts and shakes an object by a policy of `GraspOneShot`.

    .. pydrake_system::

        name: GraspPlanner
        input_ports:
        - blobs
        output_ports:
        - position_commanded
        - closure_commanded
        - mode
        - status

    The policy sees the object's size and acts once, when `blobs` (list[Blob]) shows the
    object for the first time. From then on everything is as in the environment: the
    hand comes down from above, closes, lifts and shakes. Every control period of the
    environments, `position_commanded` (N) moves on to its next value; it is linear in
    between. `closure_commanded` (1) is 0 .. 1. `mode` (Mode) and `status`
    (PlannerStatus) end as DONE, whether or not the hand holds anything, or as FAILED if
    no blob shows the object standing.

    Args:
        act: The policy: a `Policy`, or a rule of `drake_srg.learning.rules`.
        mover: Of the arm; see `drake_srg.envs.movers.MakeMover`.
        home: Positions of the arm's joints at the start, shape (N,).
        name: Of the object.
        shape: Of the object, about the origin of its frame.
        table: Height of the table [m].
    """

    def __init__(
        self,
        act: Act,
        mover: Mover,
        home: Sequence[float],
        name: str,
        shape: Shape,
        table: float,
    ) -> None:
        super().__init__()
        self._act, self._mover, self._name = act, mover, name
        self._shape, self._table = shape, table
        q = np.array(home, float)
        self._start = mover.pose(q)
        self._blobs = self.DeclareAbstractInputPort(
            "blobs", AbstractValue.Make(list[Blob]())
        )
        index = self.DeclareAbstractState(AbstractValue.Make(_Memory(q, q)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(CONTROL_PERIOD, 0.0, self._update)
        tickets = {self.abstract_state_ticket(index)}
        AddPlannerOutputs(
            self,
            len(q),
            position=lambda c, out: out.SetFromVector(self._position(c)),
            closure=lambda c, out: out.SetFromVector([self._closure(self._memory(c))]),
            status=lambda c, out: out.set_value(self._memory(c).status),
            prerequisites=tickets,
        )
        self.DeclareAbstractOutputPort(
            name="mode",
            alloc=lambda: AbstractValue.Make(Mode.IDLE),
            calc=lambda c, out: out.set_value(self._memory(c).status.mode),
            prerequisites_of_calc=tickets,
        )

    def _memory(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(0).get_value()
        return memory

    def _position(self, context: Context) -> Vector:
        memory = self._memory(context)
        share = context.get_time() / CONTROL_PERIOD - (memory.ticks - 1)
        share = min(max(share, 0.0), 1.0)
        q: Vector = memory.before + share * (memory.q - memory.before)
        return q

    def _closure(self, memory: _Memory) -> float:
        if memory.grasp is None or memory.status.mode is Mode.PRE_GRASP:
            return 0.0
        down = memory.status.mode is Mode.GRASP
        return memory.grasp.preshape if down else memory.grasp.closure

    def _update(self, context: Context, state: State) -> EventStatus:
        memory = self._memory(context)
        memory = dc.replace(memory, ticks=memory.ticks + 1, before=memory.q)
        if memory.grasp is None and memory.status.mode is not Mode.FAILED:
            memory = self._look(context, memory)
        if memory.grasp is not None:
            mode, pose = self._motion(memory.grasp, memory.ticks - memory.begun)
            memory = dc.replace(
                memory,
                q=self._mover.follow(memory.q, pose),
                status=dc.replace(memory.status, mode=mode),
            )
        state.get_mutable_abstract_state(0).set_value(memory)
        return EventStatus.Succeeded()

    def _look(self, context: Context, memory: _Memory) -> _Memory:
        """Let the policy act on what is seen, or give up."""
        time = context.get_time()
        seen = tuple(self._blobs.Eval(context))
        blobs = [b for b in seen if b.object_name == self._name]
        blob = max(blobs, key=lambda b: (b.certain, b.trust), default=None)
        status = dc.replace(memory.status, looks=memory.status.looks + 1, blobs=seen)
        if blob is None or blob.axis[2] < _UPRIGHT:
            if time >= _PATIENCE:
                what = "does not stand" if blob else "is not seen"
                status = dc.replace(
                    status,
                    mode=Mode.FAILED,
                    failure=Failure.NOT_SEEN,
                    message=f"{self._name} {what}",
                )
            return dc.replace(memory, status=status)
        yaw = RollPitchYaw(blob.X_WO.rotation()).yaw_angle()
        round_ = isinstance(self._shape, Cylinder)
        estimate = np.append(blob.position, 0.0 if round_ else yaw)
        action = self._act(one_shot_state(self._shape))
        return dc.replace(
            memory,
            begun=memory.ticks,
            grasp=grasp_of(action, estimate, self._table),
            status=dc.replace(status, attempts=1, localization=blob, localized_at=time),
        )

    def _motion(self, grasp: Grasp, tick: int) -> tuple[Mode, Vector]:
        """Return what the hand does, and its pose (4), so many ticks after the look."""
        acceleration, frequency, duration = SHAKE
        far = np.abs(grasp.over - self._start) / _SPEED
        ticks = (np.ceil(far.max() / CONTROL_PERIOD), DOWN, CLOSE, UP)
        modes = (Mode.PRE_GRASP, Mode.GRASP, Mode.CLOSE, Mode.LIFT)
        poses = (self._start, grasp.over, grasp.at, grasp.at, grasp.up)
        for i, mode in enumerate(modes):
            if tick <= ticks[i]:
                share = minimum_jerk_blend(tick / max(ticks[i], 1))
                return mode, poses[i] + share * (poses[i + 1] - poses[i])
            tick -= int(ticks[i])
        time = tick * CONTROL_PERIOD
        if time <= duration:
            motion = shake(grasp.up, acceleration, frequency, duration)
            return Mode.VERIFY, motion(time)
        return Mode.DONE, grasp.up
