"""Grasps of a cylinder by the master-slave linkage gripper."""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.geometry import Solid
from drake_srg.planning.grasps.fingers import (
    Fingers,
    FingerState,
    filled_rectangle,
    lowest,
)
from drake_srg.planning.grasps.grasps import Grasp, Hand, PinchGrasp
from drake_srg.types import Cylinder, Vector

# Geometry of the gripper in the palm frame G (x out of the palm, z along the pads) [m].
# Cranks of parallelograms carry the pads. They point straight ahead when the gap fits
# the cylinder for which the pads are cut (tools/models/linkage_pieces.py).
CRANK = 0.045
_STRAIGHT_HALF_GAP = 0.0125
OPEN_HALF_GAP = 0.030
_OPEN_ANGLE = float(np.arcsin((OPEN_HALF_GAP - _STRAIGHT_HALF_GAP) / CRANK))
_CLEARANCE = 0.012  # between the open hand and each side of an object [m]
# Half the gap between the middles of curved pads whose rims meet. (Flat pads touch.)
_EMPTY_HALF_GAP = _STRAIGHT_HALF_GAP * (1.0 - np.cos(np.deg2rad(40.0)))
# A thinner object cannot be told from the other finger [m].
_LEAST_RADIUS = _EMPTY_HALF_GAP + 0.002
# Largest angle between the axis of a lying object and the horizontal [rad].
_LYING = np.deg2rad(5.0)
# Largest angle between the pads and a lying object [rad]. Closing pads straighten it:
# each crank advances by 6 degrees, or 4.7 mm, after its pad touches (60 degrees/s for
# the post-contact delay). That would straighten a 25 mm cylinder from 18 degrees. The
# slave lags, so the limit is a little less.
_ACROSS = np.deg2rad(16.0)
_AHEAD = np.array([1.0, 0.0, 0.0])
# The fingertip: distance from the pad's middle to its end, and its thickness [m]. Crank
# and rocker are behind it: distance of their back from the pad's face, and of their
# front from the pad's middle [m] (tools/models/linkage_pieces.py).
_END, _TIP, _BACK, _FRONT = 0.0094, 0.0085, 0.020, 0.016
# Box from the palm's origin that contains the hand where the pads do not reach [m].
_PALM_X, _PALM_HALF_WIDTH, _PALM_HALF_HEIGHT = 0.040, 0.030, 0.0145
# Crank angle by which a held thing must differ from an empty hand [rad].
_DETECTABLE = 0.03


def crank_angle(half_gap: float) -> float:
    """Return the crank angle, 0 open, with the pad `half_gap` [m] off the middle."""
    return _OPEN_ANGLE + float(np.arcsin((_STRAIGHT_HALF_GAP - half_gap) / CRANK))


def pads_ahead(half_gap: float) -> float:
    """Return the distance of the pads ahead of the cranks' hinges [m]."""
    return float(np.sqrt(CRANK**2 - (half_gap - _STRAIGHT_HALF_GAP) ** 2))


EMPTY_ANGLE = crank_angle(_EMPTY_HALF_GAP)  # of the cranks of an empty closed hand


def crank_joints(angle: float) -> dict[str, float]:
    """Return the joint angles of both parallelograms, all equal [rad]."""
    fingers, joints = ("master", "slave"), ("crank", "rocker", "coupler", "pin")
    return {f"{f}_{joint}_joint": angle for f in fingers for joint in joints}


@dc.dataclass(frozen=True)
class LinkageFingers(Fingers):
    """The fingers of the master-slave gripper, whose pads stay parallel.

    Args:
        tip_x: Palm x of the pads' middle, cranks straight ahead [m].
        full_scale: The driver's crank angle at closure 1 [rad].
    """

    tip_x: float = 0.095
    full_scale: float = 0.69

    max_width = 2.0 * OPEN_HALF_GAP - 0.008
    most_open = OPEN_HALF_GAP
    pad_width = 0.024
    palm_x = _PALM_X
    palm_size = (2.0 * _PALM_HALF_WIDTH, 2.0 * _PALM_HALF_HEIGHT)

    @property
    def deepest(self) -> float:  # type: ignore[override]  # it depends on a field
        """Greatest palm x of the fingers' ends [m]: the cranks point straight ahead."""
        return self.tip_x + _END

    def silhouette(self, half_gap: float, offsets: Vector) -> Vector:
        """Return the lower outline of the open hand, seen along its pads."""
        middle = self.tip_x - CRANK + pads_ahead(half_gap)
        fingers = [
            filled_rectangle(
                np.array([half_gap, 0.0]),
                np.array([depth, 0.0]),
                np.array([0.0, end]),
            )
            for depth, end in ((_TIP, middle + _END), (_BACK, middle - _FRONT))
        ]
        palm = np.where(np.abs(offsets) <= _PALM_HALF_WIDTH, self.palm_x, -np.inf)
        reach = lowest(np.concatenate(fingers), offsets, -np.inf)
        return np.fmax(reach, palm)

    def opened(self, half_gap: float) -> FingerState:
        """Return the open hand."""
        angle = crank_angle(min(half_gap, OPEN_HALF_GAP))
        return FingerState(angle / self.full_scale, crank_joints(angle))

    def closed(self, width: float) -> FingerState:
        """Return the hand that presses on something.

        The command is the same for every width: the fingers stop once both sense
        something.
        """
        return FingerState(1.0, crank_joints(crank_angle(0.5 * width)))

    def holds(self, width: float, q: Vector, proximity: Vector) -> bool:
        """Return whether what the fingers sense has about a given width."""
        return bool(np.max(q) < 0.5 * (crank_angle(0.5 * width) + EMPTY_ANGLE))

    def detectable(self, width: float) -> bool:
        """Return whether the joint angles reveal a held thing of a given width [m]."""
        return EMPTY_ANGLE - crank_angle(0.5 * width) > _DETECTABLE


@dc.dataclass(frozen=True)
class LinkageHand(Hand):
    """The five-axis arm's gripper: takes cylinders that stand, lean or lie.

    The pads must be along the axis, and the object's middle at the tip. These five
    conditions determine all five joints, so the hand cannot choose its direction.

    Args:
        p_GT: The tip: the middle of a held object in the palm, shape (3,) [m].
        release_shift_G: Motion of the object at the release, shape (3,) [m].
        pinch: See `Hand`.
    """

    p_GT: Vector
    release_shift_G: Vector = dc.field(default_factory=lambda: np.zeros(3))
    pinch: LinkageFingers = LinkageFingers()

    num_joints = num_sensors = 2
    upright_within = np.deg2rad(3.0)

    def grasps(
        self, shape: Solid, X_WO: RigidTransform, firmness: float = 1.0
    ) -> list[Grasp]:
        """Return the ways to take an object; empty if it does not fit the hand.

        `firmness` has no effect: the driver determines how firmly the hand closes.
        """
        if not isinstance(shape, Cylinder):
            return []
        if not _LEAST_RADIUS <= shape.radius <= OPEN_HALF_GAP - 0.003:
            return []
        around, name = shape.radius + _CLEARANCE, "along its axis"
        taken: dict[str, Any] = {}
        if abs(X_WO.rotation().matrix()[2, 2]) <= np.sin(_LYING):
            # An object oblique to the pads needs a wider gap than its diameter.
            across = _ACROSS if around <= OPEN_HALF_GAP else 0.0
            around = OPEN_HALF_GAP
            name = f"from above, at most {np.degrees(across):.0f} degrees across it"
            taken = {"down_G": _AHEAD, "pick_angle": max(across, 0.002)}
        opened = self.pinch.opened(around)
        width = 2.0 * shape.radius
        return [
            PinchGrasp(
                name=name,
                p_GO=self.p_GT,
                axis_G=np.array([0.0, 0.0, 1.0]),
                closure_open=opened.closure,
                closure_closed=self.pinch.closed(width).closure,
                fingers_open=opened.joints,
                fingers_closed=self.pinch.closed(width).joints,
                fingers=self.pinch,
                width=width,
                **taken,
                release_shift_G=self.release_shift_G,
            )
        ]
