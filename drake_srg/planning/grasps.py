"""Where and how the SRG can take an upright object: from above or from the side."""

from __future__ import annotations

import dataclasses as dc
import enum

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.hand_target import AxisTarget, HandTarget
from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

# Geometry of the SRG in the palm frame G (x out of the palm, fingers in the x-y plane)
# from SAKE's public gen-2 URDF and MuJoCo model [m].
_PALM_FACE = 0.072  # where it is flat
_PALM_HALF_HEIGHT = 0.0327
_HINGE_X, _HINGE_Y = 0.072569, 0.03
_BASE_LENGTH = 0.052
_PAD_START, _PAD_END = 0.009, 0.0588  # along the tip link, from its hinge
_FACE_OFFSET = 0.0092  # of finger faces, inward from the line through the hinges
# As far as straight fingers reach in x, a little inward of pointing straight ahead.
_FINGERTIP_X = _HINGE_X + np.hypot(_BASE_LENGTH + _PAD_END, _FACE_OFFSET)
_FULL_SCALE = 3.0  # base + tip angle at closure 1 [rad]
_JOINT_LIMIT = 1.94  # of base and tip [rad]
# An object whose grasp is not this far from an empty hand's [rad] cannot be told from
# nothing: at 2.5 mm a side.
_LEAST_DIFFERENCE = 0.02


class Approach(enum.Enum):
    """Direction from which the hand comes."""

    ABOVE = "above"
    SIDE = "side"


@dc.dataclass(frozen=True)
class Grasp:
    """One way to take an object; any rotation about the vertical is free."""

    approach: Approach
    tilt: float  # of the palm's x below the horizontal [rad]
    p_GO: Vector  # the object's centre in the hand, shape (3,) [m]
    closure_open: float  # lets the object pass between the fingers
    closure_closed: float  # presses on it
    base_angle: float  # expected when holding [rad]
    tip_angle: float  # expected when holding [rad]

    @property
    def name(self) -> str:
        """A few words for people."""
        if self.approach is Approach.ABOVE:
            return "from above"
        return f"from the side, {np.rad2deg(self.tilt):.0f} degrees down"

    @property
    def lean(self) -> float:
        """Angle between the object's axis and the nearest axis of the palm [rad]."""
        return min(self.tilt, abs(0.5 * np.pi - self.tilt))

    @property
    def base_angle_open(self) -> float:
        """Base angle with the hand open for the object, the tip straight [rad]."""
        return _FULL_SCALE * self.closure_open

    @property
    def up_G(self) -> Vector:
        """The vertical in the hand, shape (3,): its y stays horizontal, its x tilts."""
        return np.array([-np.sin(self.tilt), 0.0, np.cos(self.tilt)])

    @property
    def X_GO(self) -> RigidTransform:
        """Pose of the object in the hand [m]."""
        y = np.array([0.0, 1.0, 0.0])
        R_GO = RotationMatrix(np.column_stack([np.cross(y, self.up_G), y, self.up_G]))
        return RigidTransform(R_GO, self.p_GO)

    def target(self, p_WO: Vector, angle_tolerance: float = 0.002) -> HandTarget:
        """Where the hand has to be to hold the object at `p_WO`.

        Args:
            p_WO: The object's centre in world [m].
            angle_tolerance: Of the vertical in the hand [rad].
        """
        vertical = AxisTarget(self.up_G, np.array([0.0, 0.0, 1.0]), angle_tolerance)
        return HandTarget(p_WT=p_WO, p_GT=self.p_GO, axes=(vertical,))


def grasps_of(
    shape: Shape, approaches: list[str], tilts: list[float], squeeze: float
) -> list[Grasp]:
    """Return the ways to take an upright object; none where it does not fit the hand.

    Args:
        shape: The object's, round about its vertical z: a cylinder or a ball.
        approaches: Values of `Approach` to consider.
        tilts: For grasps from the side, how far the hand points down [rad].
        squeeze: Base and tip angle that the closed command asks for beyond the angles
            at contact, together [rad]. Half of it is each joint's position error
            (Algorithm 1), so it sets the force.
    """
    if isinstance(shape, Box):
        return []  # needs the turn about the vertical, which a Blob does not tell
    found: list[Grasp | None] = []
    if Approach.ABOVE.value in approaches:
        found.append(_from_above(shape, squeeze))
    if Approach.SIDE.value in approaches:
        found += [_from_side(shape, tilt, squeeze) for tilt in tilts]
    return [grasp for grasp in found if grasp is not None]


def _from_above(shape: Cylinder | Sphere, squeeze: float) -> Grasp | None:
    half_width = shape.radius
    # The pads lie flat on the sides, base + tip = 90 degrees, with the object's top at
    # the root of the pads: as much pad as there is on it. Low objects are taken by the
    # pads' ends, 6 mm above the table.
    depth = _HINGE_X + _BASE_LENGTH + 0.002
    depth = max(depth, float(_FINGERTIP_X) + 0.006 - shape.height)
    # Half the gap between vertical pads is hinge + 52 mm cos(base) - 9.2 mm.
    cosine = (half_width - _HINGE_Y + _FACE_OFFSET) / _BASE_LENGTH
    base = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    tip = 0.5 * np.pi - base
    if tip < 0.0:  # so thin that straight fingers meet it with their ends
        base, tip = _straight_base_angle(half_width), 0.0
    opening = _opening(half_width, depth)
    if opening is None or EMPTY_BASE_ANGLE - base < _LEAST_DIFFERENCE:
        return None
    return Grasp(
        approach=Approach.ABOVE,
        tilt=0.5 * np.pi,
        p_GO=np.array([depth + 0.5 * shape.height, 0.0, 0.0]),
        closure_open=opening / _FULL_SCALE,
        closure_closed=(base + tip + squeeze) / _FULL_SCALE,
        base_angle=base,
        tip_angle=tip,
    )


def _from_side(shape: Cylinder | Sphere, tilt: float, squeeze: float) -> Grasp | None:
    radius = shape.radius
    # The object nearly touches the palm, so that the fingers wrap around it and do
    # not pull it in; taken above its centre, for the wrist's sake.
    x = _PALM_FACE + radius / np.cos(tilt) + _PALM_HALF_HEIGHT * np.tan(tilt) + 0.002
    height = 0.25 * shape.height
    p_hinge = np.array([x - _HINGE_X, -_HINGE_Y])
    base = _contact_angle(p_hinge, radius)
    if base is None or base > _JOINT_LIMIT:
        return None
    p_tip_hinge = p_hinge - _BASE_LENGTH * np.array([np.sin(base), np.cos(base)])
    total = _contact_angle(p_tip_hinge, radius)
    if total is None or not 0.0 <= total - base <= _JOINT_LIMIT:
        return None
    return Grasp(
        approach=Approach.SIDE,
        tilt=tilt,
        p_GO=np.array([x + height * np.sin(tilt), 0.0, -height * np.cos(tilt)]),
        closure_open=0.2,
        closure_closed=min(1.0, (total + squeeze) / _FULL_SCALE),
        base_angle=base,
        tip_angle=total - base,
    )


def _opening(half_width: float, depth: float) -> float | None:
    """Base angle of straight fingers that clear an object by 12 mm a side [rad].

    `depth` is where the object begins, in the palm's x [m]. None if it is too wide.
    """
    along = max(depth - _HINGE_X, 0.0)
    need = half_width + 0.012 - _HINGE_Y
    angles = np.linspace(0.0, 0.5 * np.pi, 200)
    gaps = along * np.cos(angles) - _FACE_OFFSET * np.sin(angles)
    fitting = angles[gaps >= need]
    return float(fitting[-1]) if len(fitting) else None


def _straight_base_angle(half_gap: float) -> float:
    """Base angle at which the ends of straight fingers leave twice `half_gap` [rad].

    Half the gap is 30 mm + 110.8 mm cos(base) - 9.2 mm sin(base).
    """
    length = _BASE_LENGTH + _PAD_END
    reach = np.hypot(length, _FACE_OFFSET)
    phase = np.arctan2(_FACE_OFFSET, length)
    return float(np.arccos((half_gap - _HINGE_Y) / reach) - phase)


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
    cosine = float((radius + _FACE_OFFSET) / np.linalg.norm(p))
    if cosine > 1.0:
        return None
    return float(np.arccos(cosine) - np.arctan2(p[1], p[0]))
