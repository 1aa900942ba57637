"""Where and how the SRG can take an upright object: from above or from the side."""

from __future__ import annotations

import dataclasses as dc
import enum
from collections.abc import Sequence

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.grasps import Grasp, Hand
from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

# What the hand must clear above and below its middle [m]: half of the palm's height,
# rounded up to 0.1 mm.
_PALM_HALF_HEIGHT = np.ceil(0.5e4 * SRG.palm_height) / 1e4
# How far straight fingers reach in the palm's x, pointing a little inward of straight
# ahead [m].
_FINGERTIP_X = SRG.hinge_x + np.hypot(SRG.finger_length, SRG.face_offset)
# The open hand leaves this much room on each side of an object [m].
_CLEARANCE = 0.012
# Base angle of the open hand that comes from the side [rad].
_SIDE_OPENING = 0.2 * SRG.full_scale
# A grasp whose base angle is closer than this to that of an empty hand [rad] cannot be
# told from an empty hand: 2.5 mm per side.
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
        """See `Grasp`; the base links come first in `q` and `proximity`."""
        if self.approach is Approach.SIDE:
            # Wrapped fingers have the object beside their base links, which do not
            # sense each other.
            return bool(np.max(proximity[:2]) < _NEAR)
        # Half way between the angle at contact and that of an empty hand.
        limit = 0.5 * (self.base_angle + EMPTY_BASE_ANGLE)
        return bool(np.max(q[:2]) < limit)


@dc.dataclass(frozen=True)
class SrgHand(Hand):
    """The SRG: takes round objects that stand upright.

    Args:
        approaches: Values of `Approach` to consider.
        tilts: How far the hand points down in grasps from the side [rad].
        squeeze: How far the closed command goes beyond the base and tip angles at
            contact, both together [rad]. Half of it is the position error of each joint
            (Algorithm 1), so it sets the force.
        full_scale: Base plus tip angle that closure 1 asks for; the driver's [rad].
        pinch: See `Hand`.
    """

    approaches: Sequence[str]
    tilts: Sequence[float]
    squeeze: float
    full_scale: float = SRG.full_scale
    pinch: Fingers | None = None

    num_joints = num_sensors = 4
    p_GT = np.zeros(3)
    upright_within = _UPRIGHT_WITHIN

    def grasps(
        self, shape: Shape, axis_W: Vector, firmness: float = 1.0
    ) -> list[Grasp]:
        """See `Hand`."""
        squeeze = firmness * self.squeeze
        if isinstance(shape, Box):
            return []  # needs the turn about the vertical, which an axis lacks
        if not isinstance(shape, Sphere) and axis_W[2] < np.cos(_UPRIGHT_WITHIN):
            return []
        found: list[SrgGrasp | None] = []
        if Approach.ABOVE.value in self.approaches:
            found.append(self._from_above(shape, squeeze))
        if Approach.SIDE.value in self.approaches:
            found += [self._from_side(shape, tilt, squeeze) for tilt in self.tilts]
        return [grasp for grasp in found if grasp is not None]

    def _from_above(self, shape: Cylinder | Sphere, squeeze: float) -> SrgGrasp | None:
        half_width = shape.radius
        # The pads lie flat on the sides, base + tip = 90 degrees. The object's top is
        # at the root of the pads, so that as much pad as possible touches it. The ends
        # of the pads take low objects, 6 mm above the table.
        depth = SRG.hinge_x + SRG.base_length + 0.002
        depth = max(depth, float(_FINGERTIP_X) + 0.006 - shape.height)
        base, tip = pinch_angles(half_width)
        opening = _opening(half_width, depth)
        if opening is None or EMPTY_BASE_ANGLE - base < _LEAST_DIFFERENCE:
            return None
        return self._grasp(
            Approach.ABOVE,
            0.5 * np.pi,
            np.array([depth + 0.5 * shape.height, 0.0, 0.0]),
            base,
            tip,
            base_open=opening,
            closed=base + tip + squeeze,
        )

    def _from_side(
        self, shape: Cylinder | Sphere, tilt: float, squeeze: float
    ) -> SrgGrasp | None:
        radius = shape.radius
        # The object nearly touches the palm, so that the fingers wrap around it and do
        # not pull it in. They take it above its centre, which spares the wrist.
        x = SRG.palm_face_x + radius / np.cos(tilt)
        x = x + _PALM_HALF_HEIGHT * np.tan(tilt) + 0.002
        height = 0.25 * shape.height
        p_hinge = np.array([x - SRG.hinge_x, -SRG.hinge_y])
        base = _contact_angle(p_hinge, radius)
        if base is None or base > SRG.joint_limit:
            return None
        p_tip_hinge = p_hinge - SRG.base_length * np.array([np.sin(base), np.cos(base)])
        total = _contact_angle(p_tip_hinge, radius)
        if total is None or not 0.0 <= total - base <= SRG.joint_limit:
            return None
        return self._grasp(
            Approach.SIDE,
            tilt,
            np.array([x + height * np.sin(tilt), 0.0, -height * np.cos(tilt)]),
            base,
            total - base,
            base_open=_SIDE_OPENING,
            closed=total + squeeze,
        )

    def _grasp(
        self,
        approach: Approach,
        tilt: float,
        p_GO: Vector,
        base: float,
        tip: float,
        *,
        base_open: float,
        closed: float,
    ) -> SrgGrasp:
        """Return a grasp, its angles as closure commands of the driver.

        Args:
            approach: Where the hand comes from.
            tilt: Of the palm's x below the horizontal [rad].
            p_GO: The object's centre in the palm, shape (3,) [m].
            base: Base angle at contact [rad].
            tip: Tip angle at contact [rad].
            base_open: Base angle of the open hand [rad].
            closed: Base plus tip angle that the closed command asks for [rad].
        """
        name = "from above"
        if approach is Approach.SIDE:
            name = f"from the side, {np.rad2deg(tilt):.0f} degrees down"
        return SrgGrasp(
            name=name,
            p_GO=p_GO,
            # The palm's y stays horizontal, its x tilts.
            axis_G=np.array([-np.sin(tilt), 0.0, np.cos(tilt)]),
            closure_open=min(1.0, base_open / self.full_scale),
            closure_closed=min(1.0, closed / self.full_scale),
            fingers_open=finger_joints(base_open, 0.0),
            fingers_closed=finger_joints(base, tip),
            lean=min(tilt, abs(0.5 * np.pi - tilt)),
            approach=approach,
            tilt=tilt,
            base_angle=base,
            tip_angle=tip,
        )


def finger_joints(base: float, tip: float) -> dict[str, float]:
    """Return the joint angles of both fingers, alike, by name [rad]."""
    angles = {"base": base, "tip": tip}
    sides = ("left", "right")
    return {f"{side}_{link}_joint": angles[link] for side in sides for link in angles}


def _opening(half_width: float, depth: float) -> float | None:
    """Return the base angle at which straight fingers clear an object [rad].

    Args:
        half_width: Of the object [m].
        depth: Where the object begins in the palm's x [m].

    Returns:
        None if the object is too wide.
    """
    along = max(depth - SRG.hinge_x, 0.0)
    need = half_width + _CLEARANCE - SRG.hinge_y
    angles = np.linspace(0.0, 0.5 * np.pi, 200)
    gaps = along * np.cos(angles) - SRG.face_offset * np.sin(angles)
    fitting = angles[gaps >= need]
    return float(fitting[-1]) if len(fitting) else None


def pinch_angles(half_width: float) -> tuple[float, float]:
    """Return the base and tip angles of pads that lie on a thing's vertical sides.

    Half the gap between vertical pads is
    hinge_y + base_length cos(base) - face_offset.

    Args:
        half_width: Half of the thing's width [m].
    """
    cosine = (half_width - SRG.hinge_y + SRG.face_offset) / SRG.base_length
    base = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    tip = 0.5 * np.pi - base
    if tip < 0.0:  # so thin that straight fingers meet it with their ends
        return straight_base_angle(half_width), 0.0
    return base, tip


def wrap_angles(half_width: float, gap: float) -> tuple[float, float]:
    """Return the base and tip angles of a hand over the top of a wide thing.

    The base links are open. The faces of the tips meet the thing's upper edges, or are
    vertical if it is narrower than the space between them.

    Args:
        half_width: Half of the thing's width [m].
        gap: Between the base links and its top, at least 0 [m].
    """
    beyond = half_width - SRG.hinge_y - SRG.base_length
    p_edge = np.array([SRG.face_offset + gap, beyond])
    tip = _contact_angle(p_edge, 0.0)
    assert tip is not None  # the edge is no nearer to the hinge than the face
    return 0.0, min(tip, 0.5 * np.pi)


def straight_base_angle(half_gap: float) -> float:
    """Return the base angle at which the ends of straight fingers leave a gap [rad].

    Half the gap is hinge_y + finger_length cos(base) - face_offset sin(base).

    Args:
        half_gap: Half of the gap [m].
    """
    reach = np.hypot(SRG.finger_length, SRG.face_offset)
    phase = np.arctan2(SRG.face_offset, SRG.finger_length)
    return float(np.arccos((half_gap - SRG.hinge_y) / reach) - phase)


# Base angle at which the fingertips of an empty hand meet [rad].
EMPTY_BASE_ANGLE = straight_base_angle(0.0)


def _contact_angle(p: Vector, radius: float) -> float | None:
    """Return the angle at which a closing link's face meets a circle [rad].

    The distance of the face from the circle's centre is
    p_x cos(angle) - p_y sin(angle) - face_offset. The link closes on the side where
    that falls.

    Args:
        p: The circle's centre from the link's hinge, (x, y) of the left finger [m].
        radius: Of the circle [m].

    Returns:
        None if the face does not meet the circle.
    """
    cosine = float((radius + SRG.face_offset) / np.linalg.norm(p))
    if cosine > 1.0:
        return None
    return float(np.arccos(cosine) - np.arctan2(p[1], p[0]))
