"""Convex pieces that make up a link: geometry, contact properties, inertia."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np

from .shapes import MassProperties, Points, Solid, block, prism


@dc.dataclass(frozen=True)
class Primitive:
    """A box (x, y, z), cylinder (radius, length) or sphere (radius) with its pose."""

    kind: str
    size: tuple[float, ...]
    xyz: tuple[float, float, float] = (0, 0, 0)
    rpy: tuple[float, float, float] = (0, 0, 0)


@dc.dataclass(frozen=True)
class Turned:
    """A convex solid, turned by `angle` [rad] about the link's z.

    Pieces that turn a solid of the same name share its mesh.
    """

    name: str
    solid: Solid
    angle: float


@dc.dataclass(frozen=True)
class VolumeMesh:
    """A box (x, y, z), centred at xyz, cut into tetrahedra of edge `resolution` [m].

    Drake meshes contact with it more finely than with a plain box.
    """

    size: tuple[float, float, float]
    xyz: tuple[float, float, float]
    resolution: float


@dc.dataclass(frozen=True)
class Surface:
    """A solid whose mesh keeps its holes: contact does not take its convex hull."""

    solid: Solid


@dc.dataclass(frozen=True)
class Proximity:
    """Contact properties; None leaves Drake's default, and dissipates nothing."""

    rigid: bool | None = True  # None: no hydroelastic contact
    friction: float | None = None
    modulus: float | None = None  # Pa
    dissipation: float | None = None  # s/m
    resolution: float | None = None  # m
    point_stiffness: float | None = None  # N/m


@dc.dataclass(frozen=True)
class Piece:
    """A convex piece of a link: its visual and its collision geometry.

    Cameras see `solid` in the colour that `look` names (None: invisible). Contact uses
    `collision` (None: a cosmetic detail).
    """

    name: str
    look: str | None
    solid: Solid
    collision: Primitive | VolumeMesh | Turned | Surface | Solid | None = None
    proximity: Proximity = Proximity()


@dc.dataclass(frozen=True)
class Inertial:
    """Mass [kg], centre of mass [m], inertia about it [kg m^2]."""

    mass: float
    com: Sequence[float]
    inertia: Points
    digits: int = 4  # significant ones of the inertia in the file

    @staticmethod
    def uniform(mass: float, properties: MassProperties) -> Inertial:
        """Spread a mass evenly over a volume."""
        scale = mass / properties.volume
        return Inertial(mass, properties.center, properties.inertia * scale)

    @staticmethod
    def joined(parts: Sequence[Inertial]) -> Inertial:
        """Return the mass properties of parts that are fixed to each other."""
        mass = sum(part.mass for part in parts)
        com = sum(part.mass * np.asarray(part.com) for part in parts) / mass
        inertia = np.zeros((3, 3))
        for part in parts:
            d = np.asarray(part.com) - com
            shift = d @ d * np.eye(3) - np.outer(d, d)
            inertia += part.inertia + part.mass * shift
        return Inertial(mass, com, inertia)


def box_piece(
    name: str,
    look: str,
    low: Sequence[float],
    high: Sequence[float],
    bevel: float,
    proximity: Proximity,
) -> Piece:
    """Return an axis-aligned box; its visual has bevelled edges, its collision none."""
    a, b = np.array(low), np.array(high)
    shape = Primitive("box", tuple(b - a), tuple((a + b) / 2))
    return Piece(name, look, block(low, high, bevel), shape, proximity)


def extruded_piece(
    name: str,
    look: str,
    outline: Points,
    z0: float,
    z1: float,
    bevel: float,
    proximity: Proximity,
) -> Piece:
    """Return a prism; its visual has bevelled rims, its collision sharp ones."""
    seen, touched = prism(outline, z0, z1, bevel), prism(outline, z0, z1)
    return Piece(name, look, seen, touched, proximity)
