"""The five-axis arm's gripper: a palm and two fingers, each a parallelogram of links.

Crank and rocker swing side by side, so that the fingertip moves along an arc and keeps
its orientation. Every finger link is drawn with x along the link or, of fingertip and
coupler, along the palm's x; y inwards (the closing side) and z along the hinges, so
that both fingers share their meshes. The thesis publishes of the gripper that it has
eight revolute joints, a finger that leads and one that follows, and fingertips flat or
cut to the cylinder; the dimensions are ours. Lengths in metres.
"""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from .sdf import AddChild, Files, Inertial, Model, Piece, Primitive, Proximity, sdf_text
from .shapes import block, disc, hull_2d, prism, rot_x, rot_z, union_properties

# Where the fingers hold the middle of a 25 mm cylinder, on the palm's x axis.
PALM_TO_TIP = 0.095
OBJECT_RADIUS = 0.0125
# Dynamixel XL330-M288-T at 5 V (ROBOTIS e-Manual): a servo of hobby size that reports
# its angle and takes PWM, and the strongest of those that fit into 28 mm of height.
SERVO_TORQUE = 0.52  # N m, stalled
SERVO_SPEED = 103 * 2 * np.pi / 60  # rad/s, without load
SERVO_GEAR_RATIO = 288.4
SERVO_MASS = 0.018  # kg
SERVO_LENGTH, SERVO_WIDTH = 0.034, 0.020  # and 26 mm along its shaft
SERVO_SHAFT = 0.0095  # shaft to the case's near end
# Inertia at the shaft, identified by the Rhoban team (github.com/Rhoban/bam, xl330/m1).
SERVO_INERTIA = 0.00199  # kg m^2
# Torque falls in a straight line to zero at full speed: back-EMF is a damper.
SERVO_DAMPING = SERVO_TORQUE / SERVO_SPEED  # N m s/rad
# Friction of the pins, linearised: at 60 degrees/s below half a percent of the torque.
PIN_DAMPING = 1e-3
# Printed links.
DENSITY = 1200.0  # kg/m^3

# The crank points straight ahead when the fingers hold the cylinder: there the
# fingertips move sideways alone, and reach farthest.
CRANK = 0.045  # crank and rocker, hinge to hinge
HINGE_X, HINGE_Y = 0.028, 0.017  # palm to crank hinge
ROCKER = 0.010  # crank hinge to rocker hinge, outwards
OPEN_HALF_GAP = 0.030
OPEN_ANGLE = float(np.arcsin((OPEN_HALF_GAP - OBJECT_RADIUS) / CRANK))  # rad, outwards
CRANK_RANGE = (0.0, 0.69)  # the pads of flat fingertips meet at 0.681 rad
PAD_X = PALM_TO_TIP - HINGE_X - CRANK  # pad's middle, ahead of the crank's pin
PAD_FACE = HINGE_Y - OBJECT_RADIUS  # innermost (flat) or deepest (curved), inwards
PAD_LENGTH, PAD_THICKNESS, PAD_HALF = 0.018, 0.0025, 0.012
# Three boxes, each over 27 degrees of the cylinder: the arc ends 8 mm before and behind
# its middle, so that the fingertips stay within 9.5 mm of it. Five boxes hold as well
# and take a quarter more of the simulation's time.
ARC_BOXES, ARC_STEP = 3, np.radians(80 / 3)

# Heights above the hinges' middle plane: servo, plates of the palm, plates of crank and
# rocker. The heads of pins end at 14 mm.
_SERVO_HALF, _PLATE, _FORK = 0.0115, 0.0125, 0.0135
_LUG_HALF = 0.0123  # fingertip and coupler, between the plates of crank and rocker
_LUG = 0.004  # radius around a pin

LOOKS = {
    "frame": (0.20, 0.21, 0.23),
    "servo": (0.08, 0.08, 0.085),
    "link": (0.85, 0.36, 0.06),
    "metal": (0.45, 0.45, 0.46),
    "wedge": (0.85, 0.36, 0.06),
    "flat_pad": (0.07, 0.07, 0.075),
    "curved_pad": (0.07, 0.07, 0.075),
}

# Printed plastic on a can or on itself: handbooks give 0.3 to 0.5.
PLASTIC = Proximity(rigid=True, friction=0.4, resolution=0.005)


def rubber(finger: str) -> Proximity:
    """Returns the pad's rubber, as the SRG's; one finger's is a tenth stiffer.

    No two pads are the same, and Drake's convex integrator stops at contact that is
    exactly symmetric.
    """
    modulus = {"master": 2.0e6, "slave": 2.2e6}[finger]
    return Proximity(rigid=False, friction=0.8, modulus=modulus, dissipation=5.0)


def _box(name: str, look: str, low: tuple, high: tuple, bevel: float) -> Piece:
    low_, high_ = np.array(low), np.array(high)
    box = Primitive("box", tuple(high_ - low_), tuple((low_ + high_) / 2))
    return Piece(name, look, block(low, high, bevel), box, PLASTIC)


def _extruded(name: str, look: str, outline: np.ndarray, z0: float, z1: float) -> Piece:
    """Returns a prism whose rims are bevelled for the eye only."""
    seen, touched = prism(outline, z0, z1, 0.0004), prism(outline, z0, z1)
    return Piece(name, look, seen, touched, PLASTIC)


def _head(name: str, x: float, y: float, z0: float, s: int) -> Piece:
    """Returns the head of a pin or a screw, not touched."""
    z0, z1 = sorted((s * (z0 - 0.0004), s * (z0 + 0.0005)))
    return Piece(name, "metal", prism(disc(0.0022, (x, y), 16), z0, z1, 0.0002))


def palm_pieces() -> list[Piece]:
    """Returns the palm: +x out of the palm, the fingers' hinges along z."""
    front = HINGE_X + SERVO_SHAFT
    rear = front - SERVO_LENGTH
    side = HINGE_Y + SERVO_WIDTH / 2
    inner = HINGE_Y - SERVO_WIDTH / 2
    pieces = [
        _box("palm_mount", "frame", (0, -0.020, -0.0125), (rear, 0.020, 0.0125), 8e-4),
        _box(
            "palm_spine", "frame",
            (rear, -inner, -_SERVO_HALF), (0.031, inner, _SERVO_HALF), 6e-4,
        ),
    ]  # fmt: skip
    for hand, h in (("master", 1), ("slave", -1)):
        low, high = sorted((h * (inner + 2e-4), h * side))
        pieces.append(
            _box(
                f"palm_{hand}_servo", "servo",
                (rear + 2e-4, low, -_SERVO_HALF), (front, high, _SERVO_HALF), 1e-3,
            )
        )  # fmt: skip
    plate = np.array(
        [(x, y) for x in (rear, front - 0.002) for y in (-side + 0.004, side - 0.004)]
        + [(x, y) for x in (rear + 0.006, front - 0.006) for y in (-side, side)]
    )
    for level, s in (("upper", 1), ("lower", -1)):
        z0, z1 = sorted((s * _SERVO_HALF, s * _PLATE))
        pieces.append(_extruded(f"palm_{level}_plate", "frame", plate, z0, z1))
        for hand, h in (("master", 1), ("slave", -1)):
            ear = hull_2d(
                disc(_LUG, (HINGE_X, h * (HINGE_Y + ROCKER)), 20),
                np.array([(x, h * (side - 0.008)) for x in (0.014, front - 0.004)]),
            )
            pieces.append(_extruded(f"palm_{level}_{hand}_ear", "frame", ear, z0, z1))
            for x, y in ((0.009, 0.009), (0.009, 0.022), (0.017, 0.011)):
                pieces.append(_head("palm_screw", x, h * y, _PLATE, s))
    return pieces


def bar_pieces(name: str) -> list[Piece]:
    """Returns a crank or a rocker: two plates, held apart by a web in the middle."""
    outline = hull_2d(disc(_LUG, count=24), disc(_LUG, (CRANK, 0), 24))
    # Clear of the servo's case behind it and of the lugs in front.
    web = (0.0135, -0.0025, -_PLATE), (CRANK - 0.0065, 0.0025, _PLATE)
    pieces = [_box(f"{name}_web", "link", *web, 0.0008)]
    for level, s in (("upper", 1), ("lower", -1)):
        z0, z1 = sorted((s * _PLATE, s * _FORK))
        pieces.append(_extruded(f"{name}_{level}_plate", "link", outline, z0, z1))
        pieces += [_head(f"{name}_pin", x, 0.0, _FORK, s) for x in (0.0, CRANK)]
    return pieces


def tip_pieces(finger: str, curved: bool) -> list[Piece]:
    """Returns a fingertip: the coupler's half at the crank's pin, carrier and pad."""
    back = PAD_FACE - PAD_THICKNESS
    x0, x1 = PAD_X - 0.0094, PAD_X + 0.0094
    seam = -ROCKER / 2 + 1e-4
    lug = hull_2d(disc(_LUG, count=24), np.array([(-_LUG, seam), (_LUG, seam)]))
    arm = np.array([(-0.001, -0.0035), (0.0, 0.0038), (x0, back), (x0, -0.003)])
    carrier = (x0, -0.003, -PAD_HALF), (x1, back, PAD_HALF)
    pieces = [
        _extruded("tip_lug", "link", lug, -_LUG_HALF, _LUG_HALF),
        _extruded("tip_arm", "link", arm, -0.0085, 0.0085),
        _box("tip_carrier", "link", *carrier, 6e-4),
    ]
    for z in (-0.007, 0.007):
        head = prism(disc(0.0015, count=12), -4e-4, 5e-4, 2e-4)
        head = head.moved(rot_x(np.pi / 2), (PAD_X, -0.003, z))
        pieces.append(Piece("tip_screw", "metal", head))
    return pieces + (_arc_pads(finger) if curved else [_flat_pad(finger)])


def _flat_pad(finger: str) -> Piece:
    half, back = PAD_LENGTH / 2, PAD_FACE - PAD_THICKNESS
    low = (PAD_X - half, back, -PAD_HALF)
    high = (PAD_X + half, PAD_FACE, PAD_HALF)
    pad = _box("pad", "flat_pad", low, high, 5e-4)
    return dc.replace(pad, proximity=rubber(finger))


def _arc_pads(finger: str) -> list[Piece]:
    """Returns boxes whose faces touch the cylinder, and what holds them."""
    middle = np.array([PAD_X, PAD_FACE + OBJECT_RADIUS, 0.0])
    width = 2 * OBJECT_RADIUS * np.tan(ARC_STEP / 2)
    size = (width, PAD_THICKNESS, 2 * PAD_HALF)
    half = np.array(size) / 2
    pieces = []
    for i in range(ARC_BOXES):
        angle = (i - (ARC_BOXES - 1) / 2) * ARC_STEP
        R = rot_z(angle)
        p = middle - R @ np.array([0.0, OBJECT_RADIUS + PAD_THICKNESS / 2, 0.0])
        box = Primitive("box", size, tuple(np.round(p, 7)), (0.0, 0.0, angle))
        seen = block(-half, half).moved(R, p)
        pieces.append(Piece(f"pad_{i + 1}", "curved_pad", seen, box, rubber(finger)))
    # Behind the outer boxes, which lean away from the carrier.
    back = PAD_FACE - PAD_THICKNESS
    for end, s in (("rear", -1), ("front", 1)):
        offsets = [(0.0043, 0.0), (0.0094, 0.0), (0.0094, 0.0030)]
        wedge = np.array([(PAD_X + s * x, back + y) for x, y in offsets])
        name = f"tip_{end}_wedge"
        pieces.append(_extruded(name, "wedge", hull_2d(wedge), -PAD_HALF, PAD_HALF))
    return pieces


def coupler_pieces() -> list[Piece]:
    """Returns the coupler's half at the rocker's pin."""
    seam = ROCKER / 2 - 1e-4
    outline = hull_2d(disc(_LUG, count=24), np.array([(-_LUG, seam), (_LUG, seam)]))
    return [_extruded("coupler_lug", "link", outline, -_LUG_HALF, _LUG_HALF)]


def build() -> Files:
    """Returns the gripper's files: with curved and with flat fingertips.

    `linkage_gripper_fast` is for Drake's convex integrator, which takes no ball
    constraints: joints that follow the crank's keep its loops closed.
    """
    return {
        **_build("linkage_gripper"),
        **_build("linkage_gripper_flat", curved=False),
        **_build("linkage_gripper_fast", balls=False),
    }


def _build(name: str, curved: bool = True, balls: bool = True) -> Files:
    comment = "A gripper of two parallelograms; see tools/models/linkage_gripper.py."
    model = Model("linkage_gripper", LOOKS, comment)

    palm = palm_pieces()
    frame = union_properties([p.solid for p in palm if p.look == "frame"])
    mass = 2 * SERVO_MASS + round(DENSITY * frame.volume, 4)
    whole = union_properties([p.solid for p in palm])
    model.AddLink("palm", palm, Inertial.uniform(mass, whole))
    for finger, h in (("master", 1), ("slave", -1)):
        _AddFinger(model, finger, h, tip_pieces(finger, curved))
        if balls:
            _AddBalls(model, finger)
        else:
            _AddMimics(model, finger)
    model.AddFrame("mount", "palm")
    model.AddFrame("grasp_center", "palm", (PALM_TO_TIP, 0, 0))
    # A finger's links overlap at the pins. The two fingers do touch each other.
    for finger in ("master", "slave"):
        links = [f"{finger}_{n}" for n in ("crank", "rocker", "tip", "coupler")]
        model.AddFilter(f"{finger}_finger", ["palm", *links])
    return model.finish(f"sdf/{name}.sdf")


def _AddFinger(model: Model, finger: str, side: int, tip: list[Piece]) -> None:
    """Adds four links and four joints; `side` is the sign of the hinges' y."""
    prefix = f"{finger}_"
    # The left finger's links are turned about x, so that their y points inwards, too.
    outwards = (np.pi, 0, OPEN_ANGLE) if side > 0 else (0, 0, -OPEN_ANGLE)
    ahead = (CRANK, 0, 0), (0, 0, OPEN_ANGLE)
    for name, pieces, pose in (
        (
            "crank",
            bar_pieces("crank"),
            ("palm", (HINGE_X, side * HINGE_Y, 0), outwards),
        ),
        (
            "rocker",
            bar_pieces("rocker"),
            ("palm", (HINGE_X, side * (HINGE_Y + ROCKER), 0), outwards),
        ),
        ("tip", tip, (f"{prefix}crank", *ahead)),
        ("coupler", coupler_pieces(), (f"{prefix}rocker", *ahead)),
    ):
        properties = union_properties([p.solid for p in pieces])
        mass = round(DENSITY * properties.volume, 4)
        inertial = Inertial.uniform(mass, properties)
        model.AddLink(name, pieces, inertial, pose, prefix=prefix)
    # While the loop is closed, all four angles are the same.
    passive = {"effort": 0.0}
    model.AddJoint(
        f"{prefix}crank_joint",
        "palm",
        f"{prefix}crank",
        (0, 0, 1),
        {
            "lower": CRANK_RANGE[0],
            "upper": CRANK_RANGE[1],
            "effort": SERVO_TORQUE,
            "velocity": round(SERVO_SPEED, 3),
        },
        damping=round(SERVO_DAMPING, 4),
        rotor_inertia=SERVO_INERTIA / SERVO_GEAR_RATIO**2,
        gear_ratio=SERVO_GEAR_RATIO,
    )
    for name, parent, child, sign in (
        ("rocker", "palm", "rocker", 1),
        ("coupler", f"{prefix}crank", "tip", -1),
        ("pin", f"{prefix}rocker", "coupler", -1),
    ):
        joint, link = f"{prefix}{name}_joint", f"{prefix}{child}"
        model.AddJoint(joint, parent, link, (0, 0, sign), passive, PIN_DAMPING)


def _AddBalls(model: Model, finger: str) -> None:
    """Ties the halves of the coupler together at the pins of rocker and crank."""
    for name, p_tip, p_coupler in (
        ("rocker_pin", (0, -ROCKER, 0), (0, 0, 0)),
        ("crank_pin", (0, 0, 0), (0, ROCKER, 0)),
    ):
        ball = AddChild(model.root, "drake:ball_constraint", name=f"{finger}_{name}")
        for tag, text in (
            ("body_A", f"{finger}_tip"),
            ("body_B", f"{finger}_coupler"),
            ("p_AP", sdf_text(p_tip)),
            ("p_BQ", sdf_text(p_coupler)),
        ):
            AddChild(ball, f"drake:ball_constraint_{tag}", text)


def _AddMimics(model: Model, finger: str) -> None:
    """Makes the other joints of a finger follow its crank's."""
    for name in ("rocker", "coupler", "pin"):
        joint = model.root.find(f"joint[@name='{finger}_{name}_joint']")
        assert joint is not None
        follows = {"joint": f"{finger}_crank_joint", "multiplier": "1", "offset": "0"}
        AddChild(joint, "drake:mimic", **follows)
