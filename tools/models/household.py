"""Household objects that are not convex: a mug, a bowl, a squeeze bottle, a wrench.

Our own designs, of ordinary size and weight. Each stands or lies on z = 0 and consists
of convex pieces, so that fingers touch handle, hollow, waist and jaw where cameras see
them. Masses follow from the drawn volume and the material's density.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .pieces import Inertial, Piece, Proximity
from .props import CAN
from .sdf import Color, Files, Model
from .shapes import Solid, at_height, block, disc, hull, prism, rot_x, union_properties

# Densities from handbooks [kg/m^3].
STONEWARE, STEEL, MUSTARD = 2300.0, 7850.0, 1050.0


def hard(friction: float) -> Proximity:
    """Return contact properties as stiff as the can's with another friction."""
    return Proximity(
        rigid=False,
        friction=friction,
        modulus=CAN.modulus,
        dissipation=CAN.dissipation,
    )


# Handbooks give 0.6 to 0.9 for these against dry rubber. Drake combines the friction of
# both bodies by their harmonic mean.
GLAZE, PLASTIC, METAL = hard(0.7), hard(0.6), hard(0.7)


def touched(
    name: str, look: str | None, solids: Sequence[Solid], how: Proximity
) -> list:
    return [Piece(f"{name}_{i}", look, s, s, how) for i, s in enumerate(solids)]


# Sides of round parts: of visuals, and of collision pieces.
FINE, COARSE = 48, 16


def rings(profile: Sequence[tuple[float, float]], count: int) -> list:
    """Return circles, given as (radius, height), as polygons that straddle them."""
    stretch = 1 + (1 - np.cos(np.pi / count)) / 2
    return [at_height(disc(stretch * r, count=count), z) for r, z in profile]


def _hollow(
    name: str,
    look: str,
    floor: Sequence[tuple[float, float]],
    outer: Sequence[tuple[float, float]],
    inner: Sequence[tuple[float, float]],
    how: Proximity,
) -> list[Piece]:
    """Return a vessel from the (radius, height) profiles of its floor and wall."""

    def solids(count: int) -> list[Solid]:
        return [hull(*rings(floor, count)), *shell(outer, inner, count)]

    return [
        *[Piece(name, look, solid) for solid in solids(FINE)],
        *touched(name, None, solids(COARSE), how),
    ]


def shell(
    outer: Sequence[tuple[float, float]],
    inner: Sequence[tuple[float, float]],
    count: int,
) -> list[Solid]:
    """Return the wall between two (radius, height) profiles, cut into wedges."""
    a, b = rings(outer, count), rings(inner, count)
    solids = []
    for low in range(len(a) - 1):
        for i in range(count):
            j = (i + 1) % count
            corners = (a[low], a[low + 1], b[low], b[low + 1])
            solids.append(hull(np.array([ring[k] for ring in corners for k in (i, j)])))
    return solids


def _finish(
    name: str,
    looks: dict[str, Color],
    comment: str,
    pieces: list[Piece],
    density: float,
) -> Files:
    model = Model(name, looks, f"{comment} See tools/models/household.py.")
    volume = union_properties([p.solid for p in pieces if p.look is not None])
    mass = round(density * volume.volume, 3)
    model.AddLink(name, pieces, Inertial.uniform(mass, volume))
    return model.finish(f"sdf/{name}.sdf")


def mug() -> Files:
    """Return a mug with its handle along x."""
    radius, height, wall = 0.041, 0.092, 0.0045
    floor = [(radius - 0.003, 0), (radius, 0.006), (radius - wall, 0.007)]
    outer = [(radius, 0.006), (radius, height)]
    inner = [(radius - wall, 0.006), (radius - wall, height)]
    pieces = _hollow("mug_body", "glaze", floor, outer, inner, GLAZE)
    # Half an ellipse of links with a cross section of 8 mm x 11 mm.
    angles = np.linspace(-np.pi / 2, np.pi / 2, 7)
    path = np.column_stack(
        [radius - 0.003 + 0.030 * np.cos(angles), 0.048 + 0.028 * np.sin(angles)]
    )
    out = np.column_stack([np.cos(angles), np.sin(angles)])
    handle = []
    for i in range(len(path) - 1):
        corners = [
            path[k] + side * 0.004 * out[k] for k in (i, i + 1) for side in (-1, 1)
        ]
        link = prism(np.array(corners), -0.0055, 0.0055)
        handle.append(link.moved(rot_x(np.pi / 2)))
    pieces += touched("mug_handle", "glaze", handle, GLAZE)
    band = shell(
        [(radius + 0.0003, 0.018), (radius + 0.0003, 0.030)],
        [(radius - 0.001, 0.018), (radius - 0.001, 0.030)],
        FINE,
    )
    pieces += [Piece("mug_band", "band", s) for s in band]
    looks = {"glaze": (0.20, 0.42, 0.58), "band": (0.93, 0.91, 0.86)}
    return _finish("mug", looks, "A stoneware mug with a handle.", pieces, STONEWARE)


def bowl() -> Files:
    """Return a bowl that tapers to its foot."""
    floor = [(0.032, 0), (0.034, 0.006), (0.034, 0.010)]
    outer = [(0.034, 0.006), (0.058, 0.022), (0.072, 0.056)]
    inner = [(0.030, 0.010), (0.0535, 0.0245), (0.068, 0.056)]
    pieces = _hollow("bowl", "glaze", floor, outer, inner, GLAZE)
    rim = shell(
        [(0.0718, 0.054), (0.0726, 0.0565)], [(0.067, 0.054), (0.0675, 0.0565)], FINE
    )
    pieces += [Piece("bowl_rim", "rim", s) for s in rim]
    looks = {"glaze": (0.90, 0.87, 0.80), "rim": (0.45, 0.55, 0.45)}
    return _finish("bowl", looks, "A stoneware bowl.", pieces, STONEWARE)


def bottle() -> Files:
    """Return a squeeze bottle: an oval body with a waist, a neck and a nozzle."""
    count = 24

    def oval(a: float, b: float, z: float) -> np.ndarray:
        return at_height(disc(1.0, count=count) * (a, b), z)

    body = [
        hull(
            oval(0.043, 0.026, 0.0), oval(0.047, 0.029, 0.008), oval(0.047, 0.029, 0.05)
        ),
        hull(oval(0.047, 0.029, 0.05), oval(0.039, 0.0245, 0.078)),
        hull(oval(0.039, 0.0245, 0.078), oval(0.045, 0.028, 0.106)),
        hull(oval(0.045, 0.028, 0.106), oval(0.042, 0.026, 0.128)),
        hull(oval(0.042, 0.026, 0.128), oval(0.017, 0.017, 0.150)),
    ]
    cap = [
        hull(oval(0.0165, 0.0165, 0.150), oval(0.0165, 0.0165, 0.164)),
        hull(oval(0.0095, 0.0095, 0.164), oval(0.0040, 0.0040, 0.188)),
    ]
    pieces = touched("bottle_body", "body", body, PLASTIC)
    pieces += touched("bottle_cap", "cap", cap, PLASTIC)
    label = hull(oval(0.0473, 0.0293, 0.014), oval(0.0473, 0.0293, 0.044))
    pieces.append(Piece("bottle_label", "label", label))
    looks = {
        "body": (0.93, 0.74, 0.10),
        "cap": (0.80, 0.16, 0.10),
        "label": (0.18, 0.28, 0.50),
    }
    return _finish("squeeze_bottle", looks, "A full squeeze bottle.", pieces, MUSTARD)


def wrench() -> Files:
    """Return a combination wrench along x, its jaw in front and its ring behind."""
    thick = 0.010
    middle = thick / 2
    half = 0.0035
    handle = block((-0.072, -0.0075, middle - half), (0.070, 0.0075, middle + half))
    neck = prism(
        np.array([(0.064, -0.008), (0.064, 0.008), (0.078, 0.0165), (0.078, -0.0165)]),
        0,
        thick,
    )
    jaws = [
        prism(
            np.array(
                [
                    (0.077, s * 0.0165),
                    (0.077, s * 0.0085),
                    (0.099, s * 0.0085),
                    (0.101, s * 0.012),
                    (0.090, s * 0.0185),
                ]
            ),
            0,
            thick,
        )
        for s in (1, -1)
    ]
    count, center = 12, (-0.085, 0.0)
    a, b = disc(0.0155, center, count), disc(0.0095, center, count)
    ring = []
    for i in range(count):
        j = (i + 1) % count
        ring.append(prism(np.array([a[i], a[j], b[j], b[i]]), 0, thick))
    pieces = touched("wrench_handle", "steel", [handle], METAL)
    pieces += touched("wrench_head", "steel", [neck, *jaws], METAL)
    pieces += touched("wrench_ring", "steel", ring, METAL)
    grip = block(
        (-0.045, -0.0045, middle - half - 3e-4), (0.045, 0.0045, middle + half + 3e-4)
    )
    pieces.append(Piece("wrench_panel", "panel", grip))
    looks = {"steel": (0.66, 0.68, 0.71), "panel": (0.15, 0.33, 0.60)}
    return _finish("wrench", looks, "A combination wrench.", pieces, STEEL)


def build() -> Files:
    """Return the files of all household objects."""
    return {**mug(), **bowl(), **bottle(), **wrench()}
