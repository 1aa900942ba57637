"""The linkage gripper's fingers in a pinch from above."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.planning.grasps.fingers import (
    Fingers,
    FingerState,
    filled_rectangle,
    lowest,
)
from drake_srg.planning.grasps.linkage_hand import (
    CRANK,
    EMPTY_ANGLE,
    OPEN_HALF_GAP,
    crank_angle,
    crank_joints,
    pads_ahead,
)
from drake_srg.types import Vector

# The fingertip: its end beyond the pad's middle, and its thickness [m]. Behind it are
# crank and rocker: their back from the pad's face, and their front before the pad's
# middle [m] (tools/models/linkage_pieces.py).
_END, _TIP, _BACK, _FRONT = 0.0094, 0.0085, 0.020, 0.016
# The hand is between the palm's origin and here where the pads do not reach [m].
_PALM_X, _PALM_HALF_WIDTH, _PALM_HALF_HEIGHT = 0.040, 0.030, 0.0145
# Crank angle by which a held thing must differ from an empty hand [rad].
_TELLABLE = 0.03


@dc.dataclass(frozen=True)
class LinkageFingers(Fingers):
    """The master-slave gripper: its pads stay parallel, so it takes narrow things.

    Args:
        tip_x: Palm x of the pads' middle, cranks straight ahead [m].
        full_scale: See `LinkageHand`.
    """

    tip_x: float = 0.095
    full_scale: float = 0.69

    max_width = 2.0 * OPEN_HALF_GAP - 0.008
    most_open = OPEN_HALF_GAP
    pad_width = 0.024
    palm_x = _PALM_X
    palm_size = (2.0 * _PALM_HALF_WIDTH, 2.0 * _PALM_HALF_HEIGHT)

    @property
    def deepest(self) -> float:  # type: ignore[override]  # it depends on a field
        """See `Fingers`: the cranks point straight ahead on the way."""
        return self.tip_x + _END

    def silhouette(self, half_gap: float, offsets: Vector) -> Vector:
        """See `Fingers`."""
        middle = self.tip_x - CRANK + pads_ahead(half_gap)
        fingers = [
            filled_rectangle(
                np.array([half_gap, 0.0]),
                np.array([depth, 0.0]),
                np.array([0.0, end]),
            )
            for depth, end in ((_TIP, middle + _END), (_BACK, middle - _FRONT))
        ]
        palm = np.where(np.abs(offsets) <= _PALM_HALF_WIDTH, self.palm_x, -np.inf)
        reach = lowest(np.concatenate(fingers), offsets, -np.inf)
        return np.fmax(reach, palm)

    def opened(self, half_gap: float) -> FingerState:
        """See `Fingers`."""
        angle = crank_angle(min(half_gap, OPEN_HALF_GAP))
        return FingerState(angle / self.full_scale, crank_joints(angle))

    def closed(self, width: float) -> FingerState:
        """See `Fingers`; they stop once both sense something."""
        return FingerState(1.0, crank_joints(crank_angle(0.5 * width)))

    def holds(self, width: float, q: Vector, proximity: Vector) -> bool:
        """See `Fingers`."""
        return bool(np.max(q) < 0.5 * (crank_angle(0.5 * width) + EMPTY_ANGLE))

    def tellable(self, width: float) -> bool:
        """See `Fingers`."""
        return EMPTY_ANGLE - crank_angle(0.5 * width) > _TELLABLE
