"""Plain data that the packages of drake_srg exchange."""

import dataclasses as dc
import enum
import math
from typing import Self, TypeAlias

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.config import Config, positive

Vector: TypeAlias = npt.NDArray[np.float64]


# Shapes have defaults and are not frozen because yaml_load_typed fills them in.
@dc.dataclass
class Cylinder(Config):
    """A solid cylinder; its axis is the object frame's z."""

    radius: float = dc.field(default=0.03, metadata=positive())  # m
    length: float = dc.field(default=0.1, metadata=positive())  # m

    @property
    def height(self) -> float:
        """Extent along the object's z [m]."""
        return self.length

    @property
    def bounding_size(self) -> Vector:
        """Extents along the object's x, y, z [m], shape (3,)."""
        return np.array([2 * self.radius, 2 * self.radius, self.length])

    @property
    def upright_radius(self) -> float:
        """Radius of the smallest cylinder along the object's z that encloses it [m]."""
        return float(self.radius)

    def half_extent(self, direction: Vector) -> float:
        """Return the distance from the centre to the farthest point along a direction.

        Args:
            direction: Unit vector in the object's frame, shape (3,).
        """
        across = math.hypot(direction[0], direction[1])
        return self.radius * across + 0.5 * self.length * abs(float(direction[2]))

    def scaled(self, factor: float) -> "Cylinder":
        """Return the shape, scaled by `factor`."""
        return Cylinder(factor * self.radius, factor * self.length)


@dc.dataclass
class Box(Config):
    """A solid box centred on the object frame."""

    # m, along x, y, z
    size: list[float] = dc.field(
        default_factory=lambda: [0.05, 0.05, 0.05], metadata=positive(length=3)
    )

    @property
    def height(self) -> float:
        """Extent along the object's z [m]."""
        return self.size[2]

    @property
    def bounding_size(self) -> Vector:
        """Extents along the object's x, y, z [m], shape (3,)."""
        return np.array(self.size, dtype=float)

    @property
    def upright_radius(self) -> float:
        """Radius of the smallest cylinder along the object's z that encloses it [m]."""
        return 0.5 * float(np.linalg.norm(self.size[:2]))

    def half_extent(self, direction: Vector) -> float:
        """Return the distance from the centre to the farthest point along a direction.

        Args:
            direction: Unit vector in the object's frame, shape (3,).
        """
        return 0.5 * float(np.abs(direction) @ np.array(self.size))

    def scaled(self, factor: float) -> "Box":
        """Return the shape, scaled by `factor`."""
        return Box([factor * side for side in self.size])


@dc.dataclass
class Sphere(Config):
    """A solid ball centred on the object frame."""

    radius: float = dc.field(default=0.03, metadata=positive())  # m

    @property
    def height(self) -> float:
        """Extent along the object's z [m]."""
        return 2.0 * self.radius

    @property
    def bounding_size(self) -> Vector:
        """Extents along the object's x, y, z [m], shape (3,)."""
        return np.full(3, 2 * self.radius)

    @property
    def upright_radius(self) -> float:
        """Radius of the smallest cylinder along the object's z that encloses it [m]."""
        return float(self.radius)

    def half_extent(self, direction: Vector) -> float:
        """Return the distance from the centre to the farthest point along a direction.

        Args:
            direction: Unit vector in the object's frame, shape (3,).
        """
        return self.radius * float(np.linalg.norm(direction))

    def scaled(self, factor: float) -> "Sphere":
        """Return the shape, scaled by `factor`."""
        return Sphere(factor * self.radius)


Shape: TypeAlias = Cylinder | Box | Sphere


# `Blob.trust` counts misfit in steps of this size. Camera noise alone varies the misfit
# of one object by 0.005 in `kitchen_varied` and by 0.014 in `assistive_arm_varied`
# (standard deviations). Other things of the same colour that could be mistaken for the
# object have a misfit of at least 0.04.
_MISFIT_STEP = 0.02


class BlobFlag(enum.Enum):
    """A reason to trust a blob's position less."""

    BORDER = "border"  # the blob touches the image border
    OCCLUDED = "occluded"  # something hides part of the expected outline
    # Too little is visible to determine the axis within 1 degree or the position within
    # 1 mm.
    UNCERTAIN = "uncertain"


@dc.dataclass(frozen=True, eq=False)
class Blob:
    """One object seen in one camera image."""

    object_name: str
    camera: str
    pixel: tuple[float, float]  # (u, v) of the blob's centroid in the image
    # Pose in world [m]. If several poses look alike, it is the one with the smallest
    # rotation: none for a ball, and no spin about a cylinder's axis, which points up.
    X_WO: RigidTransform
    quality: float  # 0 .. 1, visible share of the expected outline
    flags: frozenset[BlobFlag] = frozenset()
    # Evidence against the object's shape; 0 for the object itself in clear view. It is
    # the share of the blob's pixels that the shape does not explain, plus the distance
    # by which the shape floats above or sinks into its surroundings, as a share of its
    # height.
    misfit: float = 0.0

    @property
    def position(self) -> Vector:
        """Origin p_WO of the object's frame in world [m], shape (3,)."""
        p_WO: Vector = self.X_WO.translation()
        return p_WO

    @property
    def axis(self) -> Vector:
        """Unit vector of the object's z axis in world, shape (3,)."""
        z_W: Vector = self.X_WO.rotation().matrix()[:, 2]
        return z_W

    @property
    def certain(self) -> bool:
        """Whether the visible part determines the pose, up to the shape's symmetry."""
        return BlobFlag.UNCERTAIN not in self.flags

    @property
    def trust(self) -> tuple[bool, int, bool, float]:
        """Sort key; a greater one is more trustworthy.

        The fit of the shape counts before the visible share of the outline: a partly
        hidden object is still the object, another thing in full view is not.
        """
        steps = int(self.misfit / _MISFIT_STEP)
        return self.certain, -steps, not self.flags, self.quality


@dc.dataclass(frozen=True, eq=False)
class Obstacle:
    """An unknown object in the workspace: the bounding box of its visible part."""

    shape: Box
    X_WO: RigidTransform  # the box's pose in world [m]


@dc.dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights of the visible surface over a grid of cells in the horizontal plane."""

    origin: Vector  # x, y in W of the centre of cell (0, 0), shape (2,) [m]
    resolution: float  # width of a cell [m]
    # World z [m], shape (ny, nx); NaN where no camera saw anything.
    height: Vector

    def centers(self) -> Vector:
        """Return x, y of the centre of each cell in world, shape (ny, nx, 2) [m]."""
        ny, nx = self.height.shape
        centers = np.empty((ny, nx, 2))
        centers[..., 0] = self.origin[0] + self.resolution * np.arange(nx)
        centers[..., 1] = (self.origin[1] + self.resolution * np.arange(ny))[:, None]
        return centers

    def cells(self, p_W: Vector) -> npt.NDArray[np.intp]:
        """Return the cells (iy, ix) of points, which may lie outside the map.

        Args:
            p_W: Points in world [m], shape (..., 2 or more).

        Returns:
            Shape (..., 2).
        """
        ix_iy = np.rint((p_W[..., :2] - self.origin) / self.resolution)
        return ix_iy[..., ::-1].astype(np.intp)

    def completed(self, earlier: Self | None) -> Self:
        """Return this map with its gaps filled from an earlier map of the same grid.

        Args:
            earlier: The earlier map, if there is one.
        """
        if earlier is None:
            return self
        gap = np.isnan(self.height)
        return dc.replace(self, height=np.where(gap, earlier.height, self.height))


@dc.dataclass(frozen=True, eq=False)
class LabeledHeightMap(HeightMap):
    """A height map with a label in each cell: the kind of thing that it shows."""

    # Index into `names`, shape (ny, nx); negative where there is nothing of interest.
    label: npt.NDArray[np.int8]
    names: tuple[str, ...]  # of objects, of colours, or `all`

    def completed(self, earlier: Self | None) -> Self:
        """Return this map with its gaps, in labels too, filled from an earlier map."""
        if earlier is None:
            return self
        whole = super().completed(earlier)
        label = np.where(np.isnan(self.height), earlier.label, self.label)
        return dc.replace(whole, label=label)


class Mode(enum.Enum):
    """Modes of our planners. A planner of your own may have others; see `AnyMode`."""

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
    PUSH = "push"


# The mode of a planner: ours, a member of an enum of your own, or a string. Modes with
# the same name (see `mode_name`) mean the same to runs, logs, metrics and recordings.
AnyMode: TypeAlias = enum.Enum | str


def mode_name(mode: object) -> str:
    """Return a mode's name: a string's or an enum's value, else the member's name."""
    if not isinstance(mode, enum.Enum):
        return str(mode)
    return mode.value if isinstance(mode.value, str) else mode.name.lower()


def mode_words(mode: object) -> str:
    """Return a mode's name for readers, without underscores."""
    return mode_name(mode).replace("_", " ")


class Failure(enum.Enum):
    """Why a task failed, as reported by the planner (metrics.json `failure`)."""

    NOT_SEEN = "not_seen"
    OUT_OF_REACH = "out_of_reach"
    BLOCKED = "blocked"
    NO_GRASP = "no_grasp"
    TOO_WIDE = "too_wide"
    DROPPED = "dropped"
    MISPLACED = "misplaced"
    TIME_BUDGET = "time_budget"
    STOPPED = "stopped"
    NO_HOLE = "no_hole"
    HOLE_BLOCKED = "hole_blocked"
    TOO_TIGHT = "too_tight"
    NOT_TAKEN = "not_taken"


@dc.dataclass(frozen=True, eq=False)
class Remaining:
    """A thing that a planner leaves in place, and why."""

    p_W: Vector  # of its top, shape (3,) [m]
    failure: Failure


@dc.dataclass(frozen=True)
class PlannerStatus:
    """A planner's report about its task."""

    mode: AnyMode = Mode.IDLE
    failure: Failure | None = None  # set once the mode is FAILED
    attempts: int = 0  # grasps started
    cycles: int = 0  # times the object has been placed
    # Picks that put several things down where one was expected; each is one cycle.
    multi_object_picks: int = 0
    looks: int = 0  # times the planner requested images
    blobs: tuple[Blob, ...] = ()  # seen in the latest look
    localization: Blob | None = None  # the first blob that led to a plan
    localized_at: float = 0.0  # time of that localization [s]
    sighting: Blob | None = None  # the latest blob that the planner has used
    sighted_at: float = 0.0  # time of that sighting [s]
    message: str = ""  # why it failed, in words
    left: tuple[Remaining, ...] = ()  # things that stay, once the mode is DONE

    def __str__(self) -> str:
        """Return the mode, with the grasp's number or the reason of a failure."""
        mode = mode_words(self.mode)
        if self.ended:
            return f"{mode}: {self.message}" if self.message else mode
        return f"grasp {self.attempts}: {mode}" if self.attempts > 1 else mode

    @property
    def done(self) -> bool:
        """Whether the planner reports that its task is done."""
        return mode_name(self.mode) == Mode.DONE.value

    @property
    def ended(self) -> bool:
        """Whether the planner has done its task or given up."""
        return self.done or mode_name(self.mode) == Mode.FAILED.value
