"""The SRG: a palm and two mirrored fingers of two links each. Lengths in metres."""

from __future__ import annotations

import numpy as np

from drake_srg.common.srg_geometry import SRG

from .pieces import Inertial, Piece
from .sdf import Files, Model
from .shapes import union_properties
from .srg_boxes import BASE_BOXES, PALM_BOXES, TIP_BOXES, in_boxes
from .srg_pieces import (
    LOOKS,
    base_pieces,
    palm_pieces,
    tip_pieces,
)

# SAKE's public gen-2 articulated URDF (SAKErobotics/EZGripper).
PALM_MASS, FINGER_LINK_MASS = 0.3, 0.025  # kg

# One Dynamixel MX-64 winds one wire per finger. Data sheet: 6.0 N m stall at 12 V, gear
# 200:1; the vendor's driver libezgripper allows 800/1023 of that.
SERVO_TORQUE = 800 / 1023 * 6.0  # N m
SERVO_GEAR_RATIO = 200.0
# Inferred: 0.0291 m of wire over the driver's 2500 of 4096 counts a turn.
SPOOL_RADIUS = 0.0076
WIRE_FORCE = SERVO_TORQUE / SPOOL_RADIUS / 2  # N, two wires share the spool: 309 N
# The wire's moment arms with the finger open and straight, from the vendor's MuJoCo
# model. They limit the joint torques to 2.0 and 1.43 N m.
BASE_ARM, TIP_ARM = 0.0065, 0.0046275
# The MX-64's rotor inertia is not published. A coreless motor of its size (21 mm) has
# about 2.5e-7 kg m^2. One motor drives two wires, so each finger carries half of it.
ROTOR_INERTIA = 2.5e-7 / 2
# Friction of the hinge pins and of the wire on its pulleys, linearised: 2 to 3 % of the
# joint's effort at full speed, enough for a slack finger to settle on its spring
# (0.006 N m/rad) without ringing.
DAMPING = 0.01


def build() -> Files:
    """Return the gripper's files.

    `srg_fast` collides as a few boxes. `srg_fine_pads` and `srg_finest_pads` have pads
    of two and of four layers of tetrahedra.
    """
    return {
        **_build("srg"),
        **_build("srg_fast", boxes=True),
        **_build("srg_fine_pads", SRG.pad_thickness / 2),
        **_build("srg_finest_pads", SRG.pad_thickness / 4),
    }


def _build(
    name: str, pad_resolution: float | None = None, boxes: bool = False
) -> Files:
    model = Model("srg", LOOKS, "The SAKE Robotics gripper; see tools/models/srg.py.")
    palm, base, tip = palm_pieces(), base_pieces(), tip_pieces(pad_resolution)
    if boxes:
        palm, base = in_boxes(palm, PALM_BOXES), in_boxes(base, BASE_BOXES)
        tip = in_boxes(tip, TIP_BOXES)

    def uniform(mass: float, pieces: list[Piece]) -> Inertial:
        touched = [p.solid for p in pieces if p.look is not None]
        return Inertial.uniform(mass, union_properties(touched))

    model.AddLink("palm", palm, uniform(PALM_MASS, palm))
    # Open fingers point along +y and -y; a positive turn closes either one.
    poses = {
        "left": ((SRG.hinge_x, SRG.hinge_y, 0), (np.pi, 0, np.pi / 2)),
        "right": ((SRG.hinge_x, -SRG.hinge_y, 0), (0, 0, -np.pi / 2)),
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
            (f"{side}_base_link", (SRG.base_length, 0, 0), (0, 0, 0)),
            prefix=f"{side}_",
        )
    for part, parent, arm in (
        ("base", "palm", BASE_ARM),
        ("tip", "{}_base_link", TIP_ARM),
    ):
        for side in poses:
            model.AddJoint(
                f"{side}_{part}_joint",
                parent.format(side),
                f"{side}_{part}_link",
                (0, 0, 1),
                {
                    "lower": 0.0,
                    "upper": SRG.joint_limit,
                    "effort": round(WIRE_FORCE * arm, 3),
                    "velocity": SRG.joint_speed,
                },
                damping=DAMPING,
                rotor_inertia=ROTOR_INERTIA,
                # Motor turns per joint turn; the wire runs at arm times joint speed.
                gear_ratio=SERVO_GEAR_RATIO * arm / SPOOL_RADIUS,
            )
    model.AddFrame("mount", "palm")
    # On the palm's axis between the pads of straight fingers at 90 degrees, 5 mm beyond
    # the middle of the pads so that a wide object clears the palm.
    model.AddFrame("grasp_center", "palm", (SRG.grasp_center_x, 0, 0))
    # A finger's own links overlap at the knuckles, under the palm's ears. The left and
    # the right finger can touch each other.
    for side in poses:
        members = ["palm", f"{side}_base_link", f"{side}_tip_link"]
        model.AddFilter(f"{side}_finger", members)
    return model.finish(f"sdf/{name}.sdf")
