"""Measurements of hardware as output ports."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.bridges.commands import PortValues
from drake_srg.hardware.link import STAMP, Link
from drake_srg.lifetime import LeafSystem


class HardwareReader(LeafSystem):
    """Outputs what links have measured, and when something last arrived.

    .. pydrake_system::

        name: HardwareReader
        output_ports:
        - ROOM.MEASUREMENT (each of the links)
        - heartbeat
        - hardware.stamp

    Every `period`, the links are asked for what is new; what is not, keeps its value.
    `heartbeat` (1) is the time [s] at which the link that has been silent for longest
    last delivered anything. `hardware.stamp` (1) is the newest time by the robot's
    clock [s].

    Args:
        links: The links.
        period: Time between readings [s].
        start: Values before anything arrives, by port; others are NaN.
    """

    def __init__(
        self, links: Sequence[Link], period: float, start: PortValues | None = None
    ) -> None:
        super().__init__()
        self._links = list(links)
        start = start or {}
        sizes = {name: n for link in links for name, n in link.outputs.items()}
        self._states = {}
        for name, size in {**sizes, STAMP: 1}.items():
            value = start.get(name, np.full(size, np.nan))
            index = self.DeclareDiscreteState(value)
            self.DeclareStateOutputPort(name, index)
            self._states[name] = int(index)
        # When each link last delivered; it had done so when the station was built.
        self._heard = int(self.DeclareDiscreteState(np.zeros(len(self._links))))
        self.DeclareVectorOutputPort(
            name="heartbeat",
            size=1,
            calc=self._calc_heartbeat,
            prerequisites_of_calc={self.xd_ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _calc_heartbeat(self, context: Context, output: BasicVector) -> None:
        output[0] = np.min(context.get_discrete_state(self._heard).value())

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        for i, link in enumerate(self._links):
            values = link.take()
            for name, value in values.items():
                discrete_state.set_value(self._states[name], value)
            if values:
                heard = discrete_state.get_mutable_value(self._heard)
                heard[i] = context.get_time()
