"""A five-axis arm of hobby servos: joint axes of a thesis, shapes of our own.

The thesis ("Design and application of vision-based assistive robotic arm ...") prints
the screw axes and the home pose of the tip; that is what this model keeps. What it does
not print is chosen here: servos, joint limits, links. The base frame B has joint 1's
axis as z and the mounting plane as z = 0; at zero angles the arm points along -x. All
link frames are then parallel to B.
"""

from __future__ import annotations

import dataclasses as dc
import itertools
from collections.abc import Sequence

import numpy as np
from pydrake.math import RollPitchYaw, RotationMatrix

from .sdf import Files, Inertial, Model, Piece, Pose, Primitive, Proximity, Sub
from .shapes import (
    Block,
    Disc,
    Hull2d,
    Points,
    Prism,
    Revolve,
    RotX,
    RotY,
    RotZ,
    Solid,
    UnionProperties,
)

_HALF = np.pi / 2
KGF_CM = 0.0980665  # N m

# From the thesis's screw axes [m]: a point on each joint's axis, and its direction.
# Joint 4's printed moment has the y and z of its point swapped; this is the other way
# round, which puts the roll axis 38 mm beside the plane of the arm.
ORIGINS = (
    (0.0, 0.0, 0.0),
    (0.06981, 0.0, 0.0),
    (0.11993, 0.0, 0.18974),
    (0.09593, 0.03813, 0.18974),  # x: anywhere on the axis; here the servo's horn
    (-0.11617, 0.0, 0.18974),
)
AXES = ((0, 0, 1), (0, -1, 0), (0, -1, 0), (-1, 0, 0), (0, -1, 0))
# The tip at zero angles: M of the thesis with a proper rotation, in the arm's plane.
TIP, TIP_PITCH = (-0.25308, 0.0, 0.19001), 0.0018
FLANGE = 0.095  # m from the tip, where the gripper's palm begins


@dc.dataclass(frozen=True)
class Servo:
    """A hobby servo's data sheet, and how many of it share a joint."""

    stall_torque: float  # N m
    no_load_speed: float  # rad/s
    gear_ratio: float
    count: int = 1


# DSServo DS3235SG at 7.4 V: 35 kgf cm, 0.12 s for 60 degrees, 270 degrees, 60 g
# (plexrobotics.com/en/products/dsservo-ds3235sg-35kg-servo). The ratio is its twin's,
# the Hiwonder HPS-3527SG: the same case, motor, torque and speed.
STRONG = Servo(35 * KGF_CM, np.pi / 3 / 0.12, 342.0)
# DFRobot DSS-M15S at 7 V: 12 kgf cm, 0.16 s for 60 degrees, 270 degrees, 310:1
# (wiki.dfrobot.com, SER0044).
WRIST = Servo(12 * KGF_CM, np.pi / 3 / 0.16, 310.0)
SERVOS = (STRONG, dc.replace(STRONG, count=2), STRONG, WRIST, WRIST)
SERVO_MASS = 0.065  # kg: 60 g, and 5 g for horn, screws and wire
# kg m^2. An armature of 0.028 kg m^2 was identified for the Feetech STS3215 (armature
# in trs_so_arm100 of mujoco_menagerie), which has a motor of this size and 345:1.
ROTOR_INERTIA = 0.028 / 345**2
# A servo that turns freely draws this part of its stall current (TowerPro MG995: 170 of
# 1,200 mA): the friction that this overcomes, taken as viscous, is the damping.
NO_LOAD_CURRENT = 0.14

# Degrees from home; the horns of 270-degree servos are put on so that both ends are in
# their range. The upper arm stops where it lies on its turntable, and 40 degrees behind
# home; joint 3 just before the forearm is stretched out, and before it is folded
# onto the shoulder; joint 5 before its fork meets the block that holds its servo.
LIMITS = ((-135, 135), (-40, 105), (-104, 45), (-135, 135), (-130, 130))
# rad/s^2. With these at all joints at once, with any signs, half the stall torque still
# holds the gripper with 0.1 kg in it, hand level, anywhere over the tables.
ACCELERATIONS = (12.0, 6.0, 7.0, 10.0, 8.0)

PETG = 1270.0  # kg/m^3; all brackets are printed solid
CARBON = 1600.0  # kg/m^3
LOOKS = {
    "bracket": (0.90, 0.46, 0.13),
    "case": (0.13, 0.13, 0.14),
    "horn": (0.62, 0.52, 0.30),
    "tube": (0.20, 0.20, 0.19),
    "foot": (0.30, 0.29, 0.28),
}
# Plastic on wood or plastic; the arm should touch nothing.
PLASTIC = Proximity(rigid=True, friction=0.4, resolution=0.02)

# The standard servo's case [m]: behind and before its output axis, half its width;
# then heights below the horn's outer face, and the mounting ears.
_BEHIND, _BEFORE, _HALF_WIDTH = 0.030, 0.010, 0.010
_TOP, _BOTTOM = 0.004, 0.0425
_EARS, _EARS_TOP, _EARS_BOTTOM = 0.007, 0.0145, 0.017
# Half the width of the upper arm, to the horns of the shoulder's servos.
_ARM_Y = 0.0225

Part = tuple[float, list[Piece]]  # mass [kg], spread evenly over the pieces


def _Box(name: str, look: str, low: Sequence[float], high: Sequence[float]) -> Piece:
    a, b = np.array(low), np.array(high)
    shape = Primitive("box", tuple(b - a), tuple((a + b) / 2))
    return Piece(name, look, Block(low, high, 0.0008), shape, PLASTIC)


def _Plate(name: str, outline: Points, y0: float, y1: float) -> Piece:
    """Returns a plate in the plane of the arm; the outline's corners are (x, z)."""
    solid = Prism(outline * (1, -1), y0, y1).moved(RotX(-_HALF))
    return Piece(name, "bracket", solid, solid, PLASTIC)


def _Rod(name: str, look: str, radius: float, x0: float, x1: float) -> Piece:
    """Returns a cylinder along x."""
    solid = Prism(Disc(radius), x0, x1, 0.0005).moved(RotY(_HALF))
    middle = ((x0 + x1) / 2, 0, 0)
    shape = Primitive("cylinder", (radius, x1 - x0), middle, (0, _HALF, 0))
    return Piece(name, look, solid, shape, PLASTIC)


def _Placed(pieces: Sequence[Piece], R: Points, p: Sequence[float]) -> list[Piece]:
    """Returns the pieces turned by R, then shifted by p."""

    def Touched(shape: Primitive | Solid | None) -> Primitive | Solid | None:
        if isinstance(shape, Solid):
            return shape.moved(R, p)
        if isinstance(shape, Primitive):
            turned = RotationMatrix(R) @ RotationMatrix(RollPitchYaw(shape.rpy))
            rpy = np.round(RollPitchYaw(turned).vector(), 12) + 0.0
            return dc.replace(shape, xyz=tuple(R @ shape.xyz + p), rpy=tuple(rpy))
        return shape

    return [
        dc.replace(
            piece, solid=piece.solid.moved(R, p), collision=Touched(piece.collision)
        )
        for piece in pieces
    ]


def _Servo(name: str, R: Points, p: Sequence[float]) -> Part:
    """Returns a servo whose horn ends at p; its output is R's z, its case along -x."""
    horn = Prism(Disc(0.010), -0.003, 0, 0.0003)
    boss = Prism(Disc(0.006), -_TOP - 0.0001, -0.002)
    pieces = [
        _Box(
            f"{name}_case",
            "case",
            (-_BEHIND, -_HALF_WIDTH, -_BOTTOM),
            (_BEFORE, _HALF_WIDTH, -_TOP),
        ),
        _Box(
            f"{name}_ears",
            "case",
            (-_BEHIND - _EARS, -_HALF_WIDTH, -_EARS_BOTTOM),
            (_BEFORE + _EARS, _HALF_WIDTH, -_EARS_TOP),
        ),
        Piece(f"{name}_horn", "horn", horn, horn, PLASTIC),
        Piece(f"{name}_boss", "case", boss),
    ]
    return SERVO_MASS, _Placed(pieces, R, p)


def _Printed(*pieces: Piece) -> Part:
    volume = UnionProperties([piece.solid for piece in pieces]).volume
    return PETG * volume, list(pieces)


def _Rectangle(x0: float, z0: float, x1: float, z1: float) -> Points:
    return np.array([(x0, z0), (x1, z0), (x1, z1), (x0, z1)])


def Base() -> list[Part]:
    """Returns the pedestal, which hides the servo of joint 1."""
    corners = [(x, y) for x in (-0.055, 0.055) for y in (-0.055, 0.055)]
    foot = Prism(Hull2d(*(Disc(0.012, c) for c in corners)), -0.080, -0.074, 0.001)
    drum = Revolve([(0.056, -0.0745), (0.050, -0.037)])
    screws = [Prism(Disc(0.004, c), -0.0745, -0.0725, 0.0005) for c in corners]
    printed = _Printed(
        Piece("foot", "foot", foot, foot, PLASTIC),
        Piece("drum", "foot", drum, drum, PLASTIC),
    )
    return [printed, (0.004, [Piece("screw", "horn", screw) for screw in screws])]


def Link1() -> list[Part]:
    """Returns the turntable, and on it the two servos of joint 2 in their plates."""
    x, _, z = ORIGINS[1]
    rear = [(a, b) for a in (x - 0.036, x + 0.018) for b in (-0.066, 0.066)]
    table = Prism(Hull2d(Disc(0.046), np.array(rear)), -0.036, -0.031, 0.0005)
    parts = [_Printed(Piece("turntable", "bracket", table, table, PLASTIC))]
    for side, sign in (("left", 1), ("right", -1)):
        # The horns face each other; the cases reach back towards joint 1.
        p = (x, sign * _ARM_Y, z)
        parts.append(_Servo(f"shoulder_{side}", RotX(sign * _HALF), p))
        y = sign * (_ARM_Y + _EARS_BOTTOM)
        plate = _Rectangle(x - 0.0385, -0.0315, x + 0.018, 0.011)
        edges = sorted((y, y + sign * 0.003))
        parts.append(_Printed(_Plate(f"shoulder_{side}_plate", plate, *edges)))
    return parts


def Link2() -> list[Part]:
    """Returns the upper arm, with the servo of joint 3 between its two plates."""
    dx, _, dz = np.subtract(ORIGINS[2], ORIGINS[1])
    length = np.hypot(dx, dz)
    lean = RotY(np.arctan2(dx, dz))
    outline = Hull2d(Disc(0.012), Disc(0.0125, (0, length)))
    inner = _ARM_Y - 0.003
    printed = [
        _Plate("upper_arm_right", outline, -_ARM_Y, -inner),
        _Plate("upper_arm_left", outline, inner, _ARM_Y),
    ]
    for i, z in enumerate((0.045, 0.115)):
        low, high = (-0.008, -inner, z - 0.010), (0.008, inner, z + 0.010)
        printed.append(_Box(f"upper_arm_spacer_{i + 1}", "bracket", low, high))
    # The case hangs down between the plates, its horn comes out at the left.
    case = (_BOTTOM - _TOP) / 2
    R = lean @ RotX(-_HALF) @ RotZ(-_HALF)
    servo = _Servo("elbow", R, lean @ (0, case + _TOP, length))
    return [_Printed(*_Placed(printed, lean, (0, 0, 0))), servo]


def Link3() -> list[Part]:
    """Returns the elbow: a plate on joint 3's horn, and the servo of joint 4 on it."""
    x, y, _ = np.subtract(ORIGINS[3], ORIGINS[2])
    inside = (_BOTTOM + _TOP) / 2
    outline = Hull2d(Disc(0.013), _Rectangle(-0.018, -0.012, 0.018, 0.034))
    ears = x + _EARS_BOTTOM
    return [
        _Printed(
            _Plate("elbow_plate", outline, inside, y - _HALF_WIDTH),
            _Box(
                "elbow_bracket",
                "bracket",
                (ears, y - _HALF_WIDTH - 0.001, -0.018),
                (ears + 0.003, y + 0.012, 0.038),
            ),
        ),
        _Servo("roll", RotY(-_HALF) @ RotZ(np.pi), (x, y, 0)),
    ]


def Link4() -> list[Part]:
    """Returns the forearm: a tube on joint 4's horn, and the servo of joint 5."""
    x, y, _ = np.subtract(ORIGINS[4], ORIGINS[3])
    case = (_BOTTOM - _TOP) / 2
    back = x + 0.0365
    tube = _Rod("forearm_tube", "tube", 0.008, back - 0.004, -0.004)
    # 16 mm outside, 14 mm inside.
    mass = CARBON * np.pi * (0.008**2 - 0.007**2) * (-0.004 - (back - 0.004))
    return [
        (mass, [tube]),
        _Printed(
            _Rod("forearm_flange", "bracket", 0.012, -0.008, 0.0),
            _Box(
                "wrist_block",
                "bracket",
                (x + 0.025, y + case, -0.010),
                (back, 0.010, 0.010),
            ),
            _Box(
                "wrist_plate",
                "bracket",
                (x + _BEHIND, y - 0.012, -0.010),
                (back, y + case + 0.001, 0.010),
            ),
        ),
        _Servo("wrist", RotX(_HALF) @ RotZ(np.pi), (x, y - case - _TOP, 0)),
    ]


def Link5() -> list[Part]:
    """Returns the fork around joint 5's servo, and the flange for the gripper."""
    horn, pin = (_BOTTOM + _TOP) / 2, (_BOTTOM - _TOP) / 2
    flange = TIP[0] + FLANGE - ORIGINS[4][0]
    outline = Hull2d(Disc(0.009), _Rectangle(-0.034, -0.011, -0.030, 0.011))
    pivot = Prism(Disc(0.004), -horn, -pin).moved(RotX(_HALF))
    return [
        _Printed(
            _Plate("fork_right", outline, -horn - 0.003, -horn),
            _Plate("fork_left", outline, horn, horn + 0.003),
            _Box(
                "fork_back",
                "bracket",
                (-0.037, -horn - 0.003, -0.011),
                (-0.033, horn + 0.003, 0.011),
            ),
            _Rod("flange", "bracket", 0.011, flange, -0.0365),
        ),
        (0.003, [Piece("pivot", "horn", pivot, pivot, PLASTIC)]),
    ]


def _Inertial(parts: Sequence[Part]) -> Inertial:
    """Returns the inertia of all parts together."""
    properties = [UnionProperties([q.solid for q in pieces]) for _, pieces in parts]
    masses = np.array([mass for mass, _ in parts])
    com = masses @ [p.center for p in properties] / masses.sum()
    inertia = np.zeros((3, 3))
    for mass, p in zip(masses, properties, strict=True):
        d = p.center - com
        inertia += mass * (p.inertia / p.volume + d @ d * np.eye(3) - np.outer(d, d))
    return Inertial(round(masses.sum(), 4), com, inertia)


def Build() -> Files:
    """Returns the arm's files."""
    comment = "A five-axis arm of hobby servos; tools/models/assistive_arm.py."
    model = Model("assistive_arm", LOOKS, comment)
    names = ["base", *(f"link_{i}" for i in range(1, 6))]
    links = (Base(), Link1(), Link2(), Link3(), Link4(), Link5())
    parent = np.zeros(3)
    for i, (name, parts) in enumerate(zip(names, links, strict=True)):
        pose = None
        if i > 0:
            origin = np.array(ORIGINS[i - 1])
            pose = (names[i - 1], np.round(origin - parent, 8), (0, 0, 0))
            parent = origin
        pieces = [piece for _, group in parts for piece in group]
        model.AddLink(name, pieces, _Inertial(parts), pose)
    for i, servo in enumerate(SERVOS):
        # Half the stall torque at up to half the no-load speed: the largest rectangle
        # under a motor's straight line from stall to no load.
        friction = NO_LOAD_CURRENT * servo.stall_torque
        model.AddJoint(
            f"joint_{i + 1}",
            names[i],
            names[i + 1],
            AXES[i],
            {
                "lower": np.radians(LIMITS[i][0]),
                "upper": np.radians(LIMITS[i][1]),
                "effort": servo.count * servo.stall_torque / 2,
                "velocity": servo.no_load_speed / 2,
                "drake:acceleration": ACCELERATIONS[i],
            },
            round(servo.count * friction / servo.no_load_speed, 4),
            servo.count * ROTOR_INERTIA,
            servo.gear_ratio,
        )
    _AddFrame(model, "tip", names[5], np.subtract(TIP, ORIGINS[4]), (0, TIP_PITCH, 0))
    _AddFrame(model, "flange", "tip", (FLANGE, 0, 0), (0, 0, np.pi))
    for one, other in itertools.pairwise(names):
        model.AddFilter(f"around_{other}", [one, other])
    return model.Finish("sdf/assistive_arm.sdf")


def _AddFrame(
    model: Model,
    name: str,
    attached_to: str,
    xyz: Sequence[float],
    rpy: Sequence[float],
) -> None:
    frame = Sub(model.root, "frame", name=name, attached_to=attached_to)
    Pose(frame, xyz, rpy)
