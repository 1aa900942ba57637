"""Geometry of the linkage gripper's links.

Every finger link has x along the link (fingertip and coupler: along the palm's x), y
inwards (the closing side) and z along the hinges, so that both fingers share their
meshes. Lengths in metres.
"""

from __future__ import annotations

import dataclasses as dc
import functools

import numpy as np

from .pieces import Piece, Primitive, Proximity, box_piece, extruded_piece
from .shapes import block, disc, hull_2d, prism, rot_x, rot_z

# The fingers hold the middle of a 25 mm cylinder here on the palm's x axis.
PALM_TO_TIP = 0.095
OBJECT_RADIUS = 0.0125
# The servo's case, 26 mm along its shaft (ROBOTIS e-Manual, XL330).
SERVO_LENGTH, SERVO_WIDTH = 0.034, 0.020
SERVO_SHAFT = 0.0095  # shaft to the case's near end

# The crank points straight ahead when the fingers hold the cylinder. There the
# fingertips reach farthest and move purely sideways.
CRANK = 0.045  # crank and rocker, hinge to hinge
HINGE_X, HINGE_Y = 0.028, 0.017  # palm to crank hinge
ROCKER = 0.010  # crank hinge to rocker hinge, outwards
OPEN_HALF_GAP = 0.030
OPEN_ANGLE = float(np.arcsin((OPEN_HALF_GAP - OBJECT_RADIUS) / CRANK))  # rad, outwards
CRANK_RANGE = (0.0, 0.69)  # the pads of flat fingertips meet at 0.681 rad
PAD_X = PALM_TO_TIP - HINGE_X - CRANK  # pad's middle, ahead of the crank's pin
PAD_FACE = HINGE_Y - OBJECT_RADIUS  # innermost (flat) or deepest (curved), inwards
PAD_LENGTH, PAD_THICKNESS, PAD_HALF = 0.018, 0.0025, 0.012
# Three boxes, each covering 27 degrees of the cylinder. The arc ends 8 mm in front of
# and behind the middle, so that the fingertips stay within 9.5 mm of it. Five boxes
# hold no better and cost a quarter more simulation time.
ARC_BOXES, ARC_STEP = 3, np.radians(80 / 3)

# Heights above the middle plane of the hinges: servo, plates of the palm, plates of
# crank and rocker. Pin heads end at 14 mm.
_SERVO_HALF, _PLATE, _FORK = 0.0115, 0.0125, 0.0135
_LUG_HALF = 0.0123  # fingertip and coupler, between the plates of crank and rocker
_LUG = 0.004  # radius around a pin

LOOKS = {
    "frame": (0.20, 0.21, 0.23),
    "servo": (0.08, 0.08, 0.085),
    "link": (0.85, 0.36, 0.06),
    "metal": (0.45, 0.45, 0.46),
    "wedge": (0.85, 0.36, 0.06),
    "flat_pad": (0.07, 0.07, 0.075),
    "curved_pad": (0.07, 0.07, 0.075),
}

# Printed plastic on a can or on itself: handbooks give 0.3 to 0.5.
PLASTIC = Proximity(rigid=True, friction=0.4, resolution=0.005)


def rubber(finger: str) -> Proximity:
    """Return the SRG's pad rubber, a tenth stiffer on the slave.

    Real pads differ, and Drake's convex integrator aborts on exactly symmetric contact.
    """
    modulus = {"master": 2.0e6, "slave": 2.2e6}[finger]
    return Proximity(rigid=False, friction=0.8, modulus=modulus, dissipation=5.0)


def bare_plastic(finger: str) -> Proximity:
    """Return a smooth printed face without rubber, the same on both fingers.

    With a cylinder's own 0.5 to 0.8, Drake's rule (the harmonic mean) makes 0.29 to
    0.32 of it: the smooth end of what handbooks give for plastic on plastic.
    """
    return dc.replace(PLASTIC, friction=0.2)


_box = functools.partial(box_piece, proximity=PLASTIC)
_extruded = functools.partial(extruded_piece, bevel=0.0004, proximity=PLASTIC)


def _head(name: str, x: float, y: float, z0: float, s: int) -> Piece:
    """Return the head of a pin or a screw, without collision geometry."""
    z0, z1 = sorted((s * (z0 - 0.0004), s * (z0 + 0.0005)))
    return Piece(name, "metal", prism(disc(0.0022, (x, y), 16), z0, z1, 0.0002))


def palm_pieces() -> list[Piece]:
    """Return the palm: +x points out of it, the fingers' hinges are along z."""
    front = HINGE_X + SERVO_SHAFT
    rear = front - SERVO_LENGTH
    side = HINGE_Y + SERVO_WIDTH / 2
    inner = HINGE_Y - SERVO_WIDTH / 2
    pieces = [
        _box("palm_mount", "frame", (0, -0.020, -0.0125), (rear, 0.020, 0.0125), 8e-4),
        _box(
            "palm_spine", "frame",
            (rear, -inner, -_SERVO_HALF), (0.031, inner, _SERVO_HALF), 6e-4,
        ),
    ]  # fmt: skip
    for hand, h in (("master", 1), ("slave", -1)):
        low, high = sorted((h * (inner + 2e-4), h * side))
        pieces.append(
            _box(
                f"palm_{hand}_servo", "servo",
                (rear + 2e-4, low, -_SERVO_HALF), (front, high, _SERVO_HALF), 1e-3,
            )
        )  # fmt: skip
    plate = np.array(
        [(x, y) for x in (rear, front - 0.002) for y in (-side + 0.004, side - 0.004)]
        + [(x, y) for x in (rear + 0.006, front - 0.006) for y in (-side, side)]
    )
    for level, s in (("upper", 1), ("lower", -1)):
        z0, z1 = sorted((s * _SERVO_HALF, s * _PLATE))
        pieces.append(_extruded(f"palm_{level}_plate", "frame", plate, z0, z1))
        for hand, h in (("master", 1), ("slave", -1)):
            ear = hull_2d(
                disc(_LUG, (HINGE_X, h * (HINGE_Y + ROCKER)), 20),
                np.array([(x, h * (side - 0.008)) for x in (0.014, front - 0.004)]),
            )
            pieces.append(_extruded(f"palm_{level}_{hand}_ear", "frame", ear, z0, z1))
            for x, y in ((0.009, 0.009), (0.009, 0.022), (0.017, 0.011)):
                pieces.append(_head("palm_screw", x, h * y, _PLATE, s))
    return pieces


def bar_pieces(name: str) -> list[Piece]:
    """Return a crank or a rocker: two plates with a web between them."""
    outline = hull_2d(disc(_LUG, count=24), disc(_LUG, (CRANK, 0), 24))
    # Clears the servo's case behind it and the lugs in front.
    web = (0.0135, -0.0025, -_PLATE), (CRANK - 0.0065, 0.0025, _PLATE)
    pieces = [_box(f"{name}_web", "link", *web, 0.0008)]
    for level, s in (("upper", 1), ("lower", -1)):
        z0, z1 = sorted((s * _PLATE, s * _FORK))
        pieces.append(_extruded(f"{name}_{level}_plate", "link", outline, z0, z1))
        pieces += [_head(f"{name}_pin", x, 0.0, _FORK, s) for x in (0.0, CRANK)]
    return pieces


def tip_pieces(curved: bool, material: Proximity) -> list[Piece]:
    """Return a fingertip: the coupler half at the crank's pin, a carrier and a pad.

    Args:
        curved: Whether the pad is cut to the cylinder.
        material: Material of the pad.
    """
    back = PAD_FACE - PAD_THICKNESS
    x0, x1 = PAD_X - 0.0094, PAD_X + 0.0094
    seam = -ROCKER / 2 + 1e-4
    lug = hull_2d(disc(_LUG, count=24), np.array([(-_LUG, seam), (_LUG, seam)]))
    arm = np.array([(-0.001, -0.0035), (0.0, 0.0038), (x0, back), (x0, -0.003)])
    carrier = (x0, -0.003, -PAD_HALF), (x1, back, PAD_HALF)
    pieces = [
        _extruded("tip_lug", "link", lug, -_LUG_HALF, _LUG_HALF),
        _extruded("tip_arm", "link", arm, -0.0085, 0.0085),
        _box("tip_carrier", "link", *carrier, 6e-4),
    ]
    for z in (-0.007, 0.007):
        head = prism(disc(0.0015, count=12), -4e-4, 5e-4, 2e-4)
        head = head.moved(rot_x(np.pi / 2), (PAD_X, -0.003, z))
        pieces.append(Piece("tip_screw", "metal", head))
    return pieces + (_arc_pads(material) if curved else [_flat_pad(material)])


def _flat_pad(material: Proximity) -> Piece:
    half, back = PAD_LENGTH / 2, PAD_FACE - PAD_THICKNESS
    low = (PAD_X - half, back, -PAD_HALF)
    high = (PAD_X + half, PAD_FACE, PAD_HALF)
    pad = _box("pad", "flat_pad", low, high, 5e-4)
    return dc.replace(pad, proximity=material)


def _arc_pads(material: Proximity) -> list[Piece]:
    """Return boxes whose faces touch the cylinder, and the wedges behind them."""
    middle = np.array([PAD_X, PAD_FACE + OBJECT_RADIUS, 0.0])
    width = 2 * OBJECT_RADIUS * np.tan(ARC_STEP / 2)
    size = (width, PAD_THICKNESS, 2 * PAD_HALF)
    half = np.array(size) / 2
    pieces = []
    for i in range(ARC_BOXES):
        angle = (i - (ARC_BOXES - 1) / 2) * ARC_STEP
        R = rot_z(angle)
        p = middle - R @ np.array([0.0, OBJECT_RADIUS + PAD_THICKNESS / 2, 0.0])
        box = Primitive("box", size, tuple(np.round(p, 7)), (0.0, 0.0, angle))
        seen = block(-half, half).moved(R, p)
        pieces.append(Piece(f"pad_{i + 1}", "curved_pad", seen, box, material))
    # Behind the outer boxes, which lean away from the carrier.
    back = PAD_FACE - PAD_THICKNESS
    for end, s in (("rear", -1), ("front", 1)):
        offsets = [(0.0043, 0.0), (0.0094, 0.0), (0.0094, 0.0030)]
        wedge = np.array([(PAD_X + s * x, back + y) for x, y in offsets])
        name = f"tip_{end}_wedge"
        pieces.append(_extruded(name, "wedge", hull_2d(wedge), -PAD_HALF, PAD_HALF))
    return pieces


def coupler_pieces() -> list[Piece]:
    """Return the coupler half at the rocker's pin."""
    seam = ROCKER / 2 - 1e-4
    outline = hull_2d(disc(_LUG, count=24), np.array([(-_LUG, seam), (_LUG, seam)]))
    return [_extruded("coupler_lug", "link", outline, -_LUG_HALF, _LUG_HALF)]
