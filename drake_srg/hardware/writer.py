"""Commands to hardware as input ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pydrake.systems.framework import Context

from drake_srg.hardware.link import Link
from drake_srg.lifetime import LeafSystem


class HardwareWriter(LeafSystem):
    """Sends commands to links every period.

    .. pydrake_system::

        name: HardwareWriter
        input_ports:
        - ROOM.COMMAND (each command)

    Args:
        links: The links; each gets all commands.
        period: Time between commands [s].
        sizes: Of the commands, by name.
    """

    def __init__(
        self, links: Sequence[Link], period: float, sizes: Mapping[str, int]
    ) -> None:
        super().__init__()
        self._links, self._names = list(links), list(sizes)
        for name, size in sizes.items():
            self.DeclareVectorInputPort(name=name, size=size)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._send)

    def _send(self, context: Context) -> None:
        values = {name: self.GetInputPort(name).Eval(context) for name in self._names}
        for link in self._links:
            link.send(values)
