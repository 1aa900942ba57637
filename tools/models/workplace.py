"""The workplace of the five-axis arm: a bench, and two small tables on it.

A table's origin is the middle of its top; the bench's is on its top, under joint 1 of
the arm. The arm's mounting plane is 80 mm above the bench: the shoulder's axis lies in
that plane, so the pedestal and the turntable need the room below it. The tables stand
on risers of the same height.
"""

from __future__ import annotations

import numpy as np

from .props import WOOD
from .sdf import Files, Model, Piece, Primitive
from .shapes import block, disc, prism

# From the thesis [m].
SIZE, HEIGHT = 0.2, 0.1
RECESS_DEPTH = 0.005
CYLINDER_RADIUS, CLEARANCE = 0.0125, 0.001
RISER = 0.080  # the bench is that much below the arm's mounting plane

# None is near the cylinder's (0.85, 0.85, 1.0); all are warm, it is bluish.
LOOKS = {
    "top": (0.77, 0.65, 0.47),
    "riser": (0.36, 0.33, 0.29),
    "recess": (0.55, 0.42, 0.27),
    "bench": (0.50, 0.49, 0.44),
    "legs": (0.28, 0.28, 0.27),
}

# Sides of the recess. The flats keep its radius, the corners are 0.03 mm outside it.
_SIDES = 48
_COLLAR = 0.02  # half the width of the square that is cut into wedges around it


def _box(
    name: str,
    look: str,
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    bevel: float = 0.001,
) -> Piece:
    a, b = np.array(low), np.array(high)
    shape = Primitive("box", tuple(b - a), tuple((a + b) / 2))
    return Piece(name, look, block(low, high, bevel), shape, WOOD)


def _table(name: str, top: list[Piece], below: float, comment: str) -> Files:
    """Returns a table: its top's pieces, a block up to `below` them, and the riser."""
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
    """Returns what surrounds the recess: wedges, and four boxes around these."""
    radius = (CYLINDER_RADIUS + CLEARANCE) / np.cos(np.pi / _SIDES)
    # A wedge ends in the middle of each side of the square and in each corner.
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
        pieces.append(_box(side, "top", (-half, y0, low), (half, y1, high), 0))
    for sign, side in ((-1, "rear"), (1, "front")):
        x0, x1 = sorted((sign * _COLLAR, sign * half))
        corners = (x0, -_COLLAR, low), (x1, _COLLAR, high)
        pieces.append(_box(side, "top", *corners, 0))
    floor = prism(disc(radius + 0.001, count=_SIDES), low - 0.0005, low + 0.00005)
    return [*pieces, Piece("floor", "recess", floor)]


def bench() -> Files:
    """Returns the bench: its top is z = 0, the arm's pedestal stands at the origin."""
    model = Model("bench", LOOKS, "A bench; its top is z = 0.")
    # Around the arm's reach of 0.48 m in front (-x) and at its left (+y).
    x0, y0, x1, y1 = -0.58, -0.30, 0.32, 0.56
    pieces = [_box("bench_top", "bench", (x0, y0, -0.04), (x1, y1, 0), 0.0015)]
    for x in (x0 + 0.06, x1 - 0.06):
        for y in (y0 + 0.06, y1 - 0.06):
            name = f"bench_leg_{'rear' if x > 0 else 'front'}_"
            name += "left" if y > 0 else "right"
            # Down to the floor, 0.75 m below the world's origin.
            low, high = (x - 0.03, y - 0.03, -0.67), (x + 0.03, y + 0.03, -0.04)
            pieces.append(_box(name, "legs", low, high, 0.0015))
    model.AddLink("bench", pieces, None)
    model.AddFrame("bench_top", "bench")
    return model.finish("sdf/bench.sdf")


def build() -> Files:
    """Returns the files of the workplace."""
    plain = "A small table on a riser; the origin is the middle of its top."
    recess = "A small table with a round recess in the middle of its top, the origin."
    return {
        **_table("small_table", [], 0.0, plain),
        **_table("small_table_recess", _recess(), RECESS_DEPTH, recess),
        **bench(),
    }
