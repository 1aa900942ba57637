"""Configuration of movable objects in a scenario."""

import dataclasses as dc
import re
from pathlib import PurePath

from pydrake.common.schema import Transform

from drake_srg.config import Config, positive
from drake_srg.types import Box, Cylinder, Sphere


@dc.dataclass(kw_only=True)
class ColorRangeConfig(Config):
    """A range of colours by which the localizer finds an object, bounds inclusive."""

    lower: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 0.0], metadata={"length": 3}
    )
    upper: list[float] = dc.field(
        default_factory=lambda: [360.0, 1.0, 1.0], metadata={"length": 3}
    )
    # hsv: hue in degrees (lower above upper wraps through red), saturation and value
    # 0 .. 1. rgb: 0 .. 1.
    space: str = dc.field(default="hsv", metadata={"among": ("hsv", "rgb")})


@dc.dataclass(kw_only=True)
class SoftConfig(Config):
    """Material of a soft object: an elastic, isotropic solid.

    The defaults describe a dry kitchen sponge of flexible polyurethane foam, 30 kg/m³,
    by the formulas for open cells in Gibson and Ashby, Cellular Solids, 2nd ed., ch. 5:
    (30 / 1200)² times the solid's modulus of 45 MPa, and a Poisson's ratio of a third.
    """

    youngs_modulus: float = dc.field(default=28.0e3, metadata=positive())  # Pa
    # Linear tetrahedra lock as this approaches 0.5.
    poissons_ratio: float = dc.field(default=0.33, metadata={"ge": 0.0, "le": 0.45})
    # Viscosity over stiffness [s], which is the loss factor over the angular frequency.
    damping: float = dc.field(default=0.01, metadata={"ge": 0.0})


@dc.dataclass(kw_only=True)
class OcclusionConfig(Config):
    """A card that hides part of an object from a camera, out of the arm's reach.

    In the camera's image, the card's edge is perpendicular to `direction`.
    """

    # Hidden share of the object's width in the camera's image.
    share: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 1.0})
    # Side from which the card covers the object: angle from world's x about z [rad].
    direction: float = 0.0


@dc.dataclass(kw_only=True)
class ObjectConfig(Config):
    """A movable object, which starts upright on the table unless it has a `pose`."""

    # File of a model with one link: SDF, URDF, OBJ, STL or GLB, as a path (relative to
    # the scenario's file) or URL (package://drake_srg/sdf/mug.sdf); exclusive with
    # `shape`. If the link has exactly one collision geometry, a cylinder, box or sphere
    # around its origin, the localizer and the planner know that shape. Of any other
    # model, they know the convex pieces if `color_range` is given, and its origin must
    # be at its underside. Meshes are cut into convex pieces once and kept in a cache;
    # see docs/importing.md.
    model: str | None = None
    # Metres per unit of a mesh as `model`: 0.001 for one in millimetres.
    scale: float = dc.field(default=1.0, metadata=positive())
    # Greatest number of convex pieces that represent a mesh of `model`.
    pieces: int = dc.field(default=32, metadata={"ge": 1, "le": 256})
    shape: Cylinder | Box | Sphere | None = None
    # Shape that localizer and planner assume for a `model` of several pieces. The
    # model's origin must be at the shape's centre.
    proxy: Cylinder | Box | Sphere | None = None
    # Makes a `shape`, which must be a box, deformable. A script can pick it, the
    # planner cannot. Needs the contact approximation `sap` and steps of up to 5 ms.
    soft: SoftConfig | None = None
    # Mass [kg]; null keeps the model's.
    mass: float | None = dc.field(default=None, metadata=positive())
    # Coulomb friction coefficient; null keeps the model's.
    friction: float | None = dc.field(default=None, metadata={"ge": 0.0})
    # Edge length of the facets that represent round geometry in contact [m]. Null keeps
    # the model's, or means 0.3 times a shape's radius. For a soft object: longest edge
    # of the cells that are cut into elements; null: a quarter of its shortest side.
    resolution: float | None = dc.field(default=None, metadata=positive())
    # Hydroelastic modulus [Pa]. Null keeps the model's, or means 50 MPa for a shape. If
    # contact is too stiff for the time step, a light object rattles on its support.
    modulus: float | None = dc.field(default=None, metadata=positive())
    # Hunt-Crossley dissipation [s/m]. Null keeps the model's, or means 5 s/m for a
    # shape. An object rebounds at 1 / dissipation at most [m/s]. On a rigid support,
    # only the object's dissipation counts.
    dissipation: float | None = dc.field(default=None, metadata={"ge": 0.0})
    # Red, green, blue 0 .. 1: colour of a `shape`, and the one that the localizer looks
    # for.
    color: list[float] = dc.field(
        default_factory=lambda: [0.8, 0.1, 0.1],
        metadata={"length": 3, "ge": 0.0, "le": 1.0},
    )
    # Colours that the localizer looks for, in place of `color` with its tolerance.
    color_range: ColorRangeConfig | None = None
    # [x, y] of the centre on the table in world [m]; null draws it in `task.region`.
    position: list[float] | None = dc.field(default=None, metadata={"length": 2})
    yaw: float = 0.0  # rad, about the vertical
    # Roll and pitch, applied before `yaw` [rad]; nonzero values need `drop`.
    tilt: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0], metadata={"length": 2}
    )
    # Null: the object stands on the table. Otherwise, it falls from this height above
    # the table, or above an earlier falling object if their bounding boxes would
    # overlap [m].
    drop: float | None = dc.field(default=None, metadata={"ge": 0.0})
    # Initial pose, in place of `position` and `yaw`, for an object that lies on its
    # side, is on something or is in the hand. In world, or in the frame `base_frame` of
    # a model in `directives`.
    pose: Transform | None = None
    present: bool = True  # false leaves the object out
    covered: bool = False  # true puts a lid over it that hides it from the cameras
    # Hides part of the object from the first of the localizer's cameras.
    occlusion: OcclusionConfig | None = None
    # False: localizer and planner do not know the object and treat it as an obstacle.
    known: bool = True
    # Size that localizer and planner assume, divided by the true size, because
    # specimens of a product vary.
    known_scale: float = dc.field(default=1.0, metadata=positive())

    @property
    def kind(self) -> str:
        """Name of the kind of object, for people: `banana`, `cylinder`."""
        if self.model is not None:
            return re.sub(r"^\d+_", "", PurePath(self.model).stem)
        return type(self.shape).__name__.lower()


@dc.dataclass(kw_only=True)
class ClutterConfig(Config):
    """Additional objects named `clutter_1` and so on, each of a randomly drawn kind.

    By default, they stand in `task.region` and are not `known`; `kinds` may change
    this.
    """

    count: int = dc.field(default=0, metadata={"ge": 0})
    kinds: dict[str, ObjectConfig] = dc.field(default_factory=dict)


@dc.dataclass(kw_only=True)
class SleepingConfig(Config):
    """Conditions under which resting objects sleep, to save time."""

    # An object falls asleep after it has been at rest for this long [s].
    after: float = dc.field(default=0.5, metadata=positive())
    # An object is at rest if every point of it is at most this fast [m/s].
    speed: float = dc.field(default=5.0e-4, metadata=positive())
    # A sleeping object wakes when something awake comes this near [m]. With the default
    # `period`, 5 mm are enough for accelerations of up to 100 m/s², ten times that of
    # gravity.
    margin: float = dc.field(default=0.005, metadata=positive())
    # Time between checks [s].
    period: float = dc.field(default=0.01, metadata=positive())
