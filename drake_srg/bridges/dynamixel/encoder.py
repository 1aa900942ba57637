"""The encoder of a Dynamixel MX-64: angles and positions in counts."""

from __future__ import annotations

import dataclasses as dc
import math

from drake_srg.bridges.dynamixel.registers import TURN

_COUNTS = TURN / math.tau  # per rad


@dc.dataclass(frozen=True)
class Encoder:
    """Converts between angles and counts over all turns.

    Angles are positive clockwise, which lowers the position.

    Attributes:
        zero: Counts at angle 0.
    """

    zero: int

    def to_counts(self, angle: float) -> float:
        """Return the counts at an angle [rad]."""
        return self.zero - angle * _COUNTS

    def to_angle(self, counts: float) -> float:
        """Return the angle at counts [rad]."""
        return (self.zero - counts) / _COUNTS


# On the SRG's spool, which closing turns clockwise. Zero is the position with the
# fingers open and the wires taut. SAKE's 100 % are 2500 counts or 29.1 mm of wire,
# about what a finger needs for the full range of both joints (28.8 mm here); with this
# value the middle of that range is the middle of a turn. Calibration without an object
# ends where the pads meet, after 19.7 mm plus up to 1.7 mm by which the wires stretch
# under 43 N. The stretch relaxes while the zero is read, so the zero is at 1456 to 1537
# and the fingers are fully open at 70 to 74 %.
SPOOL = Encoder(3298)
# On a joint, whose range is usually on both sides of 0.
JOINT = Encoder(TURN // 2)
