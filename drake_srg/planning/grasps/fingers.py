"""Two fingers that grasp from above, as the search for grasps models them."""

from __future__ import annotations

import abc
import dataclasses as dc
from collections.abc import Mapping

import numpy as np

from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class Wrap:
    """A grasp from above around an object that is too wide for the pads.

    The hand comes down fully open. Its base links touch the top of the thing, and the
    tips turn down around its upper edges.

    Attributes:
        half_gap: Half of the gap between the open fingers' ends [m].
        hinge_x: Palm x of the tips' hinges in the open hand [m].
        hinge_y: Their distance from the palm's middle [m].
        radius: Radius of the circle on which the tips' ends move about them [m].
        face_x: Palm x of the open base links' faces [m].
        gap: Gap between these faces and the top of the thing as the fingers close [m].
        widths: Least and greatest width of a thing [m].
    """

    half_gap: float
    hinge_x: float
    hinge_y: float
    radius: float
    face_x: float
    gap: float
    widths: tuple[float, float]

    @property
    def deepest(self) -> float:
        """Greatest palm x that the tips' ends reach as they close [m]."""
        return self.hinge_x + self.radius


@dc.dataclass(frozen=True)
class FingerState:
    """A posture of both fingers: closure command and joint angles by name [rad]."""

    closure: float
    joints: Mapping[str, float]


class Fingers(abc.ABC):
    """Two mirrored fingers that close along the palm's y.

    The palm's x points out of it, towards the fingers' ends.

    Attributes:
        deepest: Greatest palm x that their ends reach as they close [m].
        max_width: Greatest width that they take [m].
        most_open: Half of the widest gap between their ends [m].
        pad_width: Extent of the pads along the palm's z [m].
        palm_x: Extent of the palm along its x [m].
        palm_size: Extents of the palm along its y and z [m].
        wrap: The wrap for wider things; None: wider things are refused.
    """

    deepest: float
    max_width: float
    most_open: float
    pad_width: float
    palm_x: float
    palm_size: tuple[float, float]
    wrap: Wrap | None = None

    @abc.abstractmethod
    def silhouette(self, half_gap: float, offsets: Vector) -> Vector:
        """Return the lower outline of the open hand, seen along its pads.

        Args:
            half_gap: Half of the gap between the fingers' ends [m].
            offsets: Distances from the palm's middle along its y, shape (S,) [m].

        Returns:
            Palm x of the hand's lowest point at each offset, shape (S,) [m]; -inf
            beside the hand.
        """

    @abc.abstractmethod
    def opened(self, half_gap: float) -> FingerState:
        """Return the open hand, with half the gap between the fingers' ends [m]."""

    @abc.abstractmethod
    def closed(self, width: float) -> FingerState:
        """Return the hand that presses on something of a given width [m]."""

    def wrapped(self, width: float) -> FingerState:
        """Return the hand that presses on a wrapped thing of a given width [m].

        Raises:
            NotImplementedError: If the fingers have no `wrap`.
        """
        raise NotImplementedError(f"{type(self).__name__} has no `wrap`")

    @abc.abstractmethod
    def holds(self, width: float, q: Vector, proximity: Vector) -> bool:
        """Return whether what the fingers sense has about a given width.

        Args:
            width: Expected width between the pads [m].
            q: Measured angles of the gripper's joints, shape (n,) [rad].
            proximity: Readings of its sensors, shape (m,) [m].
        """

    def straight(self, q: Vector) -> bool:
        """Return whether an empty hand's fingers are all straight at `q` (n,) [rad]."""
        del q
        return True

    @abc.abstractmethod
    def detectable(self, width: float) -> bool:
        """Return whether the joint angles reveal a held thing of a given width [m]."""


def lowest(points: Vector, offsets: Vector, floor: float) -> Vector:
    """Return the lowest point of a hand at each offset, along the palm's x.

    Args:
        points: Dense points of one finger, `|y|` and x in the palm, shape (n, 2) [m].
        offsets: Shape (S,), in equal steps [m].
        floor: Value where there is no point [m].
    """
    step = offsets[1] - offsets[0]
    reach = np.full(len(offsets), floor)
    for side in (-1.0, 1.0):
        index = np.rint((side * points[:, 0] - offsets[0]) / step).astype(int)
        inside = (index >= 0) & (index < len(offsets))
        np.maximum.at(reach, index[inside], points[inside, 1])
    return reach


def filled_rectangle(
    corner: Vector, along: Vector, across: Vector, step: float = 0.001
) -> Vector:
    """Return points that fill a parallelogram, at most `step` apart [m], (n, 2)."""
    a, b = (
        np.linspace(0.0, 1.0, int(np.ceil(np.linalg.norm(v) / step)) + 1)
        for v in (along, across)
    )
    points: Vector = (
        corner + a[:, None, None] * along + b[None, :, None] * across
    ).reshape(-1, 2)
    return points
