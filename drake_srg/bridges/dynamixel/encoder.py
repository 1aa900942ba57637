"""The encoder of a Dynamixel MX-64: spool angles and positions in counts."""

from __future__ import annotations

import math

TURN = 4096  # counts
_COUNTS = TURN / math.tau  # per rad
# Encoder position with the fingers open and the wires taut. Closing turns clockwise,
# which lowers the position. SAKE's 100 % are 2500 counts or 29.1 mm of wire, about what
# a finger needs for the full range of both joints (28.8 mm here); with this value the
# middle of that range is the middle of a turn. Calibration without an object ends where
# the pads meet, after 19.7 mm plus up to 1.7 mm by which the wires stretch under 43 N.
# The stretch relaxes while the zero is read, so the zero is at 1456 to 1537 and the
# fingers are fully open at 70 to 74 %.
_OPEN = 3298


def to_counts(angle: float) -> float:
    """Return the encoder's counts at a spool angle [rad], over all turns."""
    return _OPEN - angle * _COUNTS


def to_angle(counts: float) -> float:
    """Return the spool angle [rad] at counts of the encoder, over all turns."""
    return (_OPEN - counts) / _COUNTS
