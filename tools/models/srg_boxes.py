"""The fast SRG: its links collide as a few boxes."""

from __future__ import annotations

import dataclasses as dc

from drake_srg.common.srg_geometry import SRG

from .pieces import Piece
from .srg_pieces import (
    BASE_THICKNESS,
    BASE_WIDTH,
    NOSE,
    PLATE_IN,
    PLATE_OUT,
    TIP_WIDTH,
    plastic_box,
)

# Collision boxes beside the pads, as lower and upper corners. The faces of base link
# and palm that hold an object are within 0.4 mm of the full model's, and so is the
# innermost line of the noses. Everything else is within 9 mm, half the width of the
# slot between the cheeks, which the tip's lug fills.
PALM_BOXES = {
    "palm_mount": ((0.0, -0.0265, -0.0265), (0.008, 0.0265, 0.0265)),
    "palm_body": ((0.008, -0.036, -PLATE_OUT), (0.060, 0.036, PLATE_OUT)),
    "palm_face": ((0.060, -0.0188, -PLATE_IN), (SRG.palm_face_x, 0.0188, PLATE_IN)),
    **{
        f"palm_{side}_{hand}_ear": ((0.060, y, z), (0.0775, y + 0.0177, z + 0.005))
        for side, z in (("upper", PLATE_IN), ("lower", -PLATE_OUT))
        for hand, y in (("left", 0.0188), ("right", -0.0365))
    },
    "palm_servo": (
        (0.0095, -0.0201, -SRG.palm_height / 2),
        (0.0555, 0.0201, -PLATE_OUT),
    ),
    "palm_spool_cover": (
        (0.020, -0.014, PLATE_OUT),
        (0.048, 0.014, SRG.palm_height / 2),
    ),
}
_BASE_BACK = SRG.face_offset - BASE_THICKNESS
_PAD_BACK = SRG.face_offset - SRG.pad_thickness
_BASE_HALF, _TIP_HALF = BASE_WIDTH / 2, TIP_WIDTH / 2
_NOSE_HALF = 0.0022  # reaches 0.3 mm beyond the nose's circle
BASE_BOXES = {
    "base_body": (
        (-0.006, _BASE_BACK, -_BASE_HALF),
        (0.0375, SRG.face_offset, _BASE_HALF),
    ),
    "base_cheeks": (
        (0.0375, _BASE_BACK + 0.003, -_BASE_HALF),
        (SRG.base_length + 0.007, 0.0046, _BASE_HALF),
    ),
    "base_upper_nose": (
        (SRG.base_length - _NOSE_HALF, -NOSE, _TIP_HALF + 0.0005),
        (SRG.base_length + _NOSE_HALF, NOSE, _BASE_HALF),
    ),
    "base_lower_nose": (
        (SRG.base_length - _NOSE_HALF, -NOSE, -_BASE_HALF),
        (SRG.base_length + _NOSE_HALF, NOSE, -_TIP_HALF - 0.0005),
    ),
}
TIP_BOXES = {
    "tip_nose": ((-_NOSE_HALF, -NOSE, -_TIP_HALF), (_NOSE_HALF, NOSE, _TIP_HALF)),
    "tip_spine": ((-0.007, _PAD_BACK - 0.006, -_TIP_HALF), (0.024, 0.004, _TIP_HALF)),
    "tip_carrier": (
        (SRG.pad_end - SRG.pad_length, _PAD_BACK - 0.003, -SRG.pad_width / 2),
        (SRG.pad_end, _PAD_BACK, SRG.pad_width / 2),
    ),
}


def in_boxes(pieces: list[Piece], boxes: dict[str, tuple[tuple, tuple]]) -> list[Piece]:
    """Return the pieces with all visuals; only the pad and the boxes collide."""
    seen = [p if p.name == "pad" else dc.replace(p, collision=None) for p in pieces]
    return seen + [
        dc.replace(plastic_box(name, "shell", low, high, 0.0), look=None)
        for name, (low, high) in boxes.items()
    ]
