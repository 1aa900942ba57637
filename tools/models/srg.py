"""The SRG: a palm and two mirrored fingers of two links each.

Every finger link is drawn with x along the link, y inwards (the closing side) and z
along its hinge, so that both fingers share their meshes. Lengths in metres.
"""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from .sdf import Files, Inertial, Model, Piece, Primitive, Proximity, VolumeMesh
from .shapes import block, disc, hull_2d, prism, revolve, rot_x, rot_y, union_properties

# SAKE's public gen-2 articulated URDF (SAKErobotics/EZGripper).
HINGE_X, HINGE_Y = 0.072569, 0.03  # palm to base hinge
BASE_LENGTH = 0.052  # base hinge to tip hinge
BASE_RANGE = TIP_RANGE = (0.0, 1.94)  # rad
VELOCITY_LIMIT = 3.67  # rad/s
PALM_MASS, FINGER_LINK_MASS = 0.3, 0.025  # kg
# Base hinge to the end of the pad, finger straight: the same URDF with its meshes.
KNUCKLE_TO_TIP = 0.1108
# From the gap of 0.0416 between the pads at a base angle of 90 degrees.
PAD_FACE = HINGE_Y - 0.0416 / 2  # 0.0092, inwards of the line through the hinges
# Bounding boxes of the vendor's STL parts.
PAD_LENGTH, PAD_WIDTH, PAD_THICKNESS = 0.0500, 0.0303, 0.0150
BASE_REAR, BASE_WIDTH, BASE_THICKNESS = 0.0096, 0.0300, 0.0220
TIP_WIDTH, TIP_THICKNESS = 0.0169, 0.0223
PALM_LENGTH, PALM_WIDTH, PALM_HEIGHT = 0.0791, 0.0816, 0.0653

# One Dynamixel MX-64 winds one wire per finger. Data sheet: 6.0 N m stall at 12 V, gear
# 200:1; the vendor's driver libezgripper allows 800 of 1023 of it.
SERVO_TORQUE = 800 / 1023 * 6.0  # N m
SERVO_GEAR_RATIO = 200.0
# Inferred: 0.0291 m of wire over the driver's 2500 of 4096 counts a turn.
SPOOL_RADIUS = 0.0076
WIRE_FORCE = SERVO_TORQUE / SPOOL_RADIUS / 2  # N, two wires share the spool: 309 N
# The wire's moment arms with the finger open and straight, from the vendor's MuJoCo
# model: they bound what a joint can get from the servo: 2.0 and 1.43 N m.
BASE_ARM, TIP_ARM = 0.0065, 0.0046275
# The MX-64's rotor inertia is not published. A coreless motor of its size (21 mm) has
# about 2.5e-7 kg m^2; each finger carries half of it, as one motor drives two wires.
ROTOR_INERTIA = 2.5e-7 / 2
# Friction of the hinge pins and of the wire on its pulleys, linearised: 2 to 3 % of the
# joint's effort at full speed, and enough for a slack finger to come to rest on its
# spring (0.006 N m/rad) without ringing.
DAMPING = 0.01

LOOKS = {
    "shell": (0.27, 0.28, 0.31),
    "servo": (0.12, 0.12, 0.13),
    "metal": (0.62, 0.63, 0.65),
    "rubber": (0.07, 0.07, 0.075),
}

# Nylon on a can or on itself: handbooks give 0.3 to 0.5.
PLASTIC = Proximity(rigid=True, friction=0.4, resolution=0.005)
# Soft rubber. Measured to hold and to place a can at steps of 1 to 10 ms. Drake meshes
# a compliant box the same at any resolution, so none is given.
RUBBER = Proximity(rigid=False, friction=0.8, modulus=2e6, dissipation=5.0)

_PLATE_IN, _PLATE_OUT = 0.0158, 0.0208  # the palm's plates hold the fingers, |z|
_NOSE = 0.0086  # radius of the base link's far end: leaves 0.2 mm to the pad


def _extruded(
    name: str, look: str, outline: np.ndarray, z0: float, z1: float, bevel: float
) -> Piece:
    """Returns a prism whose rims are bevelled for the eye only."""
    seen, touched = prism(outline, z0, z1, bevel), prism(outline, z0, z1)
    return Piece(name, look, seen, touched, PLASTIC)


def _box(name: str, look: str, low: tuple, high: tuple, bevel: float) -> Piece:
    low_, high_ = np.array(low), np.array(high)
    box = Primitive("box", tuple(high_ - low_), tuple((low_ + high_) / 2))
    return Piece(name, look, block(low, high, bevel), box, PLASTIC)


def palm_pieces() -> list[Piece]:
    """Returns the palm: +x out of the palm, fingers in the x-y plane."""
    half_y, half_z = PALM_WIDTH / 2, PALM_HEIGHT / 2
    pieces = [
        Piece(
            "palm_mount",
            "metal",
            revolve([(0.0305, 0), (0.0315, 0.001), (0.0315, 0.007), (0.0305, 0.008)])
            .moved(rot_y(np.pi / 2)),
            Primitive("cylinder", (0.0315, 0.008), (0.004, 0, 0), (0, np.pi / 2, 0)),
            PLASTIC,
        ),
        _box(
            "palm_core", "shell",
            (0.008, -0.033, -_PLATE_IN), (0.059, 0.033, _PLATE_IN), 0.0015,
        ),
        # What an object touches when it sits deep between the fingers.
        _box(
            "palm_face", "rubber",
            (0.058, -0.0188, -_PLATE_IN), (0.072, 0.0188, _PLATE_IN), 0.0015,
        ),
    ]  # fmt: skip
    plate = np.array(
        [(0.0085, y) for y in (-0.027, 0.027)]
        + [(0.026, y) for y in (-half_y, half_y)]
        + [(0.060, y) for y in (-half_y, half_y)]
        + [(0.066, y) for y in (-0.022, 0.022)]
    )
    for side, s in (("upper", 1), ("lower", -1)):
        z0, z1 = sorted((s * _PLATE_IN, s * _PLATE_OUT))
        pieces.append(_extruded(f"palm_{side}_plate", "shell", plate, z0, z1, 0.001))
        for hand, h in (("left", 1), ("right", -1)):
            ear = hull_2d(
                disc(PALM_LENGTH - HINGE_X, (HINGE_X, h * HINGE_Y), 20),
                np.array([(0.058, h * half_y), (0.058, h * 0.0165)]),
            )
            name = f"palm_{side}_{hand}_ear"
            pieces.append(_extruded(name, "shell", ear, z0, z1, 0.001))
            pin = disc(0.0035, (HINGE_X, h * HINGE_Y), 16)
            z0_, z1_ = sorted((s * (_PLATE_OUT - 0.001), s * (_PLATE_OUT + 0.001)))
            pieces.append(Piece(name + "_pin", "metal", prism(pin, z0_, z1_, 0.0004)))
        for x, y in ((0.017, 0.024), (0.017, -0.024), (0.054, 0.034), (0.054, -0.034)):
            z0, z1 = sorted((s * (_PLATE_OUT - 0.001), s * (_PLATE_OUT + 0.0006)))
            screw = prism(disc(0.0022, (x, y), 12), z0, z1, 0.0003)
            pieces.append(Piece("palm_screw", "metal", screw))
    # The servo's case below: ribs of 1 mm stand on it, touched as one box.
    x0, x1, y0, y1 = 0.0095, 0.0555, -0.0201, 0.0201
    z0, z1 = -half_z, -_PLATE_OUT + 0.001
    case = block((x0, y0, z0 + 0.001), (x1, y1, z1), 0.0015)
    box = Primitive(
        "box", (x1 - x0, y1 - y0, z1 - z0), ((x0 + x1) / 2, 0, (z0 + z1) / 2)
    )
    pieces.append(Piece("palm_servo", "servo", case, box, PLASTIC))
    for i in range(7):
        x = x0 + 0.005 + 0.006 * i
        rib = block((x - 0.0011, y0 + 0.002, z0), (x + 0.0011, y1 - 0.002, z1), 0.0006)
        pieces.append(Piece("palm_servo_rib", "servo", rib))
    cover = disc(0.0165, (0.034, 0), 32)
    z0, z1 = _PLATE_OUT - 0.001, half_z
    pieces.append(
        Piece(
            "palm_spool_cover",
            "servo",
            prism(cover, z0, z1, 0.0015),
            Primitive(
                "cylinder", (0.0165, z1 - z0), (0.034, 0, (z0 + z1) / 2), (0, 0, 0)
            ),
            PLASTIC,
        )
    )
    return pieces


def base_pieces() -> list[Piece]:
    """Returns a base link: knuckle and body, then two cheeks around the tip's lug."""
    back = PAD_FACE - BASE_THICKNESS
    half = BASE_WIDTH / 2
    body = hull_2d(
        disc(BASE_REAR, count=24),
        np.array([(0.006, PAD_FACE), (0.0375, PAD_FACE)]),
        np.array([(0.018, back), (0.030, back), (0.0375, back + 0.002)]),
    )
    half_rib = 0.008
    rib_back, rib_foot = back - 0.001, back + 0.002
    rib = np.array(
        [(0.013, rib_foot), (0.019, rib_back), (0.031, rib_back), (0.036, rib_foot)]
    )
    side = hull_2d(
        disc(0.0055, count=20),
        np.array([(0.020, -0.009), (0.033, -0.009)]),
        np.array([(0.033, 0.0055), (0.02, 0.0055)]),
    )
    # Below the arc that the pad's inner corner sweeps as the tip curls.
    cheek = hull_2d(
        disc(_NOSE, (BASE_LENGTH, 0), 24),
        np.array([(BASE_LENGTH - 0.0118, 0.0046), (0.0365, 0.0028)]),
        np.array([(0.0365, back + 0.0018), (0.042, back + 0.003)]),
    )
    pieces = [_extruded("base_body", "shell", body, -half, half, 0.0012)]
    pieces += [
        Piece("base_rib", "servo", prism(rib, -half_rib, half_rib, 0.0006)),
        Piece("base_panel", "servo", prism(side, -half - 3e-4, half + 3e-4, 0.0006)),
    ]
    for side, s in (("upper", 1), ("lower", -1)):
        z0, z1 = sorted((s * (TIP_WIDTH / 2 + 0.0005), s * half))
        name = f"base_{side}_cheek"
        pieces.append(_extruded(name, "shell", cheek, z0, z1, 0.001))
        pin = disc(0.003, (BASE_LENGTH, 0), 16)
        z0, z1 = sorted((s * (half - 0.001), s * (half + 0.0008)))
        pieces.append(Piece(name + "_pin", "metal", prism(pin, z0, z1, 0.0004)))
    return pieces


def tip_pieces(pad_resolution: float | None = None) -> list[Piece]:
    """Returns a tip link: lug and spine, the pad's carrier, the rubber pad.

    A resolution [m] makes the pad a mesh of tetrahedra instead of a box.
    """
    far = KNUCKLE_TO_TIP - BASE_LENGTH
    near = far - PAD_LENGTH
    pad_back = PAD_FACE - PAD_THICKNESS
    spine_back = PAD_FACE - TIP_THICKNESS
    spine = hull_2d(
        disc(_NOSE, count=24),
        np.array([(0.007, spine_back), (0.016, spine_back), (0.030, pad_back - 0.001)]),
        np.array([(0.030, pad_back + 0.001), (0.012, 0.004)]),
    )
    carrier = np.array(
        [
            (near + 0.001, pad_back - 0.003),
            (0.034, pad_back - 0.003),
            (far - 0.001, pad_back - 0.001),
            (far - 0.001, pad_back + 0.002),
            (near + 0.001, pad_back + 0.002),
        ]
    )
    half = PAD_WIDTH / 2
    size = (PAD_LENGTH, PAD_THICKNESS, PAD_WIDTH)
    middle = ((near + far) / 2, PAD_FACE - PAD_THICKNESS / 2, 0.0)
    pad: Primitive | VolumeMesh = Primitive("box", size, middle)
    if pad_resolution is not None:
        pad = VolumeMesh(size, middle, pad_resolution)
    # Treads of 0.8 mm across the pad; what is touched is the box around them.
    groove = PAD_FACE - 0.0008
    body = block((near, pad_back, -half), (far, groove, half), 0.0014)
    treads = []
    for x in np.linspace(near + 0.003, far - 0.003, 13):
        profile = [(x - 0.0015, groove - 0.0005), (x + 0.0015, groove - 0.0005)]
        profile += [(x + 0.0009, PAD_FACE), (x - 0.0009, PAD_FACE)]
        treads.append(prism(np.array(profile), -half + 0.001, half - 0.001))
    return [
        _extruded("tip_spine", "shell", spine, -TIP_WIDTH / 2, TIP_WIDTH / 2, 0.001),
        _extruded("tip_carrier", "shell", carrier, -half + 0.001, half - 0.001, 0.0008),
        *_screws(),
        Piece("pad", "rubber", body, pad, RUBBER),
        *[Piece("pad_tread", "rubber", ridge) for ridge in treads],
    ]


def _screws() -> list[Piece]:
    """Returns the screw heads on the back of the pad's carrier."""
    back = PAD_FACE - PAD_THICKNESS - 0.0030
    screws = []
    for z in (-0.0115, 0.0115):
        head = prism(disc(0.0017, count=12), -0.0006, 0.0008, 0.0003)
        head = head.moved(rot_x(np.pi / 2), (0.020, back, z))
        screws.append(Piece("tip_screw", "metal", head))
    return screws


# What is touched in the fast model besides the pads, as lower and upper corners. The
# faces that hold an object, of the base link and of the palm, are within 0.4 mm of the
# other model's; of the noses, which it touches beside them, the innermost line is. All
# else is within 9 mm: half of the slot between the cheeks, which the tip's lug fills.
_PALM_BOXES = {
    "palm_mount": ((0.0, -0.0265, -0.0265), (0.008, 0.0265, 0.0265)),
    "palm_body": ((0.008, -0.036, -_PLATE_OUT), (0.060, 0.036, _PLATE_OUT)),
    "palm_face": ((0.060, -0.0188, -_PLATE_IN), (0.072, 0.0188, _PLATE_IN)),
    **{
        f"palm_{side}_{hand}_ear": ((0.060, y, z), (0.0775, y + 0.0177, z + 0.005))
        for side, z in (("upper", _PLATE_IN), ("lower", -_PLATE_OUT))
        for hand, y in (("left", 0.0188), ("right", -0.0365))
    },
    "palm_servo": ((0.0095, -0.0201, -PALM_HEIGHT / 2), (0.0555, 0.0201, -_PLATE_OUT)),
    "palm_spool_cover": ((0.020, -0.014, _PLATE_OUT), (0.048, 0.014, PALM_HEIGHT / 2)),
}
_BASE_BACK, _PAD_BACK = PAD_FACE - BASE_THICKNESS, PAD_FACE - PAD_THICKNESS
_BASE_HALF, _TIP_HALF = BASE_WIDTH / 2, TIP_WIDTH / 2
_TIP_FAR = KNUCKLE_TO_TIP - BASE_LENGTH
_NOSE_HALF = 0.0022  # reaches 0.3 mm beyond the nose's circle
_BASE_BOXES = {
    "base_body": ((-0.006, _BASE_BACK, -_BASE_HALF), (0.0375, PAD_FACE, _BASE_HALF)),
    "base_cheeks": (
        (0.0375, _BASE_BACK + 0.003, -_BASE_HALF),
        (BASE_LENGTH + 0.007, 0.0046, _BASE_HALF),
    ),
    "base_upper_nose": (
        (BASE_LENGTH - _NOSE_HALF, -_NOSE, _TIP_HALF + 0.0005),
        (BASE_LENGTH + _NOSE_HALF, _NOSE, _BASE_HALF),
    ),
    "base_lower_nose": (
        (BASE_LENGTH - _NOSE_HALF, -_NOSE, -_BASE_HALF),
        (BASE_LENGTH + _NOSE_HALF, _NOSE, -_TIP_HALF - 0.0005),
    ),
}
_TIP_BOXES = {
    "tip_nose": ((-_NOSE_HALF, -_NOSE, -_TIP_HALF), (_NOSE_HALF, _NOSE, _TIP_HALF)),
    "tip_spine": ((-0.007, _PAD_BACK - 0.006, -_TIP_HALF), (0.024, 0.004, _TIP_HALF)),
    "tip_carrier": (
        (_TIP_FAR - PAD_LENGTH, _PAD_BACK - 0.003, -PAD_WIDTH / 2),
        (_TIP_FAR, _PAD_BACK, PAD_WIDTH / 2),
    ),
}


def _in_boxes(
    pieces: list[Piece], boxes: dict[str, tuple[tuple, tuple]]
) -> list[Piece]:
    """Returns pieces that look the same, and of which but the pad boxes are touched."""
    seen = [p if p.name == "pad" else dc.replace(p, collision=None) for p in pieces]
    return seen + [
        dc.replace(_box(name, "shell", low, high, 0.0), look=None)
        for name, (low, high) in boxes.items()
    ]


def build() -> Files:
    """Returns the gripper's files.

    Besides `srg`: touched as few boxes, for speed; with pads of two and of four fine
    layers.
    """
    return {
        **_build("srg"),
        **_build("srg_fast", in_boxes=True),
        **_build("srg_fine_pads", PAD_THICKNESS / 2),
        **_build("srg_finest_pads", PAD_THICKNESS / 4),
    }


def _build(
    name: str, pad_resolution: float | None = None, in_boxes: bool = False
) -> Files:
    model = Model("srg", LOOKS, "The SAKE Robotics gripper; see tools/models/srg.py.")
    palm, base, tip = palm_pieces(), base_pieces(), tip_pieces(pad_resolution)
    if in_boxes:
        palm, base = _in_boxes(palm, _PALM_BOXES), _in_boxes(base, _BASE_BOXES)
        tip = _in_boxes(tip, _TIP_BOXES)

    def uniform(mass: float, pieces: list[Piece]) -> Inertial:
        touched = [p.solid for p in pieces if p.look is not None]
        return Inertial.uniform(mass, union_properties(touched))

    model.AddLink("palm", palm, uniform(PALM_MASS, palm))
    # Open, the fingers point along +y and -y; both turn x into y, inwards.
    poses = {
        "left": ((HINGE_X, HINGE_Y, 0), (np.pi, 0, np.pi / 2)),
        "right": ((HINGE_X, -HINGE_Y, 0), (0, 0, -np.pi / 2)),
    }
    for side, (xyz, rpy) in poses.items():
        model.AddLink(
            "base_link",
            base,
            uniform(FINGER_LINK_MASS, base),
            ("palm", xyz, rpy),
            prefix=f"{side}_",
        )
    for side in poses:
        model.AddLink(
            "tip_link",
            tip,
            uniform(FINGER_LINK_MASS, tip),
            (f"{side}_base_link", (BASE_LENGTH, 0, 0), (0, 0, 0)),
            prefix=f"{side}_",
        )
    for part, parent, arm, limits in (
        ("base", "palm", BASE_ARM, BASE_RANGE),
        ("tip", "{}_base_link", TIP_ARM, TIP_RANGE),
    ):
        for side in poses:
            model.AddJoint(
                f"{side}_{part}_joint",
                parent.format(side),
                f"{side}_{part}_link",
                (0, 0, 1),
                {
                    "lower": limits[0],
                    "upper": limits[1],
                    "effort": round(WIRE_FORCE * arm, 3),
                    "velocity": VELOCITY_LIMIT,
                },
                damping=DAMPING,
                rotor_inertia=ROTOR_INERTIA,
                # Motor turns a joint turn: the wire runs at arm times joint speed.
                gear_ratio=SERVO_GEAR_RATIO * arm / SPOOL_RADIUS,
            )
    model.AddFrame("mount", "palm")
    # On the palm's axis, between the pads of straight fingers at 90 degrees, 5 mm
    # beyond their middle: a wide object held there clears the palm.
    model.AddFrame("grasp_center", "palm", (round(HINGE_X + 0.0905, 4), 0, 0))
    # A finger's own links overlap at the knuckles, and the palm's ears cover them. Left
    # and right fingers do touch each other.
    for side in poses:
        members = ["palm", f"{side}_base_link", f"{side}_tip_link"]
        model.AddFilter(f"{side}_finger", members)
    return model.finish(f"sdf/{name}.sdf")
