"""Where and how the master-slave linkage gripper can take a cylinder."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.planning.grasps import Grasp, Hand
from drake_srg.types import Cylinder, Shape, Vector

# Geometry of the gripper in the palm frame G (x out of the palm, z along the pads) [m].
# Cranks of parallelograms carry the pads; they point straight ahead when the gap is
# that of the cylinder that the pads are cut to (tools/models/linkage_gripper.py).
_CRANK = 0.045
_STRAIGHT_HALF_GAP = 0.0125
_OPEN_HALF_GAP = 0.030
_OPEN_ANGLE = float(np.arcsin((_OPEN_HALF_GAP - _STRAIGHT_HALF_GAP) / _CRANK))
_CRANK_RANGE = 0.69  # of a crank from open to closed, closure 0 to 1 [rad]
_CLEARANCE = 0.012  # left on each side of an object that the open hand goes around [m]
# The rims of curved pads meet with their middles this far apart, flat ones touch [m].
_EMPTY_HALF_GAP = _STRAIGHT_HALF_GAP * (1.0 - np.cos(np.deg2rad(40.0)))
# Thinner objects could not be told from the other finger [m].
_LEAST_RADIUS = _EMPTY_HALF_GAP + 0.002


def crank_angle(half_gap: float) -> float:
    """Angle of a crank, 0 open, at which its pad is `half_gap` [m] off the middle."""
    return _OPEN_ANGLE + float(np.arcsin((_STRAIGHT_HALF_GAP - half_gap) / _CRANK))


EMPTY_ANGLE = crank_angle(_EMPTY_HALF_GAP)  # of an empty hand's cranks, closed [rad]


@dc.dataclass(frozen=True, kw_only=True)
class LinkageGrasp(Grasp):
    """A grasp with the pads along the object's axis."""

    contact_angle: float  # of the cranks when holding [rad]

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
    """

    p_GT: Vector

    num_joints = num_sensors = 2
    upright_within = np.deg2rad(3.0)

    def grasps(self, shape: Shape, axis_W: Vector) -> list[Grasp]:
        """See `Hand`."""
        if not isinstance(shape, Cylinder):
            return []
        if not _LEAST_RADIUS <= shape.radius <= _OPEN_HALF_GAP - 0.003:
            return []
        around = min(shape.radius + _CLEARANCE, _OPEN_HALF_GAP)
        contact, opening = crank_angle(shape.radius), crank_angle(around)
        return [
            LinkageGrasp(
                name="along its axis",
                p_GO=self.p_GT,
                axis_G=np.array([0.0, 0.0, 1.0]),
                closure_open=opening / _CRANK_RANGE,
                closure_closed=1.0,  # until both fingers have sensed something
                fingers_open=_cranks(opening),
                fingers_closed=_cranks(contact),
                contact_angle=contact,
            )
        ]


def _cranks(angle: float) -> dict[str, float]:
    """Joint angles of both parallelograms, all alike [rad]."""
    fingers, joints = ("master", "slave"), ("crank", "rocker", "coupler", "pin")
    return {f"{f}_{joint}_joint": angle for f in fingers for joint in joints}
