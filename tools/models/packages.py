"""Household objects of one convex piece: boxes, cans, a pen and a ball.

Sizes and masses are those of the YCB object set (Calli et al., IEEE RAM 22(3), 2015),
to whose objects the numbers refer; the drawings are ours. Masses are spread evenly over
the volume.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np

from .household import hard
from .pieces import Inertial, Piece, Primitive, Proximity
from .props import CAN
from .sdf import Color, Files, Model
from .shapes import (
    MassProperties,
    block,
    disc,
    hull_2d,
    prism,
    revolve,
    rounded_profile,
)

# Dry, against rubber or wood; Drake combines the friction of both bodies.
CARDBOARD = hard(0.6)  # handbooks: 0.5 to 0.7
TINPLATE = hard(0.8)  # painted or with a paper label, as the soup can
BARE_WOOD = hard(0.5)  # sanded: 0.4 to 0.6
PEN = hard(0.5)  # smooth polypropylene
# Sponge clings. Its modulus is far above a foam's, so that the brick stays a brick, and
# low enough for its 28 g to rest on a stiff table.
FOAM = Proximity(False, 0.9, 1e6, CAN.dissipation)
FELT = hard(0.9)
_DIGITS = 9  # of the inertia, as exact as that of a scenario's `shape`
# Edge length of the facets of round shapes over the radius, as for a `shape`: a circle
# gets 22 sides.
_RESOLUTION = 0.3


def _finish(
    name: str,
    comment: str,
    looks: dict[str, Color],
    pieces: Sequence[Piece],
    inertial: Inertial,
) -> Files:
    comment = f"{comment} See tools/models/packages.py."
    model = Model(name, looks, comment)
    model.AddLink(name, pieces, inertial)
    return model.finish(f"sdf/{name}.sdf")


def _box(
    name: str,
    comment: str,
    size: Sequence[float],
    mass: float,
    how: Proximity,
    colors: tuple[Color, Color],
) -> Files:
    """Return a box about its origin, with a belt of another colour around z."""
    half = np.array(size) / 2
    belt = half * (1, 1, 0.5) + (2e-4, 2e-4, 0)
    edge = 0.0015
    pieces = [
        Piece(
            "box", "body", block(-half, half, edge), Primitive("box", tuple(size)), how
        ),
        Piece("belt", "belt", block(-belt, belt)),
    ]
    x2, y2, z2 = np.array(size) ** 2
    inertia = mass / 12 * np.diag([y2 + z2, x2 + z2, x2 + y2])
    looks = dict(zip(("body", "belt"), colors, strict=True))
    inertial = Inertial(mass, (0, 0, 0), inertia, _DIGITS)
    return _finish(name, comment, looks, pieces, inertial)


def _cylinder(
    name: str,
    comment: str,
    size: tuple[float, float],
    mass: float,
    how: Proximity,
    colors: tuple[Color, Color],
) -> Files:
    """Return a cylinder of (radius, length) about its origin, with a belt."""
    radius, length = size
    half = length / 2
    body = revolve(rounded_profile(radius, -half, half, 0.0008), 48)
    belt = [(radius + 1e-4, z) for z in (-0.6 * half, 0.6 * half)]
    pieces = [
        Piece("cylinder", "body", body, Primitive("cylinder", size), _cut(how, radius)),
        Piece("belt", "belt", revolve(belt, 48)),
    ]
    side = mass * (3 * radius**2 + length**2) / 12
    inertia = np.diag([side, side, mass * radius**2 / 2])
    looks = dict(zip(("body", "belt"), colors, strict=True))
    inertial = Inertial(mass, (0, 0, 0), inertia, _DIGITS)
    return _finish(name, comment, looks, pieces, inertial)


def _cut(how: Proximity, radius: float) -> Proximity:
    """Return contact properties with the resolution of a round shape."""
    return dc.replace(how, resolution=round(_RESOLUTION * radius, 6))


def tennis_ball() -> Files:
    """Return a tennis ball; its inertia is a solid ball's."""
    radius, mass = 0.0325, 0.058
    angles = np.linspace(-np.pi / 2, np.pi / 2, 17)[1:-1]
    circles = [(radius * np.cos(a), radius * np.sin(a)) for a in angles]
    ball = revolve([(0, -radius), *circles, (0, radius)], 32)
    felt = _cut(FELT, radius)
    pieces = [Piece("ball", "felt", ball, Primitive("sphere", (radius,)), felt)]
    inertia = 0.4 * mass * radius**2 * np.eye(3)
    return _finish(
        "056_tennis_ball",
        "YCB 056.",
        {"felt": (0.78, 0.88, 0.20)},
        pieces,
        Inertial(mass, (0, 0, 0), inertia, _DIGITS),
    )


def potted_meat_can() -> Files:
    """Return a can with rounded corners that stands on z = 0."""
    x, y, height, corner, mass = 0.050, 0.097, 0.082, 0.015, 0.370

    def outline(count: int, grow: float = 0.0) -> np.ndarray:
        """Return the rounded rectangle with `count` points at each corner."""
        # Sides of an arc lie inside it; half of what they miss goes outside.
        radius = corner * (1 + (1 - np.cos(np.pi / 4 / (count - 1))) / 2) + grow
        middle = np.array([x / 2 - corner, y / 2 - corner])
        corners = []
        for i, (a, b) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
            start = i * np.pi / 2
            arc = disc(radius, middle * (a, b), count, start, start + np.pi / 2)
            limit = np.array([x, y]) / 2 + grow
            corners.append(np.clip(arc, -limit, limit))
        return hull_2d(*corners)

    touched = prism(outline(3), 0, height)
    body = prism(outline(9), 0, height, 0.001)
    pieces = [
        Piece("can", "body", body, touched, TINPLATE),
        Piece("belt", "belt", prism(outline(9, 2e-4), 0.25 * height, 0.75 * height)),
    ]
    volume, z2 = x * y * height, height**2
    inertia = volume / 12 * np.diag([y**2 + z2, x**2 + z2, x**2 + y**2])
    return _finish(
        "010_potted_meat_can",
        "YCB 010.",
        {"body": (0.15, 0.30, 0.62), "belt": (0.93, 0.90, 0.82)},
        pieces,
        Inertial.uniform(mass, MassProperties(volume, (0, 0, height / 2), inertia)),
    )


def build() -> Files:
    """Return the files of all packages."""
    white, navy = (0.94, 0.92, 0.87), (0.12, 0.20, 0.45)
    grain = (0.66, 0.50, 0.31)
    boxes = {
        "003_cracker_box": (
            ((0.158, 0.2074, 0.0658), 0.411, CARDBOARD, ((0.75, 0.15, 0.12), white))
        ),
        "004_sugar_box": (
            ((0.0867, 0.1703, 0.0391), 0.514, CARDBOARD, ((0.93, 0.80, 0.20), white))
        ),
        "008_pudding_box": (
            ((0.110, 0.089, 0.035), 0.187, CARDBOARD, ((0.40, 0.22, 0.13), white))
        ),
        "036_wood_block": (
            ((0.085, 0.085, 0.200), 0.729, BARE_WOOD, ((0.76, 0.60, 0.40), grain))
        ),
        "061_foam_brick": (
            ((0.075, 0.050, 0.050), 0.028, FOAM, ((0.72, 0.25, 0.22), navy))
        ),
    }
    cylinders = {
        "007_tuna_can": (
            ((0.0425, 0.033), 0.171, TINPLATE, ((0.66, 0.68, 0.71), navy))
        ),
        "040_large_marker": (
            ((0.009, 0.121), 0.0158, PEN, ((0.10, 0.10, 0.11), white))
        ),
    }
    files: Files = {}
    for name, (size, mass, how, colors) in boxes.items():
        files |= _box(name, f"YCB {name[:3]}.", size, mass, how, colors)
    for name, (size, mass, how, colors) in cylinders.items():
        files |= _cylinder(name, f"YCB {name[:3]}.", size, mass, how, colors)
    return {**files, **tennis_ball(), **potted_meat_can()}
