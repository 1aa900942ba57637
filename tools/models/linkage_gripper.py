"""The five-axis arm's gripper: a palm and two fingers, each a parallelogram of links.

Crank and rocker swing side by side, so the fingertip moves along an arc and keeps its
orientation. The thesis publishes that the gripper has eight revolute joints, a finger
that leads and one that follows, and fingertips either flat or cut to the cylinder. The
dimensions are ours.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drake_srg.objects.sdf import AddChild, sdf_text

from .linkage_pieces import (
    CRANK,
    CRANK_RANGE,
    HINGE_X,
    HINGE_Y,
    LOOKS,
    OPEN_ANGLE,
    PALM_TO_TIP,
    ROCKER,
    bar_pieces,
    bare_plastic,
    coupler_pieces,
    palm_pieces,
    rubber,
    tip_pieces,
)
from .pieces import Inertial, Piece, Proximity
from .sdf import Files, Model
from .shapes import union_properties

# Dynamixel XL330-M288-T at 5 V (ROBOTIS e-Manual): the strongest hobby-size servo that
# reports its angle, takes PWM and fits into 28 mm of height.
SERVO_TORQUE = 0.52  # N m, stalled
SERVO_SPEED = 103 * 2 * np.pi / 60  # rad/s, without load
SERVO_GEAR_RATIO = 288.4
SERVO_MASS = 0.018  # kg
# Inertia at the shaft, identified by the Rhoban team (github.com/Rhoban/bam, xl330/m1).
SERVO_INERTIA = 0.00199  # kg m^2
# Torque falls linearly to zero at full speed: back-EMF acts as a damper.
SERVO_DAMPING = SERVO_TORQUE / SERVO_SPEED  # N m s/rad
# Friction of the pins, linearised: below 0.5 % of the torque at 60 degrees/s.
PIN_DAMPING = 1e-3
DENSITY = 1200.0  # kg/m^3, of the printed links


def build() -> Files:
    """Return the gripper's files, with curved and with flat fingertips.

    `linkage_gripper_fast` and `linkage_gripper_bare` are for Drake's convex integrator,
    too, which takes no ball constraints: their passive joints mimic the crank's, which
    keeps the loops closed. `linkage_gripper_bare` has flat fingertips without rubber.
    """
    return {
        **_build("linkage_gripper"),
        **_build("linkage_gripper_flat", curved=False),
        **_build("linkage_gripper_fast", balls=False),
        **_build(
            "linkage_gripper_bare", curved=False, balls=False, material=bare_plastic
        ),
    }


def _build(
    name: str,
    curved: bool = True,
    balls: bool = True,
    material: Callable[[str], Proximity] = rubber,
) -> Files:
    comment = "A gripper of two parallelograms; see tools/models/linkage_gripper.py."
    model = Model("linkage_gripper", LOOKS, comment)

    palm = palm_pieces()
    frame = union_properties([p.solid for p in palm if p.look == "frame"])
    mass = 2 * SERVO_MASS + round(DENSITY * frame.volume, 4)
    whole = union_properties([p.solid for p in palm])
    model.AddLink("palm", palm, Inertial.uniform(mass, whole))
    for finger, h in (("master", 1), ("slave", -1)):
        _AddFinger(model, finger, h, tip_pieces(curved, material(finger)))
        if balls:
            _AddBalls(model, finger)
        else:
            _AddMimics(model, finger)
    model.AddFrame("mount", "palm")
    model.AddFrame("grasp_center", "palm", (PALM_TO_TIP, 0, 0))
    # A finger's own links overlap at the pins. The two fingers can touch each other.
    for finger in ("master", "slave"):
        links = [f"{finger}_{n}" for n in ("crank", "rocker", "tip", "coupler")]
        model.AddFilter(f"{finger}_finger", ["palm", *links])
    return model.finish(f"sdf/{name}.sdf")


def _AddFinger(model: Model, finger: str, side: int, tip: list[Piece]) -> None:
    """Add four links and four joints; `side` is the sign of the hinges' y."""
    prefix = f"{finger}_"
    # The left finger's links are turned about x so that their y also points inwards.
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
    # All four angles are equal while the loop is closed.
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
    """Join the halves of the coupler at the pins of rocker and crank."""
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
    """Make a finger's passive joints mimic its crank's."""
    for name in ("rocker", "coupler", "pin"):
        joint = model.root.find(f"joint[@name='{finger}_{name}_joint']")
        assert joint is not None
        follows = {"joint": f"{finger}_crank_joint", "multiplier": "1", "offset": "0"}
        AddChild(joint, "drake:mimic", **follows)
