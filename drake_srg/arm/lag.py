"""Base of the external-torque estimators: sampling and a first-order lag."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

# Time constant of the estimate [s]. Contact forces that build up at the arm's top speed
# have 20 to 50 ms.
TIME_CONSTANT = 0.02


class LaggedTorque(LeafSystem):
    """Base of a system whose output `external_torque` follows samples with a lag.

    The output (N) is in N m. A subclass declares its input ports, calls
    `_declare_torque`, and implements `_sample`.

    Args:
        period: Of the samples [s].
        time_constant: Of the first-order lag [s].
    """

    def __init__(self, period: float, time_constant: float) -> None:
        super().__init__()
        self._period = period
        self._share = lag_share(period, time_constant)

    def _declare_torque(self, n: int, num_kept: int) -> None:
        """Declare the output of N = `n` torques, and the samples.

        Args:
            n: Number of joints.
            num_kept: Count of numbers that a sample keeps for the next one. They are
                NaN until the first sample.
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
        """Return the torque now, shape (N,) [N m], or None, and the numbers to keep."""
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
    """Return the share of a step that a first-order lag follows in a period [s]."""
    return float(-np.expm1(-period / time_constant))
