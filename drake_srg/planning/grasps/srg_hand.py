"""Grasps of an object by the SRG, from above or from the side."""

from __future__ import annotations

import dataclasses as dc
import enum
from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.geometry import ConvexPieces, Solid
from drake_srg.common.srg_geometry import SRG
from drake_srg.planning.grasps.fingers import (
    Fingers,
    FingerState,
    Wrap,
    filled_rectangle,
    lowest,
)
from drake_srg.planning.grasps.grasps import Grasp, Hand
from drake_srg.planning.grasps.solid_grasps import solid_pinches
from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

# Room that the open hand leaves on each side of an object [m].
_CLEARANCE = 0.012


def finger_joints(base: float, tip: float) -> dict[str, float]:
    """Return the equal joint angles of both fingers by name [rad]."""
    angles = {"base": base, "tip": tip}
    sides = ("left", "right")
    return {f"{side}_{link}_joint": angles[link] for side in sides for link in angles}


def opening_angle(half_width: float, depth: float) -> float | None:
    """Return the base angle at which straight fingers clear an object [rad].

    Args:
        half_width: Half of the object's width [m].
        depth: Palm x of the object's near side [m].

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
    """Return the base and tip angles of pads that lie flat on a thing's vertical sides.

    Half the gap between vertical pads, which is half of the thing's width [m], is
    hinge_y + base_length cos(base) - face_offset.
    """
    cosine = (half_width - SRG.hinge_y + SRG.face_offset) / SRG.base_length
    base = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    tip = 0.5 * np.pi - base
    if tip < 0.0:  # so thin that straight fingers touch it with their ends
        return straight_base_angle(half_width), 0.0
    return base, tip


def wrap_angles(half_width: float, gap: float) -> tuple[float, float]:
    """Return the base and tip angles of a hand over the top of a wide thing.

    The base links are open. The faces of the tips meet the thing's upper edges, or are
    vertical if it is narrower than the space between them.

    Args:
        half_width: Half of the thing's width [m].
        gap: Gap between the base links and its top, at least 0 [m].
    """
    beyond = half_width - SRG.hinge_y - SRG.base_length
    p_edge = np.array([SRG.face_offset + gap, beyond])
    tip = contact_angle(p_edge, 0.0)
    assert tip is not None  # the edge is no nearer to the hinge than the face
    return 0.0, min(tip, 0.5 * np.pi)


def straight_base_angle(half_gap: float) -> float:
    """Return the base angle at which straight fingers' ends leave a gap [rad].

    Half the gap [m] is hinge_y + finger_length cos(base) - face_offset sin(base).
    """
    reach = np.hypot(SRG.finger_length, SRG.face_offset)
    phase = np.arctan2(SRG.face_offset, SRG.finger_length)
    return float(np.arccos((half_gap - SRG.hinge_y) / reach) - phase)


def ends_gap(q: Vector) -> float:
    """Return the gap between the ends of the pads [m]; below 0, they press together.

    Half of it is hinge_y + base_length cos(base) + pad_end cos(base + tip)
    - face_offset sin(base + tip) where both fingers are alike.

    Args:
        q: Angles of both base joints, then of both tip joints, shape (4,) [rad].
    """
    base, pad = q[:2], q[:2] + q[2:4]
    halves = SRG.hinge_y + SRG.base_length * np.cos(base)
    halves += SRG.pad_end * np.cos(pad) - SRG.face_offset * np.sin(pad)
    return float(np.sum(halves))


# Base angle at which the fingertips of an empty hand meet [rad].
EMPTY_BASE_ANGLE = straight_base_angle(0.0)


def contact_angle(p: Vector, radius: float) -> float | None:
    """Return the angle at which a closing link's face meets a circle [rad].

    The distance of the face from the circle's centre is
    p_x cos(angle) - p_y sin(angle) - face_offset. The link closes on the side on which
    that distance decreases.

    Args:
        p: The circle's centre from the link's hinge, (x, y) of the left finger [m].
        radius: Radius of the circle [m].

    Returns:
        None if the face does not meet the circle.
    """
    cosine = float((radius + SRG.face_offset) / np.linalg.norm(p))
    if cosine > 1.0:
        return None
    return float(np.arccos(cosine) - np.arctan2(p[1], p[0]))


# Distance of the backs of base link and tip from the line through the hinges, and of
# the base link's ends beyond its hinges [m] (srg_fast.sdf).
_BASE_BACK, _TIP_BACK, _HOUSING = 0.0128, 0.0088, 0.006
# In an empty hand, the pads' ends press 2 to 3 mm into each other, even if its tips
# have turned. A larger gap than this means that something is between them [m].
_LEAST_GAP = 0.0013
# A finger is straight if its tip is turned by less than this [rad], 4 mm at its end.
_STRAIGHT = 0.05
# On a height map, things look wider by up to this [m].
_BLUR = 0.004
# `squeeze` of wraps [rad]: three times the planner's default. With it, all flat boxes
# hold (experiments/grasp_width.py).
_WRAP_SQUEEZE = 1.2


@dc.dataclass(frozen=True)
class SrgFingers(Fingers):
    """The SRG: straight fingers close, then the pads turn onto the object.

    Args:
        squeeze: See `SrgHand`.
        full_scale: See `SrgHand`.
    """

    squeeze: float = 0.6
    full_scale: float = SRG.full_scale

    # Edges of the ends of straight fingers.
    deepest = SRG.hinge_x + float(np.hypot(SRG.finger_length, SRG.face_offset))
    # With a wider opening, the pads would not be parallel.
    max_width = SRG.parallel_gap - 0.01
    most_open = 0.1
    pad_width = SRG.pad_width
    palm_x = 0.0775  # of its ears
    palm_size = (SRG.palm_width, SRG.palm_height)
    wrap = Wrap(
        half_gap=SRG.hinge_y + SRG.finger_length,
        hinge_x=SRG.hinge_x,
        hinge_y=SRG.hinge_y + SRG.base_length,
        radius=float(np.hypot(SRG.pad_end, SRG.face_offset)),
        face_x=SRG.hinge_x + SRG.face_offset,
        # Flat boxes hold with gaps from -1 to 10 mm. Held by their upper edges, boxes
        # up to 170 mm wide hold (experiments/grasp_width.py).
        gap=0.006,
        widths=(max_width - _BLUR, 0.165),
    )

    def silhouette(self, half_gap: float, offsets: Vector) -> Vector:
        """Return the lower outline of the open hand, seen along its pads."""
        base = straight_base_angle(half_gap)
        along = np.array([np.cos(base), np.sin(base)])  # in |y|, x
        inwards = np.array([-np.sin(base), np.cos(base)])
        hinge = np.array([SRG.hinge_y, SRG.hinge_x])
        finger = np.concatenate(
            [
                filled_rectangle(
                    hinge + start * along - back * inwards,
                    (end - start) * along,
                    (SRG.face_offset + back) * inwards,
                )
                for start, end, back in (
                    (-_HOUSING, SRG.base_length + _HOUSING, _BASE_BACK),
                    (SRG.base_length, SRG.finger_length, _TIP_BACK),
                )
            ]
        )
        palm = np.abs(offsets) <= 0.5 * SRG.palm_width
        reach = lowest(finger, offsets, -np.inf)
        return np.where(palm, np.fmax(reach, self.palm_x), reach)

    def opened(self, half_gap: float) -> FingerState:
        """Return the open hand."""
        base = max(straight_base_angle(half_gap), 0.0)
        return FingerState(base / self.full_scale, finger_joints(base, 0.0))

    def closed(self, width: float) -> FingerState:
        """Return the hand that presses on something."""
        base, tip = pinch_angles(0.5 * width)
        return self._pressing(base, tip, self.squeeze)

    def wrapped(self, width: float) -> FingerState:
        """Return the hand that presses on a wrapped thing; needs `wrap`."""
        base, tip = wrap_angles(0.5 * width, self.wrap.gap)
        return self._pressing(base, tip, _WRAP_SQUEEZE)

    def _pressing(self, base: float, tip: float, squeeze: float) -> FingerState:
        closure = (base + tip + squeeze) / self.full_scale
        return FingerState(min(1.0, closure), finger_joints(base, tip))

    def holds(self, width: float, q: Vector, proximity: Vector) -> bool:
        """Return whether something is between the ends of the pads.

        The base links come first in `q`. The width is ignored, because a height map
        shows things too wide or too narrow. A thing that is enclosed above ends that
        meet goes unnoticed.
        """
        return ends_gap(q) > _LEAST_GAP

    def straight(self, q: Vector) -> bool:
        """Return whether all fingers of an empty hand are straight.

        The tips come last in `q`.
        """
        return bool(np.max(q[2:]) < _STRAIGHT)

    def detectable(self, width: float) -> bool:
        """Return whether the joint angles reveal a held thing of a given width [m]."""
        return width - _BLUR > 2.0 * _LEAST_GAP


# Free space that the hand needs above and below its middle [m]: half of the palm's
# height, rounded up to 0.1 mm.
_PALM_HALF_HEIGHT = np.ceil(0.5e4 * SRG.palm_height) / 1e4
_END_X = SrgFingers.deepest + 0.001  # of fingers, with a margin [m]
# Base angle of the open hand that comes from the side [rad].
_SIDE_OPENING = 0.2 * SRG.full_scale
# A grasp whose base angle is within this of an empty hand's [rad] cannot be told from
# an empty hand: 2.5 mm per side.
_LEAST_DIFFERENCE = 0.02
_NEAR = 0.01  # distance within which wrapped fingers hold an object [m]
_UPRIGHT_WITHIN = np.deg2rad(15.0)
# Tilts of the hand that sets a lying object upright [rad]. It leans as much from the
# vertical when it takes the object as from the horizontal when it sets the object down.
# A larger tilt keeps the wrist farther from the table.
_LYING_TILTS = (0.1745, 0.3491, 0.5236)
# Length of the pads that must reach beyond the middle of such an object, because it
# turns in the hand on its way [m].
_BEYOND = 0.005


class Approach(enum.Enum):
    """Direction from which the hand comes."""

    ABOVE = "above"
    SIDE = "side"


@dc.dataclass(frozen=True, kw_only=True)
class SrgGrasp(Grasp):
    """A way to take an object with the SRG."""

    approach: Approach
    tilt: float  # of the palm's x below the horizontal, the object upright [rad]
    base_angle: float  # expected when holding [rad]
    tip_angle: float  # expected when holding [rad]

    def holds(self, q: Vector, proximity: Vector) -> bool:
        """Return whether what the fingers sense may be the object, by its size.

        The base links come first in `q` and `proximity`.
        """
        if self.approach is Approach.SIDE:
            # Wrapped fingers have the object beside their base links, which do not
            # sense each other.
            return bool(np.max(proximity[:2]) < _NEAR)
        # Halfway between the angle at contact and that of an empty hand.
        limit = 0.5 * (self.base_angle + EMPTY_BASE_ANGLE)
        return bool(np.max(q[:2]) < limit)


@dc.dataclass(frozen=True)
class SrgHand(Hand):
    """The SRG: takes round objects, boxes and solids that stand or lie.

    Its pads take boxes, solids and lying objects from above. Lying round objects and
    boxes are set upright.

    Args:
        approaches: Values of `Approach` to consider.
        tilts: Angles by which the hand points down in grasps from the side [rad].
        squeeze: Excess of the closed command over the sum of the base and tip angles at
            contact [rad]. Half of it is the position error of each joint (Algorithm 1),
            so it sets the force.
        full_scale: The driver's base plus tip angle at closure 1 [rad].
        clearance: Distance that the hand must keep from the table [m].
        turn_counts: Whether the goal also fixes the yaw of objects with faces.
    """

    approaches: Sequence[str]
    tilts: Sequence[float]
    squeeze: float
    full_scale: float = SRG.full_scale
    clearance: float = 0.005
    turn_counts: bool = False

    num_joints = num_sensors = 4
    p_GT = np.zeros(3)
    upright_within = _UPRIGHT_WITHIN

    @property
    def pinch(self) -> SrgFingers:  # type: ignore[override]  # it depends on fields
        """The hand's fingers, which pinch from above."""
        return SrgFingers(self.squeeze, self.full_scale)

    def grasps(
        self, shape: Solid, X_WO: RigidTransform, firmness: float = 1.0
    ) -> list[Grasp]:
        """Return the ways to take an object; empty if it does not fit the hand."""
        firm = dc.replace(self, squeeze=firmness * self.squeeze)
        up_O = X_WO.rotation().matrix()[2]
        if isinstance(shape, ConvexPieces):
            if Approach.ABOVE.value not in self.approaches:
                return []
            x, y, z = (round(float(value), 6) for value in up_O)
            return list(solid_pinches(firm.pinch, shape, (x, y, z), self.clearance))
        found: list[SrgGrasp | None] = []
        if isinstance(shape, Sphere) or up_O[2] >= np.cos(_UPRIGHT_WITHIN):
            if Approach.ABOVE.value in self.approaches:
                found += firm._from_above(shape)
            if Approach.SIDE.value in self.approaches and not isinstance(shape, Box):
                found += [firm._from_side(shape, tilt) for tilt in self.tilts]
        elif (
            abs(up_O[2]) <= np.sin(_UPRIGHT_WITHIN)
            and Approach.ABOVE.value in self.approaches
        ):
            found += [firm._lying(shape, up_O, tilt) for tilt in _LYING_TILTS]
        return [
            dc.replace(grasp, turn_counts=self.turn_counts)
            for grasp in found
            if grasp is not None
        ]

    def _from_above(self, shape: Shape) -> list[SrgGrasp | None]:
        upright, half_height = 0.5 * np.pi, 0.5 * shape.height
        if not isinstance(shape, Box):
            return [self._pinch("from above", upright, shape.radius, half_height)]
        found: list[SrgGrasp | None] = []
        for axis, across_O in (("x", [1.0, 0.0, 0.0]), ("y", [0.0, 1.0, 0.0])):
            grasp = self._pinch(
                f"from above, across its {axis}",
                upright,
                shape.half_extent(np.array(across_O)),
                half_height,
            )
            if grasp is not None:  # with either finger on either face
                found += [
                    dc.replace(grasp, across_O=sign * np.array(across_O))
                    for sign in (1.0, -1.0)
                ]
        return found

    def _lying(
        self, shape: Cylinder | Box, up_O: Vector, tilt: float
    ) -> SrgGrasp | None:
        """Return a grasp from above, across the object, with a lean along its axis.

        Args:
            shape: The object's.
            up_O: Upward direction in the object, shape (3,); nearly perpendicular to
                its z.
            tilt: Angle of the palm's x below the horizontal once the object stands
                [rad].
        """
        # The nearly level face of a box; a cylinder has none.
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
        lean: float = 0.0,
    ) -> SrgGrasp | None:
        """Return a grasp from above with the object's middle on the palm's x.

        Args:
            name: Name of the grasp.
            tilt: Angle of the palm's x below the horizontal, the object upright [rad].
            half_width: Half of the object's width, along the palm's y [m].
            half_height: Half of the object's height, as it is taken [m].
            lean: Angle of the palm's x from the vertical, as the object is taken [rad].
        """
        # At the pads' edges, the object is nearer than at their middle by this
        # distance.
        slope = 0.5 * SRG.pad_width * np.tan(lean)
        half_height = half_height / np.cos(lean)
        # The pads lie flat on the sides, base + tip = 90 degrees. The object's top is
        # at the root of the pads, so that as much pad as possible touches it. Low
        # objects are taken with the ends of the pads, a millimetre above the clearance.
        depth = SRG.hinge_x + SRG.base_length + 0.002
        depth = max(depth, _END_X + self.clearance - 2.0 * half_height)
        middle = depth + half_height + slope
        base, tip = pinch_angles(half_width)
        opening = opening_angle(half_width, depth)
        if opening is None or EMPTY_BASE_ANGLE - base < _LEAST_DIFFERENCE:
            return None
        if lean and middle > SrgFingers.deepest - _BEYOND:
            return None
        return self._grasp(
            Approach.ABOVE,
            tilt,
            np.array([middle, 0.0, 0.0]),
            base,
            tip,
            base_open=opening,
            closed=base + tip + self.squeeze,
            name=name,
        )

    def _from_side(self, shape: Cylinder | Sphere, tilt: float) -> SrgGrasp | None:
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
            closed=total + self.squeeze,
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
            approach: Direction from which the hand comes.
            tilt: Angle of the palm's x below the horizontal [rad].
            p_GO: The object's centre in the palm, shape (3,) [m].
            base: Base angle at contact [rad].
            tip: Tip angle at contact [rad].
            base_open: Base angle of the open hand [rad].
            closed: Base plus tip angle of the closed command [rad].
            name: Name of the grasp.
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
