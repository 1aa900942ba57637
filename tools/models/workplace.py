"""The workplace of the five-axis arm: a bench with two small tables on it.

A table's origin is the middle of its top. The bench's origin is on its top, under joint
1 of the arm. The arm's mounting plane is 80 mm above the bench because the shoulder's
axis lies in that plane: the pedestal and the turntable need the room below it. The
tables stand on risers of the same height.
"""

from __future__ import annotations

import functools

import numpy as np

from .pieces import Piece, box_piece
from .props import WOOD
from .sdf import Files, Model
from .shapes import disc, prism

# From the thesis [m].
SIZE, HEIGHT = 0.2, 0.1
RECESS_DEPTH = 0.005
CYLINDER_RADIUS, CLEARANCE = 0.0125, 0.001
RISER = 0.080  # from the bench up to the arm's mounting plane

# All warm, far from the cylinder's bluish (0.85, 0.85, 1.0).
LOOKS = {
    "top": (0.77, 0.65, 0.47),
    "riser": (0.36, 0.33, 0.29),
    "recess": (0.55, 0.42, 0.27),
    "bench": (0.50, 0.49, 0.44),
    "legs": (0.28, 0.28, 0.27),
}

# Sides of the recess. Its flats touch the nominal circle, its corners are 0.03 mm
# outside.
_SIDES = 48
_COLLAR = 0.02  # half the width of the square of wedges around the recess


_box = functools.partial(box_piece, bevel=0.001, proximity=WOOD)


def _table(name: str, top: list[Piece], below: float, comment: str) -> Files:
    """Return a table: the pieces of its top, a block up to `below` the top, a riser."""
    model = Model(name, LOOKS, comment)
    half, foot = SIZE / 2, 0.06
    pieces = [
        *top,
        _box("block", "top", (-half, -half, -HEIGHT), (half, half, -below)),
        _box(
            "riser",
            "riser",
            (-foot, -foot, -HEIGHT - RISER),
            (foot, foot, -HEIGHT),
        ),
    ]
    model.AddLink("table", pieces, None)
    model.AddFrame("table_top", "table")
    return model.finish(f"sdf/{name}.sdf")


def _recess() -> list[Piece]:
    """Return what surrounds the recess: a ring of wedges, then four boxes."""
    radius = (CYLINDER_RADIUS + CLEARANCE) / np.cos(np.pi / _SIDES)
    # Wedges meet at the corners of the square and at the middles of its sides.
    circle = disc(radius, count=_SIDES)
    square = circle * (_COLLAR / np.max(np.abs(circle), axis=1, keepdims=True))
    low, high = -RECESS_DEPTH, 0.0
    pieces = []
    for i in range(_SIDES):
        j = (i + 1) % _SIDES
        outline = np.array([circle[i], square[i], square[j], circle[j]])
        wedge = prism(outline, low, high)
        pieces.append(Piece(f"wedge_{i}", "top", wedge, wedge, WOOD))
    half = SIZE / 2
    for sign, side in ((-1, "right"), (1, "left")):
        y0, y1 = sorted((sign * _COLLAR, sign * half))
        pieces.append(_box(side, "top", (-half, y0, low), (half, y1, high), bevel=0))
    for sign, side in ((-1, "rear"), (1, "front")):
        x0, x1 = sorted((sign * _COLLAR, sign * half))
        corners = (x0, -_COLLAR, low), (x1, _COLLAR, high)
        pieces.append(_box(side, "top", *corners, bevel=0))
    floor = prism(disc(radius + 0.001, count=_SIDES), low - 0.0005, low + 0.00005)
    return [*pieces, Piece("floor", "recess", floor)]


def bench() -> Files:
    """Return the bench; its top is z = 0, with the arm's pedestal at the origin."""
    model = Model("bench", LOOKS, "A bench; its top is z = 0.")
    # Covers the arm's reach of 0.48 m to the front (-x) and to the left (+y).
    x0, y0, x1, y1 = -0.58, -0.30, 0.32, 0.56
    pieces = [_box("bench_top", "bench", (x0, y0, -0.04), (x1, y1, 0), bevel=0.0015)]
    for x in (x0 + 0.06, x1 - 0.06):
        for y in (y0 + 0.06, y1 - 0.06):
            name = f"bench_leg_{'rear' if x > 0 else 'front'}_"
            name += "left" if y > 0 else "right"
            # Down to the floor, 0.75 m below the world's origin.
            low, high = (x - 0.03, y - 0.03, -0.67), (x + 0.03, y + 0.03, -0.04)
            pieces.append(_box(name, "legs", low, high, bevel=0.0015))
    model.AddLink("bench", pieces, None)
    model.AddFrame("bench_top", "bench")
    return model.finish("sdf/bench.sdf")


def build() -> Files:
    """Return the files of the workplace."""
    plain = "A small table on a riser; the origin is the middle of its top."
    recess = "A small table with a round recess in the middle of its top, the origin."
    return {
        **_table("small_table", [], 0.0, plain),
        **_table("small_table_recess", _recess(), RECESS_DEPTH, recess),
        **bench(),
    }
