"""The gantry that carries a gripper over the test bench: three prismatic joints.

`gantry_turning` has a turret at its flange besides, which turns about the vertical.

At zero the flange is at the model's origin, on the table under the work, so the joint
positions are the flange's position relative to that point. Every part stays behind the
flange (x < 0) or more than half a metre above it, out of the way of a gripper that
points down, up, to the front or to a side.
"""

from __future__ import annotations

import numpy as np

from .pieces import Inertial, Piece
from .sdf import Files, Model
from .shapes import Solid, block, disc, prism, revolve, rot_x, rot_y, union_properties

LOOKS = {
    "frame": (0.80, 0.81, 0.83),
    "beam": (0.30, 0.36, 0.44),
    "metal": (0.55, 0.57, 0.60),
    "cover": (0.16, 0.17, 0.19),
}

# Travel of the flange [m]. A gripper that points down, 0.18 m long, can lift an object
# half a metre off the table and shake it by 62 mm, which is 1 g at 2 Hz.
RANGES = {"x": (-0.4, 0.4), "y": (-0.4, 0.4), "z": (0.0, 0.8)}
# Mass of each axis's own moving part [kg]: steel and aluminium sections of the drawn
# size, so much heavier than the load at the flange that it hardly disturbs the motion.
MASSES = {"x": 20.0, "y": 10.0, "z": 10.0}
# Linear motors of this size give 1 to 3 kN; 50 kg at 2 g need 1 kN. [N]
EFFORT = 2000.0
VELOCITY = 2.0  # m/s; shaking at 1 g and 2 Hz takes 0.8
ACCELERATION = 30.0  # m/s^2
DAMPING = 10.0  # N s/m, from the seals of the carriages

# The turret: a hollow-shaft servo with a gear. Its rotor makes up most of what it
# turns; 20 N m turn that at 2000 rad/s^2, far above what a gripper needs.
TURRET_MASS = 0.5  # kg
TURRET_INERTIA = 0.01  # of the rotor, behind the gear [kg m^2]
TURRET_EFFORT = 20.0  # N m
TURRET_VELOCITY = 6.0  # rad/s

_BACK = -0.2  # x of the bridge and the ram, behind the flange
_TOP = 1.08  # height of the bridge's middle
_RAIL_Y = 0.70


def _box(name: str, look: str, low: tuple, high: tuple, edge: float = 0.002) -> Piece:
    return Piece(name, look, block(low, high, edge))


def _stand() -> list[Piece]:
    """Return two posts, the rails they carry, and the tie between them."""
    pieces = []
    for y in (-_RAIL_Y, _RAIL_Y):
        low, high = y - 0.035, y + 0.035
        pieces += [
            _box("foot", "cover", (-0.89, y - 0.07, 0), (-0.73, y + 0.07, 0.012)),
            _box("post", "frame", (-0.845, low, 0.012), (-0.775, high, 0.96), 0.004),
            _box("rail", "frame", (-0.86, low, 0.96), (0.36, high, 1.03), 0.004),
            _box("guide", "metal", (-0.82, y - 0.01, 1.03), (0.34, y + 0.01, 1.042)),
        ]
    tie = (-0.845, -_RAIL_Y + 0.035, 0.90), (-0.785, _RAIL_Y - 0.035, 0.96)
    return [*pieces, _box("tie", "frame", *tie, 0.004)]


def _bridge() -> list[Piece]:
    """Return the cross beam and the shoes that ride on the rails."""
    pieces = [
        _box(
            "beam",
            "beam",
            (_BACK - 0.09, -_RAIL_Y - 0.05, _TOP - 0.03),
            (_BACK - 0.03, _RAIL_Y + 0.05, _TOP + 0.05),
            0.004,
        )
    ]
    for y in (-_RAIL_Y, _RAIL_Y):
        low = (_BACK - 0.13, y - 0.03, 1.035)
        pieces.append(_box("shoe", "cover", low, (_BACK + 0.01, y + 0.03, _TOP - 0.02)))
    for z in (_TOP - 0.015, _TOP + 0.035):
        low = (_BACK - 0.03, -_RAIL_Y + 0.05, z - 0.007)
        high = (_BACK - 0.022, _RAIL_Y - 0.05, z + 0.007)
        pieces.append(_box("guide", "metal", low, high, 0.001))
    return pieces


def _carriage() -> list[Piece]:
    """Return the saddle that rides along the bridge and guides the ram."""
    low, high = (_BACK - 0.022, -0.07, _TOP - 0.07), (_BACK - 0.004, 0.07, _TOP + 0.09)
    pieces = [_box("saddle", "cover", low, high, 0.003)]
    for z in (_TOP - 0.05, _TOP + 0.05):
        low, high = (_BACK - 0.01, -0.045, z - 0.015), (_BACK + 0.04, 0.045, z + 0.015)
        pieces.append(_box("clamp", "metal", low, high, 0.003))
    return pieces


def _ram() -> list[Piece]:
    """Return the ram, the arm at its foot, and the head at the flange."""
    half = 0.024
    center = _BACK + 0.02

    def rod(radius: float, length: float, x: float) -> Solid:
        return prism(disc(radius), 0, length, 0.001).moved(rot_y(np.pi / 2), (x, 0, 0))

    ball = [
        (0.026 * np.cos(a), 0.026 * np.sin(a)) for a in np.linspace(-1.57, 1.57, 13)
    ]
    return [
        _box(
            "ram", "frame", (center - half, -half, -0.03), (center + half, half, 1.25),
            0.004,
        ),
        _box(
            "elbow", "cover", (center - 0.03, -0.03, -0.035),
            (center + 0.035, 0.03, 0.035), 0.005,
        ),
        Piece("arm", "metal", rod(0.016, -center - 0.05, center + 0.03)),
        Piece("head", "cover", revolve(ball, 32).moved(rot_x(np.pi / 2))),
    ]  # fmt: skip


def _turret() -> list[Piece]:
    """Return the ring that turns about the flange's vertical."""
    return [Piece("ring", "frame", prism(disc(0.032), 0.0, 0.014, 0.002))]


def build() -> Files:
    """Return the files of both gantries."""
    return {**_gantry("gantry"), **_gantry("gantry_turning", turret=True)}


def _gantry(name: str, *, turret: bool = False) -> Files:
    comment = "Carries a gripper over the bench, seen only; tools/models/gantry.py."
    model = Model(name, LOOKS, comment, meshes="gantry")

    def uniform(mass: float, pieces: list[Piece]) -> Inertial:
        return Inertial.uniform(mass, union_properties([p.solid for p in pieces]))

    stand = _stand()
    # Welded to the world, so its mass [kg] has no effect.
    model.AddLink("stand", stand, uniform(60.0, stand))
    links = {"x": _bridge(), "y": _carriage(), "z": _ram()}
    names = {"x": "bridge", "y": "carriage", "z": "ram"}
    for axis, pieces in links.items():
        model.AddLink(names[axis], pieces, uniform(MASSES[axis], pieces))
    for axis, parent in zip("xyz", ("stand", "bridge", "carriage"), strict=True):
        model.AddJoint(
            f"gantry_{axis}",
            parent,
            names[axis],
            [float(axis == a) for a in "xyz"],
            {
                "lower": RANGES[axis][0],
                "upper": RANGES[axis][1],
                "effort": EFFORT,
                "velocity": VELOCITY,
                "drake:acceleration": ACCELERATION,
            },
            DAMPING,
            kind="prismatic",
        )
    if turret:
        ring = _turret()
        model.AddLink("turret", ring, uniform(TURRET_MASS, ring))
        model.AddJoint(
            "gantry_yaw",
            "ram",
            "turret",
            [0.0, 0.0, 1.0],
            {
                "lower": -np.pi,
                "upper": np.pi,
                "effort": TURRET_EFFORT,
                "velocity": TURRET_VELOCITY,
            },
            damping=0.0,
            rotor_inertia=TURRET_INERTIA,
        )
    model.AddFrame("flange", "turret" if turret else "ram")
    return model.finish(f"sdf/{name}.sdf")
