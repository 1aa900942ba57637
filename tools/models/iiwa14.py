"""The KUKA LBR iiwa 14 R820: numbers of its public description, shapes of our own."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from .sdf import Files, Inertial, Model, Piece, Primitive, Proximity
from .shapes import (
    At,
    Disc,
    Hull,
    Hull2d,
    Prism,
    Revolve,
    Round,
    RotX,
    Solid,
    UnionProperties,
)

# Mass [kg], centre of mass [m] and principal inertia about it [kg m^2] of each link;
# then the joints: origin in the parent [m, rad], limits [rad, rad/s, rad/s^2, N m],
# gear ratio, rotor inertia [kg m^2]. Source: the public iiwa14 URDF of drake_models
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
# Painted aluminium; the arm should touch nothing.
SHELL = Proximity(rigid=True, friction=0.4, resolution=0.02)

_FINE, _COARSE = 48, 24  # corners a turn: seen, touched


@dc.dataclass(frozen=True)
class Elbow:
    """A link between two crossing axes: a domed socket, then half a hub at one side.

    Canonical frame: the socket's axis is z, the hub's is y at height `height`; the hub
    lies at positive y.
    """

    radius: float  # of the socket
    start: float  # z where the socket starts
    dome: float  # z where its dome starts
    height: float  # z of the hub's axis
    hub_radius: float
    hub_width: float  # how far the hub reaches out

    def Socket(self, count: int, steps: int) -> Solid:
        rise = self.height - self.hub_radius - 0.003 - self.dome
        a = np.linspace(0, _HALF, steps + 1)
        profile = [(self.radius - 0.003, self.start), (self.radius, self.start + 0.003)]
        profile += [
            (self.radius * c if c > 1e-9 else 0, self.dome + rise * s)
            for c, s in zip(np.cos(a), np.sin(a), strict=True)
        ]
        return Revolve(profile, count)

    def Hub(self, count: int, steps: int) -> Solid:
        profile = Round(self.hub_radius, 0.0015, self.hub_width, 0.028, steps)
        profile = [(r, z) for r, z in profile if z > self.hub_width / 2]
        turned = Revolve([(self.hub_radius, 0.0015), *profile], count).moved(
            RotX(-_HALF), (0, 0, self.height)
        )
        half = Disc(self.radius, count=count // 2 + 1, stop=_PI)
        half = half + (0, 0.0015)
        inside = half[np.hypot(half[:, 0], half[:, 1]) > 0]
        half = (
            inside
            * (
                self.radius
                / np.maximum(self.radius, np.hypot(inside[:, 0], inside[:, 1]))
            )[:, None]
        )
        return Hull(turned, At(half, self.dome), At(half, self.start + 0.02))

    def Pieces(
        self, link: int, R: np.ndarray | None = None, p: tuple = (0, 0, 0)
    ) -> list[Piece]:
        """Returns the pieces, turned and shifted into the link's frame."""
        ring = Prism(
            Disc(self.radius + 0.001, count=_FINE),
            self.start + 0.006,
            self.start + 0.014,
            0.0005,
        )
        face = self.hub_width
        cap = Revolve(
            Round(self.hub_radius - 0.031, face - 0.002, face + 0.001, 0.0006, 2), 48
        ).moved(RotX(-_HALF), (0, 0, self.height))
        return [
            Piece(
                f"link_{link}_socket", "shell",
                self.Socket(_FINE, 6).moved(R, p), self.Socket(_COARSE, 3).moved(R, p),
                SHELL,
            ),
            Piece(
                f"link_{link}_hub", "shell",
                self.Hub(_FINE, 6).moved(R, p), self.Hub(_COARSE, 3).moved(R, p), SHELL,
            ),
            Piece(f"link_{link}_ring", "ring", ring.moved(R, p)),
            Piece(f"link_{link}_cap", "cap", cap.moved(R, p)),
        ]  # fmt: skip


def _Convex(name: str, look: str, seen: Solid, touched: Solid | None = None) -> Piece:
    return Piece(name, look, seen, touched or seen, SHELL)


def Link0() -> list[Piece]:
    foot = Hull2d(
        Disc(0.108, count=_FINE),
        np.array([(-0.135, y) for y in (-0.055, 0.055)]),
        np.array([(-0.11, y) for y in (-0.085, 0.085)]),
    )

    def Column(count: int) -> Solid:
        profile = [(0.104, 0), (0.1, 0.06), (0.09, 0.12), (0.086, 0.15), (0.083, 0.153)]
        return Revolve(profile, count)

    return [
        _Convex(
            "link_0_foot", "shell", Prism(foot, 0, 0.055, 0.0015), Prism(foot, 0, 0.055)
        ),
        _Convex("link_0_column", "shell", Column(_FINE), Column(_COARSE)),
    ]


def Link5() -> list[Piece]:
    """Returns the forearm: a socket, and an arm that passes the wrist at one side."""
    socket = Elbow(0.068, 0.003, 0.07, 0.2155, 0.062, 0.0)

    def Arm(count: int, steps: int) -> Solid:
        profile = Round(0.058, 0.06, 0.105, 0.02, steps)
        profile = [(0.058, 0.06), *[(r, z) for r, z in profile if z > 0.08]]
        turned = Revolve(profile, count).moved(RotX(-_HALF), (0, 0, 0.2155))
        half = Disc(0.068, count=count // 2 + 1, stop=_PI)
        half = half[half[:, 1] > 0.02]
        return Hull(turned, At(half, 0.02), At(half, 0.08))

    ring = Prism(Disc(0.069, count=_FINE), 0.009, 0.016, 0.0005)
    cap = Revolve(Round(0.036, 0.103, 0.106, 0.0006, 2)).moved(
        RotX(-_HALF), (0, 0, 0.2155)
    )
    return [
        _Convex("link_5_socket", "shell", socket.Socket(_FINE, 6),
                socket.Socket(_COARSE, 3)),
        _Convex("link_5_arm", "shell", Arm(_FINE, 6), Arm(_COARSE, 3)),
        Piece("link_5_ring", "ring", ring),
        Piece("link_5_cap", "cap", cap),
    ]  # fmt: skip


def Link6() -> list[Piece]:
    """Returns the wrist: a drum about z, and an outlet along y."""

    def Drum(count: int, steps: int) -> Solid:
        return Revolve(Round(0.06, -0.057, 0.062, 0.02, steps), count)

    def Outlet(count: int) -> Solid:
        return Revolve([(0.052, 0), (0.052, 0.055), (0.05, 0.058)], count).moved(
            RotX(-_HALF)
        )

    return [
        _Convex("link_6_drum", "shell", Drum(_FINE, 6), Drum(_COARSE, 3)),
        _Convex("link_6_outlet", "shell", Outlet(_FINE), Outlet(_COARSE)),
    ]


def Link7() -> list[Piece]:
    body = Round(0.047, -0.021, 0.034, 0.004, 3)
    return [
        Piece(
            "link_7_body", "shell", Revolve(body),
            Primitive("cylinder", (0.047, 0.055), (0, 0, 0.0065)), SHELL,
        ),
        Piece(
            "link_7_flange", "ring", Prism(Disc(0.0315, count=48), 0.033, FLANGE_Z),
            Primitive("cylinder", (0.0315, 0.012), (0, 0, 0.039)), SHELL,
        ),
    ]  # fmt: skip


def Shapes() -> list[list[Piece]]:
    """Returns the pieces of each link."""
    # Even links: the hub's axis is z through the origin, the socket lies along y.
    turn = RotX(_HALF)
    mirror = RotX(0) * np.array([[-1], [-1], [1]])  # half a turn about z
    return [
        Link0(),
        Elbow(0.086, 0.002, 0.05, 0.2025, 0.082, 0.098).Pieces(1, mirror),
        Elbow(0.082, 0.002, 0.06, 0.2045, 0.082, 0.098).Pieces(2, turn, (0, 0.2045, 0)),
        Elbow(0.078, 0.002, 0.06, 0.2155, 0.074, 0.088).Pieces(3),
        Elbow(0.072, 0.002, 0.06, 0.1845, 0.074, 0.088).Pieces(4, turn, (0, 0.1845, 0)),
        Link5(),
        Link6(),
        Link7(),
    ]


def Build() -> Files:
    """Returns the arm's files."""
    model = Model("iiwa14", LOOKS, "The KUKA LBR iiwa 14 R820; tools/models/iiwa14.py.")
    for i, ((mass, com, moments), pieces) in enumerate(
        zip(LINKS, Shapes(), strict=True)
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
    return model.Finish("sdf/iiwa14.sdf")
