"""A five-axis arm of hobby servos: joint axes of a thesis, shapes of our own.

The thesis ("Design and application of vision-based assistive robotic arm ...") prints
the screw axes and the home pose of the tip, which this model keeps. It prints no
servos, joint limits or links; those are chosen here. The z axis of the base frame B is
joint 1's axis, and z = 0 is the mounting plane. At zero angles the arm points along -x
and all link frames are parallel to B.
"""

from __future__ import annotations

import dataclasses as dc
import itertools
from collections.abc import Sequence

import numpy as np

from drake_srg.objects.sdf import AddChild, AddPose

from .hobby_servo import (
    BEHIND,
    BOTTOM,
    DS3235SG,
    DSS_M15S,
    EARS_BOTTOM,
    HALF_WIDTH,
    PLASTIC,
    TOP,
    Part,
    placed,
    plastic_box,
    servo_part,
)
from .pieces import Inertial, Piece, Primitive
from .sdf import Files, Model
from .shapes import (
    Points,
    disc,
    hull_2d,
    prism,
    revolve,
    rot_x,
    rot_y,
    rot_z,
    union_properties,
)

_HALF = np.pi / 2

# From the thesis's screw axes [m]: a point on each joint's axis, and the axis. The
# printed moment of joint 4 has the y and z of its point swapped. Swapping them back
# puts the roll axis 38 mm beside the plane of the arm.
ORIGINS = (
    (0.0, 0.0, 0.0),
    (0.06981, 0.0, 0.0),
    (0.11993, 0.0, 0.18974),
    (0.09593, 0.03813, 0.18974),  # x: free along the axis; here the servo's horn
    (-0.11617, 0.0, 0.18974),
)
AXES = ((0, 0, 1), (0, -1, 0), (0, -1, 0), (-1, 0, 0), (0, -1, 0))
# The tip at zero angles: the thesis's M with a proper rotation, in the arm's plane.
TIP, TIP_PITCH = (-0.25308, 0.0, 0.19001), 0.0018
FLANGE = 0.095  # m from the tip back to the gripper's palm

# Two servos drive the shoulder.
SERVOS = (DS3235SG, dc.replace(DS3235SG, count=2), DS3235SG, DSS_M15S, DSS_M15S)
# Degrees from home. The horns are mounted so that both ends are within the range of a
# 270-degree servo. The upper arm stops level over its turntable and 40 degrees behind
# home. Joint 3 stops just before the forearm is stretched out and before it folds onto
# the shoulder, joint 5 before its fork meets the block that holds its servo.
LIMITS = ((-135, 135), (-40, 105), (-104, 45), (-135, 135), (-130, 130))
# rad/s^2. Half the stall torque suffices for these at all joints at once, with any
# signs, while the level hand carries the gripper and 0.1 kg anywhere over the tables.
ACCELERATIONS = (12.0, 6.0, 7.0, 10.0, 8.0)

PETG = 1270.0  # kg/m^3; brackets are printed solid
CARBON = 1600.0  # kg/m^3
LOOKS = {
    "bracket": (0.90, 0.46, 0.13),
    "case": (0.13, 0.13, 0.14),
    "horn": (0.62, 0.52, 0.30),
    "tube": (0.20, 0.20, 0.19),
    "foot": (0.30, 0.29, 0.28),
}
# Half the width of the upper arm: from its middle to the shoulder servos' horns.
_ARM_Y = 0.0225


def _plate(name: str, outline: Points, y0: float, y1: float) -> Piece:
    """Return a plate in the plane of the arm from an outline of (x, z) corners."""
    solid = prism(outline * (1, -1), y0, y1).moved(rot_x(-_HALF))
    return Piece(name, "bracket", solid, solid, PLASTIC)


def _rod(name: str, look: str, radius: float, x0: float, x1: float) -> Piece:
    """Return a cylinder along x."""
    solid = prism(disc(radius), x0, x1, 0.0005).moved(rot_y(_HALF))
    middle = ((x0 + x1) / 2, 0, 0)
    shape = Primitive("cylinder", (radius, x1 - x0), middle, (0, _HALF, 0))
    return Piece(name, look, solid, shape, PLASTIC)


def _printed(*pieces: Piece) -> Part:
    volume = union_properties([piece.solid for piece in pieces]).volume
    return PETG * volume, list(pieces)


def _rectangle(x0: float, z0: float, x1: float, z1: float) -> Points:
    return np.array([(x0, z0), (x1, z0), (x1, z1), (x0, z1)])


def base() -> list[Part]:
    """Return the pedestal, which encloses the servo of joint 1."""
    corners = [(x, y) for x in (-0.055, 0.055) for y in (-0.055, 0.055)]
    foot = prism(hull_2d(*(disc(0.012, c) for c in corners)), -0.080, -0.074, 0.001)
    drum = revolve([(0.056, -0.0745), (0.050, -0.037)])
    screws = [prism(disc(0.004, c), -0.0745, -0.0725, 0.0005) for c in corners]
    printed = _printed(
        Piece("foot", "foot", foot, foot, PLASTIC),
        Piece("drum", "foot", drum, drum, PLASTIC),
    )
    return [printed, (0.004, [Piece("screw", "horn", screw) for screw in screws])]


def link_1() -> list[Part]:
    """Return the turntable with the two servos of joint 2 in their plates."""
    x, _, z = ORIGINS[1]
    rear = [(a, b) for a in (x - 0.036, x + 0.018) for b in (-0.066, 0.066)]
    table = prism(hull_2d(disc(0.046), np.array(rear)), -0.036, -0.031, 0.0005)
    parts = [_printed(Piece("turntable", "bracket", table, table, PLASTIC))]
    for side, sign in (("left", 1), ("right", -1)):
        # The horns face each other; the cases point back towards joint 1.
        p = (x, sign * _ARM_Y, z)
        parts.append(servo_part(f"shoulder_{side}", rot_x(sign * _HALF), p))
        y = sign * (_ARM_Y + EARS_BOTTOM)
        plate = _rectangle(x - 0.0385, -0.0315, x + 0.018, 0.011)
        edges = sorted((y, y + sign * 0.003))
        parts.append(_printed(_plate(f"shoulder_{side}_plate", plate, *edges)))
    return parts


def link_2() -> list[Part]:
    """Return the upper arm with the servo of joint 3 between its two plates."""
    dx, _, dz = np.subtract(ORIGINS[2], ORIGINS[1])
    length = np.hypot(dx, dz)
    lean = rot_y(np.arctan2(dx, dz))
    outline = hull_2d(disc(0.012), disc(0.0125, (0, length)))
    inner = _ARM_Y - 0.003
    printed = [
        _plate("upper_arm_right", outline, -_ARM_Y, -inner),
        _plate("upper_arm_left", outline, inner, _ARM_Y),
    ]
    for i, z in enumerate((0.045, 0.115)):
        low, high = (-0.008, -inner, z - 0.010), (0.008, inner, z + 0.010)
        printed.append(plastic_box(f"upper_arm_spacer_{i + 1}", "bracket", low, high))
    # The case hangs between the plates; its horn faces left.
    case = (BOTTOM - TOP) / 2
    R = lean @ rot_x(-_HALF) @ rot_z(-_HALF)
    servo = servo_part("elbow", R, lean @ (0, case + TOP, length))
    return [_printed(*placed(printed, lean, (0, 0, 0))), servo]


def link_3() -> list[Part]:
    """Return the elbow: a plate on joint 3's horn that carries the servo of joint 4."""
    x, y, _ = np.subtract(ORIGINS[3], ORIGINS[2])
    inside = (BOTTOM + TOP) / 2
    outline = hull_2d(disc(0.013), _rectangle(-0.018, -0.012, 0.018, 0.034))
    ears = x + EARS_BOTTOM
    return [
        _printed(
            _plate("elbow_plate", outline, inside, y - HALF_WIDTH),
            plastic_box(
                "elbow_bracket",
                "bracket",
                (ears, y - HALF_WIDTH - 0.001, -0.018),
                (ears + 0.003, y + 0.012, 0.038),
            ),
        ),
        servo_part("roll", rot_y(-_HALF) @ rot_z(np.pi), (x, y, 0)),
    ]


def link_4() -> list[Part]:
    """Return the forearm: a tube on joint 4's horn, carrying the servo of joint 5."""
    x, y, _ = np.subtract(ORIGINS[4], ORIGINS[3])
    case = (BOTTOM - TOP) / 2
    back = x + 0.0365
    tube = _rod("forearm_tube", "tube", 0.008, back - 0.004, -0.004)
    # A tube of 16 mm outer and 14 mm inner diameter.
    mass = CARBON * np.pi * (0.008**2 - 0.007**2) * (-0.004 - (back - 0.004))
    return [
        (mass, [tube]),
        _printed(
            _rod("forearm_flange", "bracket", 0.012, -0.008, 0.0),
            plastic_box(
                "wrist_block",
                "bracket",
                (x + 0.025, y + case, -0.010),
                (back, 0.010, 0.010),
            ),
            plastic_box(
                "wrist_plate",
                "bracket",
                (x + BEHIND, y - 0.012, -0.010),
                (back, y + case + 0.001, 0.010),
            ),
        ),
        servo_part("wrist", rot_x(_HALF) @ rot_z(np.pi), (x, y - case - TOP, 0)),
    ]


def link_5() -> list[Part]:
    """Return the fork around joint 5's servo and the flange for the gripper."""
    horn, pin = (BOTTOM + TOP) / 2, (BOTTOM - TOP) / 2
    flange = TIP[0] + FLANGE - ORIGINS[4][0]
    outline = hull_2d(disc(0.009), _rectangle(-0.034, -0.011, -0.030, 0.011))
    pivot = prism(disc(0.004), -horn, -pin).moved(rot_x(_HALF))
    return [
        _printed(
            _plate("fork_right", outline, -horn - 0.003, -horn),
            _plate("fork_left", outline, horn, horn + 0.003),
            plastic_box(
                "fork_back",
                "bracket",
                (-0.037, -horn - 0.003, -0.011),
                (-0.033, horn + 0.003, 0.011),
            ),
            _rod("flange", "bracket", 0.011, flange, -0.0365),
        ),
        (0.003, [Piece("pivot", "horn", pivot, pivot, PLASTIC)]),
    ]


def _inertial(parts: Sequence[Part]) -> Inertial:
    """Return the combined inertia of all parts."""
    properties = [union_properties([q.solid for q in pieces]) for _, pieces in parts]
    masses = np.array([mass for mass, _ in parts])
    com = masses @ [p.center for p in properties] / masses.sum()
    inertia = np.zeros((3, 3))
    for mass, p in zip(masses, properties, strict=True):
        d = p.center - com
        inertia += mass * (p.inertia / p.volume + d @ d * np.eye(3) - np.outer(d, d))
    return Inertial(round(masses.sum(), 4), com, inertia)


def build() -> Files:
    """Return the arm's files."""
    comment = "A five-axis arm of hobby servos; tools/models/assistive_arm.py."
    model = Model("assistive_arm", LOOKS, comment)
    names = ["base", *(f"link_{i}" for i in range(1, 6))]
    links = (base(), link_1(), link_2(), link_3(), link_4(), link_5())
    parent = np.zeros(3)
    for i, (name, parts) in enumerate(zip(names, links, strict=True)):
        pose = None
        if i > 0:
            origin = np.array(ORIGINS[i - 1])
            pose = (names[i - 1], np.round(origin - parent, 8), (0, 0, 0))
            parent = origin
        pieces = [piece for _, group in parts for piece in group]
        model.AddLink(name, pieces, _inertial(parts), pose)
    for i, servo in enumerate(SERVOS):
        model.AddJoint(
            f"joint_{i + 1}",
            names[i],
            names[i + 1],
            AXES[i],
            {
                "lower": np.radians(LIMITS[i][0]),
                "upper": np.radians(LIMITS[i][1]),
                "effort": servo.effort,
                "velocity": servo.velocity,
                "drake:acceleration": ACCELERATIONS[i],
            },
            round(servo.damping, 4),
            servo.rotor_inertia,
            servo.gear_ratio,
        )
    _AddFrame(model, "tip", names[5], np.subtract(TIP, ORIGINS[4]), (0, TIP_PITCH, 0))
    _AddFrame(model, "flange", "tip", (FLANGE, 0, 0), (0, 0, np.pi))
    for one, other in itertools.pairwise(names):
        model.AddFilter(f"around_{other}", [one, other])
    return model.finish("sdf/assistive_arm.sdf")


def _AddFrame(
    model: Model,
    name: str,
    attached_to: str,
    xyz: Sequence[float],
    rpy: Sequence[float],
) -> None:
    frame = AddChild(model.root, "frame", name=name, attached_to=attached_to)
    AddPose(frame, xyz, rpy)
