"""Measured torques of an arm against what its twin expects."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector


class TorqueComparison(LeafSystem):
    """Tells which torques a twin expects, and what is left of the measured ones.

    .. pydrake_system::

        name: TorqueComparison
        input_ports:
        - torque_measured
        - external_felt
        - external_expected
        output_ports:
        - torque_expected
        - torque_residual

    All ports have N entries [N m]. The motors must bring up what the measured motion
    needs by inverse dynamics, less the torques from outside:

        torque_measured = needed - external_felt,
        torque_expected = needed - external_expected,
        torque_residual = torque_measured - torque_expected.

    So `external_felt` are the external torques that explain the measurement (see
    `ExternalTorqueObserver`), and `external_expected` those of the contacts that the
    twin simulates, such as the weight of a carried object. The outputs are NaN where
    `torque_measured` is: nobody tells it.

    Args:
        size: Number N of joints.
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        self._measured, self._felt, self._expected = (
            self.DeclareVectorInputPort(name=name, size=size)
            for name in ("torque_measured", "external_felt", "external_expected")
        )
        ports = (self._measured, self._felt, self._expected)
        tickets = {port.ticket() for port in ports}
        self.DeclareVectorOutputPort(
            name="torque_expected",
            size=size,
            calc=self._calc_expected,
            prerequisites_of_calc=tickets,
        )
        self.DeclareVectorOutputPort(
            name="torque_residual",
            size=size,
            calc=self._calc_residual,
            prerequisites_of_calc=tickets,
        )

    def _residual(self, context: Context) -> Vector:
        residual: Vector = self._expected.Eval(context) - self._felt.Eval(context)
        told = np.isfinite(self._measured.Eval(context))
        return np.where(told, residual, np.nan)

    def _calc_expected(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._measured.Eval(context) - self._residual(context))

    def _calc_residual(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._residual(context))
