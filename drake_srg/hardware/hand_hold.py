"""Halts a gripper for as long as the arm is stopped."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.common.safety_states import SafetyState, safety_state
from drake_srg.lifetime import LeafSystem


class HandHold(LeafSystem):
    """Keeps a gripper's command while the arm is stopped, and tells it to hold.

    .. pydrake_system::

        name: HandHold
        input_ports:
        - closure_commanded
        - safety_state
        output_ports:
        - closure_allowed
        - hold

    `closure_commanded` (1) is 0 open .. 1 closed, `safety_state` (2) that of a
    `SafetyMonitor`. While the arm runs, the command passes. Otherwise `closure_allowed`
    (1) is the last one from before, and `hold` (1) is 1: the gripper is to stay where
    it is and keep its grip.

    Args:
        period: The control period [s].
    """

    def __init__(self, period: float) -> None:
        super().__init__()
        self._commanded = self.DeclareVectorInputPort(name="closure_commanded", size=1)
        self._safety = self.DeclareVectorInputPort(name="safety_state", size=2)
        self._kept = int(self.DeclareDiscreteState(np.zeros(1)))
        self.DeclareVectorOutputPort(
            name="closure_allowed", size=1, calc=self._calc_closure
        )
        self.DeclareVectorOutputPort(
            name="hold",
            size=1,
            calc=self._calc_hold,
            prerequisites_of_calc={self._safety.ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _runs(self, context: Context) -> bool:
        state, _ = safety_state(self._safety.Eval(context))
        return state is SafetyState.RUNNING

    def _calc_closure(self, context: Context, output: BasicVector) -> None:
        if self._runs(context):
            output.SetFromVector(self._commanded.Eval(context))
        else:
            output.SetFromVector(context.get_discrete_state(self._kept).value())

    def _calc_hold(self, context: Context, output: BasicVector) -> None:
        output[0] = 0.0 if self._runs(context) else 1.0

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        if self._runs(context):
            discrete_state.set_value(self._kept, self._commanded.Eval(context))
