"""Where and how the SRG can take an upright object: from above or from the side."""

from __future__ import annotations

import dataclasses as dc
import enum
from collections.abc import Sequence

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.planning.grasps.grasps import Grasp, Hand
from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

# What the hand must clear above and below its middle [m]: half of the palm's height,
# rounded up to 0.1 mm.
_PALM_HALF_HEIGHT = np.ceil(0.5e4 * SRG.palm_height) / 1e4
# How far straight fingers reach in the palm's x, pointing a little inward of straight
# ahead [m].
_FINGERTIP_X = SRG.hinge_x + np.hypot(SRG.finger_length, SRG.face_offset)
# An object whose grasp is not this far from an empty hand's [rad] cannot be told from
# nothing: at 2.5 mm a side.
_LEAST_DIFFERENCE = 0.02
_NEAR = 0.01  # distance within which wrapped fingers have an object [m]
_UPRIGHT_WITHIN = np.deg2rad(15.0)


class Approach(enum.Enum):
    """Direction from which the hand comes."""

    ABOVE = "above"
    SIDE = "side"


@dc.dataclass(frozen=True, kw_only=True)
class SrgGrasp(Grasp):
    """One way to take an upright object with the SRG."""

    approach: Approach
    tilt: float  # of the palm's x below the horizontal [rad]
    base_angle: float  # expected when holding [rad]
    tip_angle: float  # expected when holding [rad]

    def holds(self, q: Vector, proximity: Vector) -> bool:
        """See `Grasp`; `q` and `proximity` begin with the two base links'."""
        if self.approach is Approach.SIDE:
            # What fingers wrap around is beside their base links, which do not sense
            # each other.
            return bool(np.max(proximity[:2]) < _NEAR)
        # Half way between the angle at contact and that of an empty hand.
        limit = 0.5 * (self.base_angle + EMPTY_BASE_ANGLE)
        return bool(np.max(q[:2]) < limit)


@dc.dataclass(frozen=True)
class SrgHand(Hand):
    """The SRG: takes round objects that stand upright.

    Args:
        approaches: Values of `Approach` to consider.
        tilts: For grasps from the side, how far the hand points down [rad].
        squeeze: Base and tip angle that the closed command asks for beyond the angles
            at contact, together [rad]. Half of it is each joint's position error
            (Algorithm 1), so it sets the force.
    """

    approaches: Sequence[str]
    tilts: Sequence[float]
    squeeze: float

    num_joints = num_sensors = 4
    p_GT = np.zeros(3)
    upright_within = _UPRIGHT_WITHIN

    def grasps(
        self, shape: Shape, axis_W: Vector, firmness: float = 1.0
    ) -> list[Grasp]:
        """See `Hand`."""
        squeeze = firmness * self.squeeze
        if isinstance(shape, Box):
            return []  # needs the turn about the vertical, which a Blob does not tell
        if not isinstance(shape, Sphere) and axis_W[2] < np.cos(_UPRIGHT_WITHIN):
            return []
        found: list[SrgGrasp | None] = []
        if Approach.ABOVE.value in self.approaches:
            found.append(_from_above(shape, squeeze))
        if Approach.SIDE.value in self.approaches:
            found += [_from_side(shape, tilt, squeeze) for tilt in self.tilts]
        return [grasp for grasp in found if grasp is not None]


def _grasp(
    approach: Approach,
    tilt: float,
    p_GO: Vector,
    base: float,
    tip: float,
    *,
    base_open: float,
    closure_closed: float,
) -> SrgGrasp:
    name = "from above"
    if approach is Approach.SIDE:
        name = f"from the side, {np.rad2deg(tilt):.0f} degrees down"
    return SrgGrasp(
        name=name,
        p_GO=p_GO,
        # The palm's y stays horizontal, its x tilts.
        axis_G=np.array([-np.sin(tilt), 0.0, np.cos(tilt)]),
        closure_open=base_open / SRG.full_scale,
        closure_closed=closure_closed,
        fingers_open=_fingers(base_open, 0.0),
        fingers_closed=_fingers(base, tip),
        lean=min(tilt, abs(0.5 * np.pi - tilt)),
        approach=approach,
        tilt=tilt,
        base_angle=base,
        tip_angle=tip,
    )


def _fingers(base: float, tip: float) -> dict[str, float]:
    angles = {"base": base, "tip": tip}
    sides = ("left", "right")
    return {f"{side}_{link}_joint": angles[link] for side in sides for link in angles}


def _from_above(shape: Cylinder | Sphere, squeeze: float) -> SrgGrasp | None:
    half_width = shape.radius
    # The pads lie flat on the sides, base + tip = 90 degrees, with the object's top at
    # the root of the pads: as much pad as there is on it. Low objects are taken by the
    # pads' ends, 6 mm above the table.
    depth = SRG.hinge_x + SRG.base_length + 0.002
    depth = max(depth, float(_FINGERTIP_X) + 0.006 - shape.height)
    # Half the gap between vertical pads is hinge + 52 mm cos(base) - 9.2 mm.
    cosine = (half_width - SRG.hinge_y + SRG.face_offset) / SRG.base_length
    base = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    tip = 0.5 * np.pi - base
    if tip < 0.0:  # so thin that straight fingers meet it with their ends
        base, tip = _straight_base_angle(half_width), 0.0
    opening = _opening(half_width, depth)
    if opening is None or EMPTY_BASE_ANGLE - base < _LEAST_DIFFERENCE:
        return None
    return _grasp(
        Approach.ABOVE,
        0.5 * np.pi,
        np.array([depth + 0.5 * shape.height, 0.0, 0.0]),
        base,
        tip,
        base_open=opening,
        closure_closed=(base + tip + squeeze) / SRG.full_scale,
    )


def _from_side(
    shape: Cylinder | Sphere, tilt: float, squeeze: float
) -> SrgGrasp | None:
    radius = shape.radius
    # The object nearly touches the palm, so that the fingers wrap around it and do
    # not pull it in; taken above its centre, for the wrist's sake.
    x = (
        SRG.palm_face_x
        + radius / np.cos(tilt)
        + _PALM_HALF_HEIGHT * np.tan(tilt)
        + 0.002
    )
    height = 0.25 * shape.height
    p_hinge = np.array([x - SRG.hinge_x, -SRG.hinge_y])
    base = _contact_angle(p_hinge, radius)
    if base is None or base > SRG.joint_limit:
        return None
    p_tip_hinge = p_hinge - SRG.base_length * np.array([np.sin(base), np.cos(base)])
    total = _contact_angle(p_tip_hinge, radius)
    if total is None or not 0.0 <= total - base <= SRG.joint_limit:
        return None
    return _grasp(
        Approach.SIDE,
        tilt,
        np.array([x + height * np.sin(tilt), 0.0, -height * np.cos(tilt)]),
        base,
        total - base,
        base_open=0.2 * SRG.full_scale,
        closure_closed=min(1.0, (total + squeeze) / SRG.full_scale),
    )


def _opening(half_width: float, depth: float) -> float | None:
    """Base angle of straight fingers that clear an object by 12 mm a side [rad].

    `depth` is where the object begins, in the palm's x [m]. None if it is too wide.
    """
    along = max(depth - SRG.hinge_x, 0.0)
    need = half_width + 0.012 - SRG.hinge_y
    angles = np.linspace(0.0, 0.5 * np.pi, 200)
    gaps = along * np.cos(angles) - SRG.face_offset * np.sin(angles)
    fitting = angles[gaps >= need]
    return float(fitting[-1]) if len(fitting) else None


def _straight_base_angle(half_gap: float) -> float:
    """Base angle at which the ends of straight fingers leave twice `half_gap` [rad].

    Half the gap is 30 mm + 110.8 mm cos(base) - 9.2 mm sin(base).
    """
    length = SRG.finger_length
    reach = np.hypot(length, SRG.face_offset)
    phase = np.arctan2(SRG.face_offset, length)
    return float(np.arccos((half_gap - SRG.hinge_y) / reach) - phase)


# Where the base links of an empty hand come to rest, fingertip on fingertip [rad].
EMPTY_BASE_ANGLE = _straight_base_angle(0.0)


def _contact_angle(p: Vector, radius: float) -> float | None:
    """Angle at which a closing link's face meets a circle [rad], None if it does not.

    The face's distance from the circle's centre is p_x cos(angle) - p_y sin(angle) -
    9.2 mm, and the link closes on the side where that falls.

    Args:
        p: The circle's centre from the link's hinge, (x, y) of the left finger [m].
        radius: Of the circle [m].
    """
    cosine = float((radius + SRG.face_offset) / np.linalg.norm(p))
    if cosine > 1.0:
        return None
    return float(np.arccos(cosine) - np.arctan2(p[1], p[0]))
