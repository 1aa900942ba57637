"""Faults of a wire, to try out what a run makes of them."""

import dataclasses as dc
from collections import deque
from collections.abc import Callable

import numpy as np

from drake_srg.bridges.commands import PortValues
from drake_srg.hardware.link import Link


@dc.dataclass(kw_only=True)
class FaultsConfig:
    """Latency and loss that a wire of its own does not have."""

    # Added to measurements and to commands [s], in whole control periods.
    latency: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Share of messages that get lost, in both directions.
    loss: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 1.0})
    seed: int = dc.field(default=0, metadata={"ge": 0})


class FaultyLink(Link):
    """A link that delivers late, or not at all.

    Args:
        link: The link without faults.
        config: The faults.
        period: Time between calls [s].
    """

    def __init__(self, link: Link, config: FaultsConfig, period: float) -> None:
        self.outputs = link.outputs
        self.lag = link.lag + 2.0 * config.latency
        self._link = link
        self._random = np.random.default_rng(config.seed)
        self._loss = config.loss
        late = round(config.latency / period)
        self._taken: deque[PortValues] = deque([{}] * late)
        self._sent: deque[PortValues | None] = deque([None] * late)

    def take(self) -> PortValues:
        """See `Link`."""
        self._taken.append(self._pass(self._link.take) or {})
        return self._taken.popleft()

    def send(self, commands: PortValues) -> None:
        """See `Link`."""
        self._sent.append(self._pass(lambda: commands))
        due = self._sent.popleft()
        if due is not None:
            self._link.send(due)

    def close(self) -> None:
        """See `Link`."""
        self._link.close()

    def _pass(self, get: Callable[[], PortValues]) -> PortValues | None:
        """Return a message, or None if it gets lost."""
        values = get()
        return None if self._random.random() < self._loss else values
