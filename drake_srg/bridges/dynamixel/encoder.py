"""The encoder of a Dynamixel MX-64: spool angles and positions in counts."""

from __future__ import annotations

import math

from drake_srg.bridges.dynamixel.registers import ControlTable

_COUNTS = 4096 / math.tau  # encoder counts per rad
# Encoder position with the fingers open and the wires taut. Closing turns clockwise,
# which lowers the position. SAKE's 100 % are 2500 counts or 29.1 mm of wire, about what
# a finger needs for the full range of both joints (28.8 mm here); with this value the
# middle of that range is the middle of a turn. Calibration without an object ends where
# the pads meet, after 19.7 mm plus up to 1.7 mm by which the wires stretch under 43 N.
# The stretch relaxes while the zero is read, so the zero is at 1456 to 1537 and the
# fingers are fully open at 70 to 74 %.
_OPEN = 3298


def encoder_position(table: ControlTable, angle: float) -> int:
    """Return the position register for a spool angle [rad]."""
    counts = _OPEN - angle * _COUNTS
    if table.multi_turn:
        return round(counts / table["resolution_divider"]) + table["multi_turn_offset"]
    return round(counts) % 4096


def goal_angle(table: ControlTable) -> float:
    """Return the spool angle [rad] of the goal position."""
    counts = table["goal_position"]
    if table.multi_turn:
        counts = (counts - table["multi_turn_offset"]) * table["resolution_divider"]
    return (_OPEN - counts) / _COUNTS
