"""Where and how the SRG can take an object: from above or from the side."""

from __future__ import annotations

import dataclasses as dc
import enum
from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import ConvexPieces, Solid
from drake_srg.common.srg_geometry import SRG
from drake_srg.planning.grasps.grasps import Grasp, Hand
from drake_srg.planning.grasps.solid_grasps import solid_pinches
from drake_srg.planning.grasps.srg_angles import (
    EMPTY_BASE_ANGLE,
    contact_angle,
    finger_joints,
    opening_angle,
    pinch_angles,
)
from drake_srg.planning.grasps.srg_fingers import SrgFingers
from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

# What the hand must clear above and below its middle [m]: half of the palm's height,
# rounded up to 0.1 mm.
_PALM_HALF_HEIGHT = np.ceil(0.5e4 * SRG.palm_height) / 1e4
# How far straight fingers reach in the palm's x, pointing a little inward of straight
# ahead [m].
_FINGERTIP_X = SRG.hinge_x + np.hypot(SRG.finger_length, SRG.face_offset)
_END_X = float(_FINGERTIP_X) + 0.001
# Base angle of the open hand that comes from the side [rad].
_SIDE_OPENING = 0.2 * SRG.full_scale
# A grasp whose base angle is closer than this to that of an empty hand [rad] cannot be
# told from an empty hand: 2.5 mm per side.
_LEAST_DIFFERENCE = 0.02
_NEAR = 0.01  # distance within which wrapped fingers have an object [m]
_UPRIGHT_WITHIN = np.deg2rad(15.0)
# An object that lies is set upright by a hand that leans from above as much as it will
# then lean from the side: the more, the farther the wrist is from the table [rad].
_LYING_TILTS = (0.1745, 0.3491, 0.5236)
# Part of the pads that must reach beyond the middle of such an object, which turns in
# the hand on its way [m].
_BEYOND = 0.005


class Approach(enum.Enum):
    """Direction from which the hand comes."""

    ABOVE = "above"
    SIDE = "side"


@dc.dataclass(frozen=True, kw_only=True)
class SrgGrasp(Grasp):
    """One way to take an object with the SRG."""

    approach: Approach
    tilt: float  # of the palm's x below the horizontal, the object upright [rad]
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
    """The SRG: takes round objects, boxes and solids that stand or lie.

    Its pads take boxes and solids, and whatever lies, from above. Round objects and
    boxes that lie are set upright.

    Args:
        approaches: Values of `Approach` to consider.
        tilts: How far the hand points down in grasps from the side [rad].
        squeeze: How far the closed command goes beyond the base and tip angles at
            contact, both together [rad]. Half of it is the position error of each joint
            (Algorithm 1), so it sets the force.
        full_scale: Base plus tip angle that closure 1 asks for; the driver's [rad].
        clearance: Distance that the hand must keep from the table [m].
    """

    approaches: Sequence[str]
    tilts: Sequence[float]
    squeeze: float
    full_scale: float = SRG.full_scale
    clearance: float = 0.005

    num_joints = num_sensors = 4
    p_GT = np.zeros(3)
    upright_within = _UPRIGHT_WITHIN

    @property
    def pinch(self) -> SrgFingers:  # type: ignore[override]  # it depends on fields
        """See `Hand`."""
        return SrgFingers(self.squeeze, self.full_scale)

    def grasps(
        self, shape: Solid, X_WO: RigidTransform, firmness: float = 1.0
    ) -> list[Grasp]:
        """See `Hand`."""
        squeeze = firmness * self.squeeze
        up_O = X_WO.rotation().matrix()[2]
        if isinstance(shape, ConvexPieces):
            if Approach.ABOVE.value not in self.approaches:
                return []
            fingers = SrgFingers(squeeze, self.full_scale)
            x, y, z = (round(float(value), 6) for value in up_O)
            return list(solid_pinches(fingers, shape, (x, y, z), self.clearance))
        found: list[SrgGrasp | None] = []
        if isinstance(shape, Sphere) or up_O[2] >= np.cos(_UPRIGHT_WITHIN):
            if Approach.ABOVE.value in self.approaches:
                found += self._from_above(shape, squeeze)
            if Approach.SIDE.value in self.approaches and not isinstance(shape, Box):
                found += [self._from_side(shape, tilt, squeeze) for tilt in self.tilts]
        elif (
            abs(up_O[2]) <= np.sin(_UPRIGHT_WITHIN)
            and Approach.ABOVE.value in self.approaches
        ):
            found += [self._lying(shape, up_O, t, squeeze) for t in _LYING_TILTS]
        return [grasp for grasp in found if grasp is not None]

    def _from_above(self, shape: Shape, squeeze: float) -> list[SrgGrasp | None]:
        upright, half_height = 0.5 * np.pi, 0.5 * shape.height
        if not isinstance(shape, Box):
            name = "from above"
            return [self._pinch(name, upright, shape.radius, half_height, 0.0, squeeze)]
        found: list[SrgGrasp | None] = []
        for axis, across_O in (("x", [1.0, 0.0, 0.0]), ("y", [0.0, 1.0, 0.0])):
            grasp = self._pinch(
                f"from above, across its {axis}",
                upright,
                shape.half_extent(np.array(across_O)),
                half_height,
                0.0,
                squeeze,
            )
            if grasp is not None:  # with either finger on either face
                found += [
                    dc.replace(grasp, across_O=sign * np.array(across_O))
                    for sign in (1.0, -1.0)
                ]
        return found

    def _lying(
        self, shape: Cylinder | Box, up_O: Vector, tilt: float, squeeze: float
    ) -> SrgGrasp | None:
        """Return a grasp from above, across the object, that leans along its axis.

        Args:
            shape: The object's.
            up_O: Upwards in the object, shape (3,); nearly across its z.
            tilt: Of the palm's x below the horizontal once the object stands [rad].
            squeeze: See the class [rad].
        """
        # Of a box, the face that is nearly level; a cylinder has none.
        up_O = np.array([up_O[0], up_O[1], 0.0])
        if isinstance(shape, Box):
            up_O = np.sign(up_O) * (np.abs(up_O) == np.abs(up_O).max())
        across_O = np.cross([0.0, 0.0, 1.0], -up_O)
        grasp = self._pinch(
            f"from above, leaning by {np.rad2deg(tilt):.0f} degrees",
            tilt,
            shape.half_extent(across_O / np.linalg.norm(across_O)),
            shape.half_extent(up_O / np.linalg.norm(up_O)),
            tilt,
            squeeze,
        )
        if grasp is None:
            return None
        return dc.replace(
            grasp,
            across_O=across_O if isinstance(shape, Box) else None,
            down_G=np.array([np.cos(tilt), 0.0, np.sin(tilt)]),
        )

    def _pinch(
        self,
        name: str,
        tilt: float,
        half_width: float,
        half_height: float,
        lean: float,
        squeeze: float,
    ) -> SrgGrasp | None:
        """Return a grasp from above with the object's middle on the palm's x.

        Args:
            name: Of the grasp.
            tilt: Of the palm's x below the horizontal, the object upright [rad].
            half_width: Of the object, along the palm's y [m].
            half_height: Of the object, as it is taken [m].
            lean: Of the palm's x from the vertical, as the object is taken [rad].
            squeeze: See the class [rad].
        """
        # How much nearer than the middle the object is at the edges of the pads.
        slope = 0.5 * SRG.pad_width * np.tan(lean)
        half_height = half_height / np.cos(lean)
        # The pads lie flat on the sides, base + tip = 90 degrees. The object's top is
        # at the root of the pads, so that as much pad as possible touches it. The ends
        # of the pads take low objects, a millimetre above the clearance.
        depth = SRG.hinge_x + SRG.base_length + 0.002
        depth = max(depth, _END_X + self.clearance - 2.0 * half_height)
        middle = depth + half_height + slope
        base, tip = pinch_angles(half_width)
        opening = opening_angle(half_width, depth)
        if opening is None or EMPTY_BASE_ANGLE - base < _LEAST_DIFFERENCE:
            return None
        if lean and middle > _FINGERTIP_X - _BEYOND:
            return None
        return self._grasp(
            Approach.ABOVE,
            tilt,
            np.array([middle, 0.0, 0.0]),
            base,
            tip,
            base_open=opening,
            closed=base + tip + squeeze,
            name=name,
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
        base = contact_angle(p_hinge, radius)
        if base is None or base > SRG.joint_limit:
            return None
        p_tip_hinge = p_hinge - SRG.base_length * np.array([np.sin(base), np.cos(base)])
        total = contact_angle(p_tip_hinge, radius)
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
            name=f"from the side, {np.rad2deg(tilt):.0f} degrees down",
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
        name: str,
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
            name: Of the grasp.
        """
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
