"""Holes for pegs: a block with a round hole, and a block without one.

The origin is the middle of the rim, z up. A hole is made of boxes tangent to its
circle, and a floor. They have point contact alone, so that a fit of a hundredth of a
millimetre keeps its width: hydroelastic contact at the moduli of rubber and tableware
would be softer than the clearance. The peg is any analytic cylinder.
"""

from __future__ import annotations

import numpy as np

from .pieces import Piece, Primitive, Proximity, box_piece
from .sdf import Files, Model
from .shapes import disc, prism

DIAMETERS = (0.025, 0.012)
DEPTH, FLOOR = 0.020, 0.010  # of the hole, and of the block below it [m]
HALF = 0.035  # half of the block's width [m]
SIDES = 24

# In contact, the rim gives way by force / (half of this): 0.4 um at 20 N. A corner is
# rounded off by as much.
CONTACT = Proximity(rigid=None, friction=0.35, dissipation=10.0, point_stiffness=1e8)
LOOKS = {"top": (0.62, 0.64, 0.66), "hole": (0.2, 0.2, 0.22)}


def _hole(diameter: float) -> Files:
    radius = 0.5 * diameter
    # A circle between the flats has this much more room towards the corners.
    error = 1e6 * radius * (1.0 / np.cos(np.pi / SIDES) - 1.0)
    name = f"hole_{round(1e3 * diameter)}"
    model = Model(
        name,
        LOOKS,
        f"A block with a hole of {1e3 * diameter:.0f} mm, {1e3 * DEPTH:.0f} mm deep; "
        "the origin is the middle of\nits rim. "
        f"{SIDES} flats touch the circle; the corners between them are "
        f"{error:.0f} um\nfarther out. A peg that is thinner by a radial clearance c "
        "has at most\n"
        f"c / cos(pi / {SIDES}) = {1 / np.cos(np.pi / SIDES):.4f} c to move.",
    )
    thick = HALF - radius
    width = 2.0 * HALF * np.tan(np.pi / SIDES)
    pieces = []
    circle = disc(radius / np.cos(np.pi / SIDES), count=SIDES)
    for i in range(SIDES):
        angle = 2.0 * np.pi * (i + 0.5) / SIDES
        middle = (radius + 0.5 * thick) * np.array([np.cos(angle), np.sin(angle)])
        box = Primitive(
            "box",
            (thick, width, DEPTH + FLOOR),
            (middle[0], middle[1], -0.5 * (DEPTH + FLOOR)),
            (0.0, 0.0, angle),
        )
        j = (i + 1) % SIDES
        outer = circle * (HALF / radius * np.cos(np.pi / SIDES))
        outline = np.array([circle[i], outer[i], outer[j], circle[j]])
        seen = prism(outline, -DEPTH - FLOOR, 0.0)
        pieces.append(Piece(f"wall_{i}", "top", seen, box, CONTACT))
    low, high = -DEPTH - FLOOR, -DEPTH
    floor = Primitive("box", (2 * radius, 2 * radius, FLOOR), (0, 0, (low + high) / 2))
    seen = prism(disc(radius + 0.001, count=SIDES), low, high)
    pieces.append(Piece("floor", "hole", seen, floor, CONTACT))
    model.AddLink("block", pieces, None)
    return model.finish(f"sdf/{name}.sdf")


def build() -> Files:
    """Return the files of the holes, and of the block that has none."""
    blank = Model("hole_none", LOOKS, "A block without a hole; see hole_25.sdf.")
    corners = (-HALF, -HALF, -DEPTH - FLOOR), (HALF, HALF, 0.0)
    blank.AddLink("block", [box_piece("top", "top", *corners, 0.0, CONTACT)], None)
    files = blank.finish("sdf/hole_none.sdf")
    for diameter in DIAMETERS:
        files |= _hole(diameter)
    return files
