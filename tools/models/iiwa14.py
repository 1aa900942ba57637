"""The KUKA LBR iiwa 14 R820: numbers from its public description, our own shapes."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from .pieces import Inertial, Piece, Primitive, Proximity
from .sdf import Files, Model
from .shapes import (
    Solid,
    at_height,
    disc,
    hull,
    hull_2d,
    prism,
    revolve,
    rot_x,
    rot_z,
    rounded_profile,
)

# Of each link: mass [kg], centre of mass [m] and principal inertia about it [kg m^2].
# Of each joint, below: origin in the parent [m, rad], limits [rad, rad/s, rad/s^2, N
# m], gear ratio, rotor inertia [kg m^2]. Source: the public iiwa14 URDF of drake_models
# (RobotLocomotion/models).
LINKS = (
    (5.00, (-0.1, 0, 0.07), (0.05, 0.06, 0.03)),
    (5.76, (0, -0.03, 0.12), (0.033, 0.0333, 0.0123)),
    (6.35, (0.0003, 0.059, 0.042), (0.0305, 0.011, 0.0304)),
    (3.50, (0, 0.03, 0.13), (0.025, 0.0238, 0.0076)),
    (3.50, (0, 0.067, 0.034), (0.017, 0.006, 0.0164)),
    (3.50, (0.0001, 0.021, 0.076), (0.01, 0.0087, 0.00449)),
    (1.80, (0, 0.0006, 0.0004), (0.0049, 0.0047, 0.0036)),
    (1.20, (0, 0, 0.02), (0.001, 0.001, 0.001)),
)
DAMPING = 0.5  # N m s/rad, the same source
FLANGE_Z = 0.045  # m, in link_7


@dc.dataclass(frozen=True)
class Joint:
    """One row of the joint table."""

    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]
    limit: float
    velocity: float
    acceleration: float
    effort: float
    gear_ratio: float = 160.0
    rotor_inertia: float = 0.0001321


_PI, _HALF = np.pi, np.pi / 2
JOINTS = (
    Joint((0, 0, 0.1575), (0, 0, 0), 2.96705973, 1.48352986, 8.57, 320),
    Joint((0, 0, 0.2025), (_HALF, 0, _PI), 2.0943951, 1.48352986, 8.57, 320),
    Joint((0, 0.2045, 0), (_HALF, 0, _PI), 2.96705973, 1.74532925, 8.74, 176),
    Joint((0, 0, 0.2155), (_HALF, 0, 0), 2.0943951, 1.30899694, 11.36, 176),
    Joint((0, 0.1845, 0), (-_HALF, _PI, 0), 2.96705973, 2.26892803, 12.23, 110, 100.0),
    Joint(
        (0, 0, 0.2155), (_HALF, 0, 0), 2.0943951, 2.35619449, 15.72, 40,
        rotor_inertia=0.0000454,
    ),
    Joint(
        (0, 0.081, 0), (-_HALF, _PI, 0), 3.05432619, 2.35619449, 15.72, 40,
        rotor_inertia=0.0000454,
    ),
)  # fmt: skip

LOOKS = {
    "shell": (0.78, 0.79, 0.80),
    "ring": (0.24, 0.25, 0.27),
    "cap": (0.93, 0.50, 0.10),
}
# Painted aluminium. The arm should not touch anything.
SHELL = Proximity(rigid=True, friction=0.4, resolution=0.02)

_FINE, _COARSE = 48, 24  # corners of a circle: of visuals, of collision pieces


@dc.dataclass(frozen=True)
class Elbow:
    """A link between two crossing axes: a domed socket with half a hub at one side.

    Canonical frame: the socket's axis is z; the hub's axis is parallel to y at z =
    `height`, with the hub at positive y. The two links of a joint have half a hub each.
    """

    radius: float  # of the socket
    dome: float  # z where the socket's dome starts
    height: float  # z of the hub's axis
    hub_radius: float
    hub_width: float  # y of the hub's face
    hub_start: float = 0.0015
    rise: float | None = None  # of the dome; None: up to 3 mm below the hub
    foot_start: float = 0.0  # y beyond which the socket is part of the hub's foot

    def socket(self, count: int, steps: int) -> Solid:
        """Return the socket and its dome."""
        rise = self.rise or self.height - self.hub_radius - 0.003 - self.dome
        a = np.linspace(0, _HALF, steps + 1)[:-1]
        profile = [(self.radius - 0.003, 0.002), (self.radius, 0.005)]
        profile += list(
            zip(self.radius * np.cos(a), self.dome + rise * np.sin(a), strict=True)
        )
        return revolve([*profile, (0, self.dome + rise)], count)

    def hub(self, count: int, steps: int) -> Solid:
        """Return the half hub, extended to the half of the socket on the same side."""
        edge = 0.4 * self.hub_radius
        rim = rounded_profile(
            self.hub_radius, self.hub_start, self.hub_width, edge, steps
        )
        rim = rim[rim[:, 1] > self.hub_width - edge - 1e-9]
        hub = self._on_hub(revolve([(self.hub_radius, self.hub_start), *rim], count))
        half = disc(self.radius, count=count // 2 + 1, start=0.02, stop=_PI - 0.02)
        half = half[half[:, 1] >= self.foot_start]
        return hull(hub, at_height(half, 0.025), at_height(half, self.dome))

    def _on_hub(self, solid: Solid) -> Solid:
        """Return a solid of revolution, moved onto the hub's axis."""
        return solid.moved(rot_x(-_HALF), (0, 0, self.height))

    def pieces(
        self, link: int, R: np.ndarray | None = None, p: tuple = (0, 0, 0)
    ) -> list[Piece]:
        """Return the pieces in the link's frame."""
        band = prism(disc(self.radius + 0.001, count=_FINE), 0.008, 0.016, 0.0005)
        name = f"link_{link}"
        pieces = [
            _convex(f"{name}_socket", self.socket(_FINE, 6), self.socket(_COARSE, 5)),
            _convex(f"{name}_hub", self.hub(_FINE, 6), self.hub(_COARSE, 5)),
            Piece(f"{name}_band", "ring", band),
            *[
                dc.replace(cap, solid=self._on_hub(cap.solid))
                for cap in _cap(name, 0.6 * self.hub_radius - 0.003, self.hub_width)
            ],
        ]
        return [_moved(piece, R, p) for piece in pieces]


def _moved(piece: Piece, R: np.ndarray | None, p: tuple) -> Piece:
    touched = piece.collision
    if isinstance(touched, Solid):
        touched = touched.moved(R, p)
    return dc.replace(piece, solid=piece.solid.moved(R, p), collision=touched)


def _cap(name: str, radius: float, z: float) -> list[Piece]:
    """Return a coloured ring and a cover, 0.6 and 1.1 mm above a hub's face."""
    ring = prism(disc(radius, count=_FINE), z - 0.002, z + 0.0006, 0.0004)
    cover = prism(disc(radius - 0.007, count=_FINE), z - 0.002, z + 0.0011, 0.0008)
    return [Piece(f"{name}_cap", "cap", ring), Piece(f"{name}_cover", "shell", cover)]


def _convex(name: str, seen: Solid, touched: Solid) -> Piece:
    return Piece(name, "shell", seen, touched, SHELL)


def link_0() -> list[Piece]:
    """Return the foot, extended to the plugs at the rear, and the column on it."""
    foot = hull_2d(
        disc(0.108, count=_FINE),
        np.array([(-0.135, y) for y in (-0.055, 0.055)]),
        np.array([(-0.11, y) for y in (-0.085, 0.085)]),
    )

    def column(count: int) -> Solid:
        profile = [(0.104, 0), (0.1, 0.06), (0.09, 0.12), (0.087, 0.15), (0.084, 0.155)]
        return revolve(profile, count)

    return [
        _convex("link_0_foot", prism(foot, 0, 0.055, 0.004), prism(foot, 0, 0.055)),
        _convex("link_0_column", column(_FINE), column(_COARSE)),
    ]


def link_6() -> list[Piece]:
    """Return the wrist: a drum about z and an outlet along y."""

    def drum(count: int, steps: int) -> Solid:
        return revolve(rounded_profile(0.06, -0.057, 0.062, 0.022, steps), count)

    def outlet(count: int) -> Solid:
        profile = [(0.052, 0), (0.052, 0.055), (0.05, 0.058)]
        return revolve(profile, count).moved(rot_x(-_HALF))

    return [
        _convex("link_6_drum", drum(_FINE, 6), drum(_COARSE, 5)),
        _convex("link_6_outlet", outlet(_FINE), outlet(_COARSE)),
        *_cap("link_6", 0.034, 0.062),
    ]


def link_7() -> list[Piece]:
    """Return the last moving part and the tool flange."""
    body = revolve(rounded_profile(0.047, -0.021, 0.034, 0.004))
    body_touched = Primitive("cylinder", (0.047, 0.055), (0, 0, 0.0065))
    flange = prism(disc(0.0315, count=_FINE), 0.033, FLANGE_Z)
    flange_touched = Primitive("cylinder", (0.0315, 0.012), (0, 0, 0.039))
    return [
        Piece("link_7_body", "shell", body, body_touched, SHELL),
        Piece("link_7_flange", "ring", flange, flange_touched, SHELL),
    ]


def link_pieces() -> list[list[Piece]]:
    """Return the pieces of each link."""
    # In even links the hub's axis is z through the origin; the socket points along y.
    turn = rot_x(_HALF)
    return [
        link_0(),
        Elbow(0.087, 0.05, 0.2025, 0.082, 0.098).pieces(1, rot_z(_PI)),
        Elbow(0.083, 0.06, 0.2045, 0.082, 0.098).pieces(2, turn, (0, 0.2045, 0)),
        Elbow(0.080, 0.06, 0.2155, 0.075, 0.090).pieces(3),
        Elbow(0.073, 0.06, 0.1845, 0.075, 0.090).pieces(4, turn, (0, 0.1845, 0)),
        # The forearm passes the wrist on one side, so that link_7 has room to fold
        # back.
        Elbow(0.069, 0.04, 0.2155, 0.058, 0.106, 0.060, 0.06, 0.03).pieces(5),
        link_6(),
        link_7(),
    ]


def build() -> Files:
    """Return the arm's files."""
    model = Model("iiwa14", LOOKS, "The KUKA LBR iiwa 14 R820; tools/models/iiwa14.py.")
    for i, ((mass, com, moments), pieces) in enumerate(
        zip(LINKS, link_pieces(), strict=True)
    ):
        pose = None
        if i > 0:
            joint = JOINTS[i - 1]
            pose = (f"link_{i - 1}", joint.xyz, joint.rpy)
        model.AddLink(f"link_{i}", pieces, Inertial(mass, com, np.diag(moments)), pose)
    for i, joint in enumerate(JOINTS, 1):
        model.AddJoint(
            f"joint_{i}",
            f"link_{i - 1}",
            f"link_{i}",
            (0, 0, 1),
            {
                "lower": -joint.limit,
                "upper": joint.limit,
                "effort": joint.effort,
                "velocity": joint.velocity,
                "drake:acceleration": joint.acceleration,
            },
            DAMPING,
            joint.rotor_inertia,
            joint.gear_ratio,
        )
    model.AddFrame("flange", "link_7", (0, 0, FLANGE_Z))
    for i in range(7):
        model.AddFilter(f"around_joint_{i + 1}", [f"link_{i}", f"link_{i + 1}"])
    return model.finish("sdf/iiwa14.sdf")
