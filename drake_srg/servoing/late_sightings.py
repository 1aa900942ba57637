"""Sightings that arrive late, with where the arm was when they were taken."""

from __future__ import annotations

import dataclasses as dc
import math

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, State

from drake_srg.lifetime import LeafSystem
from drake_srg.servoing.arm_history import ArmHistory
from drake_srg.servoing.sightings import Sighting, Taken

_NOTHING = Sighting(taken=Taken())


@dc.dataclass(frozen=True)
class _Seen:
    """The history of the arm, and the newest sighting within it."""

    arm: ArmHistory
    sighting: Sighting


class LateSightings(LeafSystem):
    """Looks up where the arm was when a picture was taken.

    .. pydrake_system::

        name: LateSightings
        input_ports:
        - sighting
        - arm_state
        - arm_stamp
        output_ports:
        - sighting

    The input `sighting` (a Sighting) has its `stamp`. `arm_state` (2N), [q; v] in rad
    and rad/s, was measured at `arm_stamp` (1) by the same clock [s]. The output
    `sighting` is the newest one for which there are measurements of the arm, from
    before and after it, with `taken` filled in. Until there is one, and as long as the
    input's stamp is NaN, it is one of nothing, taken at minus infinity.

    Args:
        num_joints: N.
        period: Time between updates [s].
        span: How late a sighting may be [s].
    """

    def __init__(self, num_joints: int, period: float, span: float = 1.0) -> None:
        super().__init__()
        self._n, self._span = num_joints, span
        self._late = self.DeclareAbstractInputPort(
            name="sighting", model_value=AbstractValue.Make(Sighting())
        )
        self._measured = self.DeclareVectorInputPort("arm_state", 2 * num_joints)
        self._stamp = self.DeclareVectorInputPort("arm_stamp", 1)
        start = _Seen(ArmHistory(), _NOTHING)
        self._state = self.DeclareAbstractState(AbstractValue.Make(start))
        self.DeclareAbstractOutputPort(
            name="sighting",
            alloc=lambda: AbstractValue.Make(_NOTHING),
            calc=self._calc_sighting,
            prerequisites_of_calc={self.abstract_state_ticket(self._state)},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _seen(self, context: Context) -> _Seen:
        seen: _Seen = context.get_abstract_state(int(self._state)).get_value()
        return seen

    def _calc_sighting(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._seen(context).sighting)

    def _update(self, context: Context, state: State) -> EventStatus:
        seen = self._seen(context)
        arm = seen.arm.followed_by(
            self._stamp.Eval(context)[0],
            context.get_time(),
            self._measured.Eval(context)[: self._n],
            self._span,
        )
        new = _Seen(arm, self._newest(seen.sighting, self._late.Eval(context), arm))
        state.get_mutable_abstract_state(int(self._state)).set_value(new)
        return EventStatus.Succeeded()

    def _newest(self, known: Sighting, late: Sighting, arm: ArmHistory) -> Sighting:
        if math.isnan(late.stamp):
            return _NOTHING
        taken = None if late.stamp == known.stamp else arm.at(late.stamp)
        return known if taken is None else dc.replace(late, taken=taken)
