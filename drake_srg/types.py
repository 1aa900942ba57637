"""What the rooms of the package exchange: plain data, no systems."""

import dataclasses as dc
import enum
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

Vector: TypeAlias = npt.NDArray[np.float64]


def positive(**metadata: object) -> Mapping[str, object]:
    """Return the field metadata of a quantity that must be greater than zero."""
    return {"gt": 0.0, **metadata}


# The shapes have defaults and are not frozen because YAML is loaded into them.
@dc.dataclass
class Cylinder:
    """A solid cylinder; its axis is the object frame's z."""

    radius: float = dc.field(default=0.03, metadata=positive())  # m
    length: float = dc.field(default=0.1, metadata=positive())  # m

    @property
    def height(self) -> float:
        """Extent along the object's z [m]."""
        return self.length

    def scaled(self, factor: float) -> "Cylinder":
        """The same shape in another size."""
        return Cylinder(factor * self.radius, factor * self.length)


@dc.dataclass
class Box:
    """A solid box centred on the object frame."""

    # m, along x, y, z
    size: list[float] = dc.field(
        default_factory=lambda: [0.05, 0.05, 0.05], metadata=positive(length=3)
    )

    @property
    def height(self) -> float:
        """Extent along the object's z [m]."""
        return self.size[2]

    def scaled(self, factor: float) -> "Box":
        """The same shape in another size."""
        return Box([factor * side for side in self.size])


@dc.dataclass
class Sphere:
    """A solid ball centred on the object frame."""

    radius: float = dc.field(default=0.03, metadata=positive())  # m

    @property
    def height(self) -> float:
        """Extent along the object's z [m]."""
        return 2.0 * self.radius

    def scaled(self, factor: float) -> "Sphere":
        """The same shape in another size."""
        return Sphere(factor * self.radius)


Shape: TypeAlias = Cylinder | Box | Sphere


# Of misfit. Camera noise alone moves that of one object by 0.005 in the images of the
# scenario `kitchen_varied`, and by 0.014 in those of `assistive_arm_varied` (standard
# deviations); that of other things of its colour which could be it begins at 0.04.
_MISFIT_STEP = 0.02


class BlobFlag(enum.Enum):
    """What makes a blob's position less trustworthy."""

    BORDER = "border"  # the blob touches the image border
    OCCLUDED = "occluded"  # something hides part of the expected outline
    # Too little is seen to tell the axis within a degree or the position within 1 mm.
    UNCERTAIN = "uncertain"


@dc.dataclass(frozen=True, eq=False)
class Blob:
    """One object seen in one camera image."""

    object_name: str
    camera: str
    pixel: tuple[float, float]  # (u, v) of the blob's centroid in the image
    position: Vector  # p_WO, the object's centre in world [m], shape (3,)
    # Unit vector of the object's z axis in world, shape (3,). A cylinder's ends look
    # alike, so its axis is the one that points upwards (z >= 0); a ball's is (0, 0, 1).
    axis: Vector
    quality: float  # 0 .. 1, share of the expected outline that was seen
    flags: frozenset[BlobFlag] = frozenset()
    # 0 for the object itself, seen well: what speaks against its shape, as the share of
    # the blob's pixels that the shape does not explain, plus how far it hovers over
    # what is around, or is sunk in it, as a share of its height.
    misfit: float = 0.0

    @property
    def certain(self) -> bool:
        """Whether position and axis could be told."""
        return BlobFlag.UNCERTAIN not in self.flags

    @property
    def trust(self) -> tuple[bool, int, bool, float]:
        """What to sort by: the greater, the more trustworthy.

        How well the shape fits counts before how much of the outline is seen: what is
        hidden in part is still the object, and another thing in full view is not.
        """
        steps = int(self.misfit / _MISFIT_STEP)
        return self.certain, -steps, not self.flags, self.quality


@dc.dataclass(frozen=True, eq=False)
class Obstacle:
    """Something unknown that stands about: the box around what is seen of it."""

    shape: Box
    X_WO: RigidTransform  # the box's pose in world [m]


class Mode(enum.Enum):
    """Modes of the pick-and-place state machine, in the order of a cycle."""

    IDLE = "idle"
    PRE_GRASP = "pre_grasp"
    GRASP = "grasp"
    CLOSE = "close"
    VERIFY = "verify"
    LIFT = "lift"
    TRANSFER = "transfer"
    PLACE = "place"
    RELEASE = "release"
    RETREAT = "retreat"
    HOME = "home"
    DONE = "done"
    FAILED = "failed"


class Failure(enum.Enum):
    """Why a task failed, in the planner's own word (metrics.json `failure`)."""

    NOT_SEEN = "not_seen"
    OUT_OF_REACH = "out_of_reach"
    BLOCKED = "blocked"
    NO_GRASP = "no_grasp"
    DROPPED = "dropped"
    MISPLACED = "misplaced"
    TIME_BUDGET = "time_budget"
    STOPPED = "stopped"


@dc.dataclass(frozen=True)
class PlannerStatus:
    """What a planner says of its task."""

    mode: Mode = Mode.IDLE
    failure: Failure | None = None  # set once the mode is FAILED
    attempts: int = 0  # grasps begun
    cycles: int = 0  # times the object has been placed
    looks: int = 0  # how often images were asked for
    localization: Blob | None = None  # the first one that led to a plan
    localized_at: float = 0.0  # time of that [s]
    message: str = ""  # why it failed, in words
    planning_wall: float = 0.0  # wall-clock time spent on planning [s]
