"""Where and how the master-slave linkage gripper can take a cylinder."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.planning.grasps.grasps import Grasp, Hand
from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget
from drake_srg.types import Cylinder, Shape, Vector

# Geometry of the gripper in the palm frame G (x out of the palm, z along the pads) [m].
# Cranks of parallelograms carry the pads; they point straight ahead when the gap is
# that of the cylinder that the pads are cut to (tools/models/linkage_gripper.py).
_CRANK = 0.045
_STRAIGHT_HALF_GAP = 0.0125
_OPEN_HALF_GAP = 0.030
_OPEN_ANGLE = float(np.arcsin((_OPEN_HALF_GAP - _STRAIGHT_HALF_GAP) / _CRANK))
_CLEARANCE = 0.012  # left on each side of an object that the open hand goes around [m]
# The rims of curved pads meet with their middles this far apart, flat ones touch [m].
_EMPTY_HALF_GAP = _STRAIGHT_HALF_GAP * (1.0 - np.cos(np.deg2rad(40.0)))
# Thinner objects could not be told from the other finger [m].
_LEAST_RADIUS = _EMPTY_HALF_GAP + 0.002
_LYING = np.deg2rad(5.0)  # largest angle of a lying object's axis from the level [rad]
# Closing pads turn a lying object that is across them. Each goes on by 6 degrees of its
# crank, 4.7 mm, from where it touches (60 degrees/s for the post-contact delay), which
# straightens a 25 mm cylinder from 18 degrees. The slave is late [rad].
_ACROSS = np.deg2rad(16.0)
_DOWN = np.array([0.0, 0.0, -1.0])


def crank_angle(half_gap: float) -> float:
    """Angle of a crank, 0 open, at which its pad is `half_gap` [m] off the middle."""
    return _OPEN_ANGLE + float(np.arcsin((_STRAIGHT_HALF_GAP - half_gap) / _CRANK))


EMPTY_ANGLE = crank_angle(_EMPTY_HALF_GAP)  # of an empty hand's cranks, closed [rad]


@dc.dataclass(frozen=True, kw_only=True)
class LinkageGrasp(Grasp):
    """A grasp with the pads along the object's axis."""

    contact_angle: float  # of the cranks when holding [rad]
    # For an object that lies, taken with the palm above it: how far across the pads its
    # axis may be [rad]. None takes it exactly along them, from wherever that is.
    across: float | None = None

    def pick_target(self, X_WO: RigidTransform) -> HandTarget:
        """See `Grasp`."""
        if self.across is None:
            return super().pick_target(X_WO)
        target = self.target(X_WO, angle_tolerance=max(self.across, 0.002))
        ahead = AxisTarget(np.array([1.0, 0.0, 0.0]), _DOWN, angle=0.002)
        return dc.replace(target, axes=(*target.axes, ahead))

    def holds(self, q: Vector, proximity: Vector) -> bool:
        """See `Grasp`: the cranks are not nearer to closed than to the object."""
        return bool(np.max(q) < 0.5 * (self.contact_angle + EMPTY_ANGLE))


@dc.dataclass(frozen=True)
class LinkageHand(Hand):
    """The five-axis arm's gripper: takes cylinders that stand, lean or lie.

    Pads along the axis and its middle at the tip are five conditions; they leave five
    joints no choice of where the hand comes from.

    Args:
        p_GT: The tip: where the middle of a held object is in the palm, shape (3,) [m].
        release_shift_G: How it moves as it is set down and let go, shape (3,) [m].
        full_scale: Crank angle that closure 1 asks for [rad].
    """

    p_GT: Vector
    release_shift_G: Vector = dc.field(default_factory=lambda: np.zeros(3))
    full_scale: float = 0.69

    num_joints = num_sensors = 2
    upright_within = np.deg2rad(3.0)

    def grasps(
        self, shape: Shape, axis_W: Vector, firmness: float = 1.0
    ) -> list[Grasp]:
        """See `Hand`; how firmly it closes is its driver's, not the command's."""
        if not isinstance(shape, Cylinder):
            return []
        if not _LEAST_RADIUS <= shape.radius <= _OPEN_HALF_GAP - 0.003:
            return []
        around, across, name = shape.radius + _CLEARANCE, None, "along its axis"
        if abs(axis_W[2]) <= np.sin(_LYING):
            # Across the pads it takes more of their gap than its diameter.
            across = _ACROSS if around <= _OPEN_HALF_GAP else 0.0
            around = _OPEN_HALF_GAP
            name = f"from above, at most {np.degrees(across):.0f} degrees across it"
        opening = crank_angle(min(around, _OPEN_HALF_GAP))
        contact = crank_angle(shape.radius)
        return [
            LinkageGrasp(
                name=name,
                p_GO=self.p_GT,
                axis_G=np.array([0.0, 0.0, 1.0]),
                closure_open=opening / self.full_scale,
                closure_closed=1.0,  # until both fingers have sensed something
                fingers_open=_cranks(opening),
                fingers_closed=_cranks(contact),
                contact_angle=contact,
                across=across,
                release_shift_G=self.release_shift_G,
            )
        ]


def _cranks(angle: float) -> dict[str, float]:
    """Joint angles of both parallelograms, all alike [rad]."""
    fingers, joints = ("master", "slave"), ("crank", "rocker", "coupler", "pin")
    return {f"{f}_{joint}_joint": angle for f in fingers for joint in joints}
