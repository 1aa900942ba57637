"""What all that tells external torques has in common: samples, and a lag."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

# Time constant of the estimate [s]: that of contact forces which a motion at the arm's
# top speed builds up is 20 to 50 ms.
TIME_CONSTANT = 0.02


class LaggedTorque(LeafSystem):
    """A system whose output `external_torque` (N) [N m] follows samples with a lag.

    Those who derive from it declare their input ports, then call `_declare_torque`, and
    say in `_sample` what is felt.

    Args:
        period: Of the samples [s].
        time_constant: Of the lag, of first order [s].
    """

    def __init__(self, period: float, time_constant: float) -> None:
        super().__init__()
        self._period = period
        self._share = lag_share(period, time_constant)

    def _declare_torque(self, n: int, num_kept: int) -> None:
        """Declare the output of N = `n` torques, and the samples.

        Args:
            n: Number of joints.
            num_kept: How many numbers one sample keeps for the next. They are NaN
                until there is one.
        """
        self._num_kept = num_kept
        state = self.DeclareDiscreteState(
            np.concatenate([np.full(num_kept, np.nan), np.zeros(n)])
        )
        self.DeclareVectorOutputPort(
            name="external_torque",
            size=n,
            calc=self._calc_external_torque,
            prerequisites_of_calc={self.discrete_state_ticket(state)},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self._period, offset_sec=0.0, update=self._update
        )

    def _sample(self, context: Context, kept: Vector) -> tuple[Vector | None, Vector]:
        """Return what is felt now, (N) [N m] or None, and what to keep."""
        raise NotImplementedError

    def _calc_external_torque(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(0).value()[self._num_kept :])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        state = context.get_discrete_state(0).value()
        kept, torque = state[: self._num_kept], state[self._num_kept :]
        felt, kept = self._sample(context, kept)
        if felt is not None:
            torque = torque + self._share * (felt - torque)
        discrete_state.set_value(np.concatenate([kept, torque]))


def lag_share(period: float, time_constant: float = TIME_CONSTANT) -> float:
    """Share of a step that a first-order lag follows in a period [s]."""
    return float(-np.expm1(-period / time_constant))
