"""The SRG's fingers in grasps from above."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.planning.grasps.fingers import (
    Fingers,
    FingerState,
    Wrap,
    filled_rectangle,
    lowest,
)
from drake_srg.planning.grasps.srg_angles import (
    ends_gap,
    finger_joints,
    pinch_angles,
    straight_base_angle,
    wrap_angles,
)
from drake_srg.types import Vector

# Backs of base link and tip, from the line through the hinges, and how far the base
# link goes beyond its hinges [m] (srg_fast.sdf).
_BASE_BACK, _TIP_BACK, _HOUSING = 0.0128, 0.0088, 0.006
# The pads' ends of an empty hand press 2 to 3 mm into each other, also when its tips
# have turned. A larger gap than this means that something is between them [m].
_LEAST_GAP = 0.0013
# A straight finger's tip is turned by less than this, for 4 mm at its end [rad].
_STRAIGHT = 0.05
# By how much a height map shows things too wide, at most [m].
_BLUR = 0.004
# `squeeze` of wraps [rad]: three times the planner's default. With it, all flat boxes
# hold (docs/experiments.md, grasp_width).
_WRAP_SQUEEZE = 1.2


@dc.dataclass(frozen=True)
class SrgFingers(Fingers):
    """The SRG: straight fingers close, then the pads turn onto the object.

    Args:
        squeeze: See `SrgHand`.
        full_scale: See `SrgHand`.
    """

    squeeze: float = 0.6
    full_scale: float = SRG.full_scale

    # Of the edges of the ends of straight fingers.
    deepest = SRG.hinge_x + float(np.hypot(SRG.finger_length, SRG.face_offset))
    # The pads of a wider opening would not be parallel.
    max_width = SRG.parallel_gap - 0.01
    most_open = 0.1
    pad_width = SRG.pad_width
    palm_x = 0.0775  # of its ears
    palm_size = (SRG.palm_width, SRG.palm_height)
    wrap = Wrap(
        half_gap=SRG.hinge_y + SRG.finger_length,
        hinge_x=SRG.hinge_x,
        hinge_y=SRG.hinge_y + SRG.base_length,
        radius=float(np.hypot(SRG.pad_end, SRG.face_offset)),
        face_x=SRG.hinge_x + SRG.face_offset,
        # Flat boxes hold with anything from -1 to 10 mm, and boxes are held by their
        # upper edges up to 170 mm (docs/experiments.md, grasp_width).
        gap=0.006,
        widths=(max_width - _BLUR, 0.165),
    )

    def silhouette(self, half_gap: float, offsets: Vector) -> Vector:
        """See `Fingers`."""
        base = straight_base_angle(half_gap)
        along = np.array([np.cos(base), np.sin(base)])  # in |y|, x
        inwards = np.array([-np.sin(base), np.cos(base)])
        hinge = np.array([SRG.hinge_y, SRG.hinge_x])
        finger = np.concatenate(
            [
                filled_rectangle(
                    hinge + start * along - back * inwards,
                    (end - start) * along,
                    (SRG.face_offset + back) * inwards,
                )
                for start, end, back in (
                    (-_HOUSING, SRG.base_length + _HOUSING, _BASE_BACK),
                    (SRG.base_length, SRG.finger_length, _TIP_BACK),
                )
            ]
        )
        palm = np.abs(offsets) <= 0.5 * SRG.palm_width
        reach = lowest(finger, offsets, -np.inf)
        return np.where(palm, np.fmax(reach, self.palm_x), reach)

    def opened(self, half_gap: float) -> FingerState:
        """See `Fingers`."""
        base = max(straight_base_angle(half_gap), 0.0)
        return FingerState(base / self.full_scale, finger_joints(base, 0.0))

    def closed(self, width: float) -> FingerState:
        """See `Fingers`."""
        base, tip = pinch_angles(0.5 * width)
        return self._pressing(base, tip, self.squeeze)

    def wrapped(self, width: float) -> FingerState:
        """See `Fingers`."""
        base, tip = wrap_angles(0.5 * width, self.wrap.gap)
        return self._pressing(base, tip, _WRAP_SQUEEZE)

    def _pressing(self, base: float, tip: float, squeeze: float) -> FingerState:
        closure = (base + tip + squeeze) / self.full_scale
        return FingerState(min(1.0, closure), finger_joints(base, tip))

    def holds(self, width: float, q: Vector, proximity: Vector) -> bool:
        """See `Fingers`; the base links come first in `q`.

        The width says little, because a height map shows things wider or narrower than
        they are. So there only has to be something between the ends of the pads. What
        is enclosed above ends that meet is not told.
        """
        return ends_gap(q) > _LEAST_GAP

    def straight(self, q: Vector) -> bool:
        """See `Fingers`; the tips come last in `q`."""
        return bool(np.max(q[2:]) < _STRAIGHT)

    def tellable(self, width: float) -> bool:
        """See `Fingers`."""
        return width - _BLUR > 2.0 * _LEAST_GAP
