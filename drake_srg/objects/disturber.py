"""The system that disturbs objects when its time has come."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.framework import Context, EventStatus, State

from drake_srg.common.shared import Shared
from drake_srg.lifetime import LeafSystem
from drake_srg.objects.disturbance_forces import Course, Target, Wrench, disturb
from drake_srg.objects.disturbances import AnyDisturbance, Topple
from drake_srg.types import Box, Cylinder, Mode


@dc.dataclass(frozen=True)
class _Memory(Shared):
    """State of the disturber."""

    courses: tuple[Course, ...]
    mode: Mode | None = None
    forces: tuple[ExternallyAppliedSpatialForce, ...] = ()


class Disturber(LeafSystem):
    """Applies a scenario's disturbances to its objects.

    .. pydrake_system::

        name: Disturber
        input_ports:
        - mode
        - object_poses
        output_ports:
        - object_forces

    `mode` (Mode) is the planner's. `object_poses` (dict[str, RigidTransform]) is X_WO
    by name [m]. `object_forces` (list[ExternallyAppliedSpatialForce]) goes to the plant
    and is updated every `period`. If a disturbance's mode begins again before the
    disturbance is over, the disturbance goes on and does not restart.

    Args:
        disturbances: Each disturbance with its object.
        period: Time between updates [s], preferably the plant's time step.

    Raises:
        ValueError: If an object cannot be toppled.
    """

    def __init__(
        self, disturbances: Sequence[tuple[AnyDisturbance, Target]], period: float
    ) -> None:
        super().__init__()
        self._period = period
        for disturbance, target in disturbances:
            falls = isinstance(target.shape, (Cylinder, Box))
            if isinstance(disturbance, Topple) and not falls:
                raise ValueError(
                    "disturbances: !Topple needs an object that is one cylinder or "
                    f"box, got {target.name!r}"
                )
        self._disturbances = list(disturbances)
        self._mode = self.DeclareAbstractInputPort(
            name="mode", model_value=AbstractValue.Make(Mode.IDLE)
        )
        self._poses = self.DeclareAbstractInputPort(
            name="object_poses", model_value=AbstractValue.Make({})
        )
        self._state = self.DeclareAbstractState(
            AbstractValue.Make(_Memory((Course(),) * len(disturbances)))
        )
        self.DeclareAbstractOutputPort(
            name="object_forces",
            alloc=lambda: AbstractValue.Make([ExternallyAppliedSpatialForce()]),
            calc=self._calc_object_forces,
            prerequisites_of_calc={self.abstract_state_ticket(self._state)},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _memory(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._state)).get_value()
        return memory

    def _calc_object_forces(self, context: Context, output: AbstractValue) -> None:
        output.set_value(list(self._memory(context).forces))

    def _update(self, context: Context, state: State) -> EventStatus:
        time, memory = context.get_time(), self._memory(context)
        mode: Mode = self._mode.Eval(context)
        courses, forces = [], []
        for (disturbance, target), last in zip(
            self._disturbances, memory.courses, strict=True
        ):
            course = last
            triggered = mode is not memory.mode and mode.value == disturbance.at
            waits = course.begin == np.inf and course.count < disturbance.times
            if triggered and waits:
                course = Course(course.count + 1, time + disturbance.after)
            # Times of updates are multiples of the period, up to rounding.
            t = time + 1e-9 - course.begin
            if t >= 0.0:
                X_WO = self._poses.Eval(context)[target.name]
                course, wrench = disturb(
                    disturbance, target, t, X_WO, course, self._period
                )
                if wrench is not None:
                    forces.append(_applied(target, wrench))
            courses.append(course)
        state.get_mutable_abstract_state(int(self._state)).set_value(
            _Memory(tuple(courses), mode, tuple(forces))
        )
        return EventStatus.Succeeded()


def _applied(target: Target, wrench: Wrench) -> ExternallyAppliedSpatialForce:
    force, torque, p_OQ = wrench
    applied = ExternallyAppliedSpatialForce()
    applied.body_index = target.body
    applied.p_BoBq_B = p_OQ
    applied.F_Bq_W = SpatialForce(tau=torque, f=force)
    return applied
