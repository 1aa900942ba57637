"""Joint angles at which the SRG's links meet an object."""

from __future__ import annotations

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.types import Vector

# The open hand leaves this much room on each side of an object [m].
_CLEARANCE = 0.012


def finger_joints(base: float, tip: float) -> dict[str, float]:
    """Return the joint angles of both fingers, alike, by name [rad]."""
    angles = {"base": base, "tip": tip}
    sides = ("left", "right")
    return {f"{side}_{link}_joint": angles[link] for side in sides for link in angles}


def opening_angle(half_width: float, depth: float) -> float | None:
    """Return the base angle at which straight fingers clear an object [rad].

    Args:
        half_width: Of the object [m].
        depth: Where the object begins in the palm's x [m].

    Returns:
        None if the object is too wide.
    """
    along = max(depth - SRG.hinge_x, 0.0)
    need = half_width + _CLEARANCE - SRG.hinge_y
    angles = np.linspace(0.0, 0.5 * np.pi, 200)
    gaps = along * np.cos(angles) - SRG.face_offset * np.sin(angles)
    fitting = angles[gaps >= need]
    return float(fitting[-1]) if len(fitting) else None


def pinch_angles(half_width: float) -> tuple[float, float]:
    """Return the base and tip angles of pads that lie on a thing's vertical sides.

    Half the gap between vertical pads is
    hinge_y + base_length cos(base) - face_offset.

    Args:
        half_width: Half of the thing's width [m].
    """
    cosine = (half_width - SRG.hinge_y + SRG.face_offset) / SRG.base_length
    base = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    tip = 0.5 * np.pi - base
    if tip < 0.0:  # so thin that straight fingers meet it with their ends
        return straight_base_angle(half_width), 0.0
    return base, tip


def wrap_angles(half_width: float, gap: float) -> tuple[float, float]:
    """Return the base and tip angles of a hand over the top of a wide thing.

    The base links are open. The faces of the tips meet the thing's upper edges, or are
    vertical if it is narrower than the space between them.

    Args:
        half_width: Half of the thing's width [m].
        gap: Between the base links and its top, at least 0 [m].
    """
    beyond = half_width - SRG.hinge_y - SRG.base_length
    p_edge = np.array([SRG.face_offset + gap, beyond])
    tip = contact_angle(p_edge, 0.0)
    assert tip is not None  # the edge is no nearer to the hinge than the face
    return 0.0, min(tip, 0.5 * np.pi)


def straight_base_angle(half_gap: float) -> float:
    """Return the base angle at which the ends of straight fingers leave a gap [rad].

    Half the gap is hinge_y + finger_length cos(base) - face_offset sin(base).

    Args:
        half_gap: Half of the gap [m].
    """
    reach = np.hypot(SRG.finger_length, SRG.face_offset)
    phase = np.arctan2(SRG.face_offset, SRG.finger_length)
    return float(np.arccos((half_gap - SRG.hinge_y) / reach) - phase)


def ends_gap(q: Vector) -> float:
    """Return the gap between the ends of the pads [m]; below 0, they press together.

    Half of it is hinge_y + base_length cos(base) + pad_end cos(base + tip)
    - face_offset sin(base + tip) where both fingers are alike.

    Args:
        q: Angles of both base joints, then of both tip joints, shape (4,) [rad].
    """
    base, pad = q[:2], q[:2] + q[2:4]
    halves = SRG.hinge_y + SRG.base_length * np.cos(base)
    halves += SRG.pad_end * np.cos(pad) - SRG.face_offset * np.sin(pad)
    return float(np.sum(halves))


# Base angle at which the fingertips of an empty hand meet [rad].
EMPTY_BASE_ANGLE = straight_base_angle(0.0)


def contact_angle(p: Vector, radius: float) -> float | None:
    """Return the angle at which a closing link's face meets a circle [rad].

    The distance of the face from the circle's centre is
    p_x cos(angle) - p_y sin(angle) - face_offset. The link closes on the side where
    that falls.

    Args:
        p: The circle's centre from the link's hinge, (x, y) of the left finger [m].
        radius: Of the circle [m].

    Returns:
        None if the face does not meet the circle.
    """
    cosine = float((radius + SRG.face_offset) / np.linalg.norm(p))
    if cosine > 1.0:
        return None
    return float(np.arccos(cosine) - np.arctan2(p[1], p[0]))
