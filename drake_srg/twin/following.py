"""Makes a twin's arm follow a measured one without lag."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

# Over this time the lag is averaged [s].
_MEMORY = 2.0
# Mean square of the speed at which half of the lag is made up for [rad²/s² or m²/s²]:
# a resting arm tells nothing about it.
_SLOW = 1e-3
# A driver that lags by more is not made up for [s].
_LARGEST = 0.3


class LagCompensation(LeafSystem):
    """Commands an arm so that it is where another arm is measured.

    .. pydrake_system::

        name: LagCompensation
        input_ports:
        - state_measured
        - state
        output_ports:
        - position_commanded

    `state_measured` (2N), [q; v], is the arm to follow, `state` (2N) the one that is
    commanded [rad, rad/s or m, m/s]. A driver follows a steady motion with a constant
    lag L. So the command (N) is ahead by that: q + L v. The system finds L as the
    least-squares solution of `position_commanded - q = L v` over the last seconds of
    the commanded arm's own motion.

    Args:
        size: Number N of joints.
        period: Time between samples [s].
    """

    def __init__(self, size: int, period: float) -> None:
        super().__init__()
        self._n, self._share = size, float(-np.expm1(-period / _MEMORY))
        self._measured, self._own = (
            self.DeclareVectorInputPort(name=name, size=2 * size)
            for name in ("state_measured", "state")
        )
        # Means of (command - q) v and of v².
        self._means = int(self.DeclareDiscreteState(np.zeros(2)))
        self.DeclareVectorOutputPort(
            name="position_commanded", size=size, calc=self._calc_position
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def lag(self, context: Context) -> float:
        """Return the lag as it is known now [s]."""
        product, square = context.get_discrete_state(self._means).value()
        return float(np.clip(product / (square + _SLOW), 0.0, _LARGEST))

    def _command(self, context: Context) -> Vector:
        q, v = np.split(self._measured.Eval(context), 2)
        command: Vector = q + self.lag(context) * v
        return command

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._command(context))

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        q, v = np.split(self._own.Eval(context), 2)
        now = np.array([(self._command(context) - q) @ v, v @ v])
        means = context.get_discrete_state(self._means).value()
        discrete_state.set_value(self._means, means + self._share * (now - means))
