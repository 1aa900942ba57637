"""Household objects of several convex pieces: tableware, tools and a banana.

Sizes and masses are those of the YCB object set (Calli et al., IEEE RAM 22(3), 2015),
to whose objects the numbers refer; the drawings are ours. Each rests on z = 0. Pieces
have at most 24 corners, and wedges of round walls share one mesh.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from .household import FINE, GLAZE, METAL, PLASTIC, hard, rings, shell, touched
from .pieces import Inertial, Piece, Proximity, Turned
from .sdf import Color, Files, Model
from .shapes import (
    Points,
    Solid,
    at_height,
    disc,
    hull,
    prism,
    rot_x,
    rot_z,
    union_properties,
)

PEEL = hard(0.6)  # banana peel, dry outside; 0.07 only where it is crushed
Profile = Sequence[tuple[float, float]]  # (radius, height) [m]


def _finish(
    name: str,
    looks: dict[str, Color],
    pieces: Sequence[Piece],
    inertial: Inertial | float,
) -> Files:
    """Return the files of a model; a plain mass is spread evenly over what is seen."""
    if not isinstance(inertial, Inertial):
        seen = [piece.solid for piece in pieces if piece.look is not None]
        inertial = Inertial.uniform(inertial, union_properties(seen))
    comment = f"YCB {name[:3]}. See tools/models/tableware.py."
    model = Model(name, looks, comment)
    model.AddLink(name, pieces, inertial)
    return model.finish(f"sdf/{name}.sdf")


def _wall(
    name: str, look: str, outer: Profile, inner: Profile, count: int, how: Proximity
) -> list[Piece]:
    """Return a round wall: a fine one to see, and `count` equal wedges to touch."""
    wedge = shell(outer, inner, count)[0]
    return [
        *[Piece(name, look, solid) for solid in shell(outer, inner, FINE)],
        *[
            Piece(
                f"{name}_{i}",
                None,
                wedge,
                Turned(name, wedge, float(np.round(2 * np.pi * i / count, 9))),
                how,
            )
            for i in range(count)
        ],
    ]


def _floor(name: str, look: str, radius: float, top: float, how: Proximity) -> Piece:
    profile = [(radius, 0.0), (radius, top)]
    touched_ = hull(*rings(profile, 12))
    return Piece(name, look, hull(*rings(profile, FINE)), touched_, how)


def plate() -> Files:
    """Return a flat-bottomed plate with a rising rim."""
    foot, rim, height, thick = 0.080, 0.129, 0.024, 0.005
    pieces = [
        _floor("plate_floor", "glaze", foot, thick, GLAZE),
        *_wall(
            "plate_rim",
            "glaze",
            [(foot, 0.0), (rim, height - thick)],
            [(foot - 0.004, thick), (rim - 0.001, height)],
            20,
            GLAZE,
        ),
    ]
    return _finish("029_plate", {"glaze": (0.78, 0.14, 0.13)}, pieces, 0.279)


def pitcher() -> Files:
    """Return a pitcher without its lid; the handle is along x."""
    radius, height, wall = 0.054, 0.235, 0.003
    pieces = [
        _floor("pitcher_floor", "plastic", radius, wall, PLASTIC),
        *_wall(
            "pitcher_wall",
            "plastic",
            [(radius, 0.0), (radius, height)],
            [(radius - wall, 0.0), (radius - wall, height)],
            12,
            PLASTIC,
        ),
    ]
    path = np.array([(0.052, 0.21), (0.085, 0.205), (0.092, 0.19), (0.085, 0.08)])
    path = np.vstack([path, (0.052, 0.065)])
    handle = []
    for a, b in itertools.pairwise(path):
        along = (b - a) / np.linalg.norm(b - a)
        side = 0.005 * np.array([-along[1], along[0]])
        corners = np.array([a - side, a + side, b - side, b + side])
        link = prism(corners, -0.010, 0.010)
        handle.append(link.moved(rot_x(np.pi / 2)))
    pieces += touched("pitcher_handle", "plastic", handle, PLASTIC)
    return _finish("019_pitcher_base", {"plastic": (0.15, 0.35, 0.70)}, pieces, 0.178)


def _bent(
    radius: Sequence[float], arc: float, length: float, height: float, count: int
) -> list[Solid]:
    """Return a rod along a circular arc in the plane z = height, piece by piece.

    Args:
        radius: Radii of the evenly spaced cross sections [m].
        arc: Radius of the arc [m].
        length: Length of the arc [m].
        height: Height of the arc above z = 0 [m].
        count: Sides of the cross sections, whose flats touch their circle.
    """
    angles = (np.linspace(-0.5, 0.5, len(radius))) * length / arc
    sections = []
    for angle, r in zip(angles, radius, strict=True):
        ring = disc(r / np.cos(np.pi / count), count=count)
        turn = rot_z(np.pi / count)[:2, :2]
        ring = np.round(ring @ turn.T, 9)  # a flat is underneath
        section = np.column_stack([ring[:, 0], np.zeros(count), ring[:, 1]])
        center = np.array([arc, 0, 0])
        section = (section + center) @ rot_z(angle).T - center
        sections.append(section + np.array([0, 0, height]))
    return [hull(a, b) for a, b in itertools.pairwise(sections)]


def banana() -> Files:
    """Return a banana that lies on its side, bent around z."""
    knots = np.linspace(0, 1, 7)
    radius = np.array([0.006, 0.0145, 0.018, 0.018, 0.018, 0.0145, 0.005])
    fine = np.linspace(0, 1, 19)
    seen = _bent(np.interp(fine, knots, radius), 0.13, 0.2, 0.018, 20)
    pieces = [Piece("banana", "peel", solid) for solid in seen]
    solids = _bent(radius, 0.13, 0.2, 0.018, 12)
    pieces += touched("banana", None, solids, PEEL)
    return _finish("011_banana", {"peel": (0.95, 0.82, 0.20)}, pieces, 0.066)


def spoon() -> Files:
    """Return a spoon along x; its bowl and the end of its handle touch the table."""
    count, thick = 8, 0.002

    def oval(a: float, b: float, z: float) -> Points:
        return at_height(disc(1.0, count=count) * (a, b) + (0.067, 0), z)

    bottom, rim = oval(0.018, 0.011, 0.0), oval(0.030, 0.020, 0.010)
    low, high = oval(0.017, 0.010, thick), oval(0.0285, 0.0185, 0.0105)
    solids = [hull(bottom, low)]
    for i in range(count):
        pair = [i, (i + 1) % count]
        solids.append(hull(bottom[pair], rim[pair], low[pair], high[pair]))

    def bar(x0: float, x1: float, ends: Sequence[tuple[float, float]]) -> Solid:
        """Return a bar from x0 to x1; at both ends, its half width and its bottom."""
        corners = [
            (x, s * half, z + dz)
            for x, (half, z) in zip((x0, x1), ends, strict=True)
            for s in (-1, 1)
            for dz in (0, thick)
        ]
        return hull(np.array(corners))

    solids.append(bar(0.040, 0.0, [(0.004, 0.0085), (0.003, 0.012)]))
    solids.append(bar(0.0, -0.098, [(0.003, 0.012), (0.009, 0.0)]))
    pieces = touched("spoon", "steel", solids, METAL)
    return _finish("031_spoon", {"steel": (0.66, 0.68, 0.71)}, pieces, 0.030)


def _rod(radius: float, x0: float, x1: float, height: float, count: int) -> Solid:
    """Return a prism along x whose flats touch a cylinder; a flat is underneath."""
    ring = disc(radius / np.cos(np.pi / count), count=count)
    ring = np.round(ring @ rot_z(np.pi / count)[:2, :2].T, 9)
    ends = [np.column_stack([np.full(count, x), ring]) for x in (x0, x1)]
    return hull(*ends).moved(p=(0, 0, height))


def _round_piece(
    name: str, look: str, rod: tuple[float, float, float, float], how: Proximity
) -> Piece:
    """Return a rod of (radius, x0, x1, height), round to see, with 8 sides to touch."""
    return Piece(name, look, _rod(*rod, 24), _rod(*rod, 8), how)


def hammer() -> Files:
    """Return a claw hammer that lies on its side, the handle along x."""
    grip = _round_piece("grip", "rubber", (0.0145, -0.215, -0.09, 0.0145), PLASTIC)
    neck = _round_piece("neck", "wood", (0.010, -0.09, 0.07, 0.0145), PLASTIC)
    face = _round_piece("face", "steel", (0.0125, -0.067, -0.035, 0.0145), METAL)
    head = _round_piece("head", "steel", (0.0145, -0.035, 0.015, 0.0145), METAL)

    def across(piece: Piece) -> Piece:
        """Turn a piece of the head from x to y, onto the handle's end."""
        assert isinstance(piece.collision, Solid)
        R, p = rot_z(np.pi / 2), (0.082, 0.0, 0.0)
        seen, felt = piece.solid.moved(R, p), piece.collision.moved(R, p)
        return Piece(piece.name, piece.look, seen, felt, piece.proximity)

    claws = []
    for sign in (1, -1):
        base = [(0.082, 0.014), (0.094, 0.014), (0.079, 0.045), (0.089, 0.045)]
        tip = [(0.070, 0.068), (0.074, 0.070)]
        z = 0.0145 + sign * np.array([0.001, 0.011])
        end = 0.0145 + sign * np.array([0.004, 0.009])
        claws.append(
            hull(
                np.array([(x, y, h) for x, y in base for h in z]),
                np.array([(x, y, h) for x, y in tip for h in end]),
            )
        )
    head_pieces = [across(face), across(head), *touched("claw", "steel", claws, METAL)]
    pieces = [grip, neck, *head_pieces]
    inertial = Inertial.joined(
        [
            Inertial.uniform(0.455, union_properties([p.solid for p in head_pieces])),
            Inertial.uniform(0.210, union_properties([grip.solid, neck.solid])),
        ]
    )
    looks = {
        "steel": (0.55, 0.57, 0.60),
        "wood": (0.76, 0.60, 0.40),
        "rubber": (0.12, 0.12, 0.13),
    }
    return _finish("048_hammer", looks, pieces, inertial)


def screwdriver() -> Files:
    """Return a screwdriver along x that lies on a flat of its handle."""
    handle = _round_piece("handle", "grip", (0.0155, -0.105, -0.01, 0.0155), PLASTIC)
    collar = _round_piece("collar", "grip", (0.011, -0.01, 0.0, 0.0155), PLASTIC)
    shaft = _round_piece("shaft", "steel", (0.003, 0.0, 0.110, 0.0155), METAL)
    pieces = [handle, collar, shaft]
    # The blade ends in the handle; the part outside is 31 cm³/m of steel.
    inertial = Inertial.joined(
        [
            Inertial.uniform(0.024, union_properties([shaft.solid])),
            Inertial.uniform(0.073, union_properties([handle.solid, collar.solid])),
        ]
    )
    looks = {"grip": (0.85, 0.35, 0.08), "steel": (0.66, 0.68, 0.71)}
    return _finish("043_phillips_screwdriver", looks, pieces, inertial)


def build() -> Files:
    """Return the files of all of them."""
    return {
        **plate(),
        **pitcher(),
        **banana(),
        **spoon(),
        **hammer(),
        **screwdriver(),
    }
