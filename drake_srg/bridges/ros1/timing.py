"""How long a ROS 1 node waits, and how often it tries again."""

from __future__ import annotations

import dataclasses as dc


@dc.dataclass(frozen=True)
class Timing:
    """Waiting times of a ROS 1 node [s, real].

    Attributes:
        poll: Between checks that the master still knows the node.
        retry: Before a publisher is tried again; doubles after each failure.
        retry_max: Upper limit of `retry`.
        handshake: For a peer to send its connection header.
        goodbye: For all goodbyes to the master together.
    """

    poll: float = 1.0
    retry: float = 0.5
    retry_max: float = 4.0
    handshake: float = 5.0
    goodbye: float = 0.5
