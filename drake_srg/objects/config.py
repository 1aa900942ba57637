"""What a scenario says of an object that can be moved."""

import dataclasses as dc

from pydrake.common.schema import Transform

from drake_srg.types import Box, Cylinder, Sphere, positive


@dc.dataclass(kw_only=True)
class ColorRangeConfig:
    """Colours by which the localizer finds an object, bounds inclusive."""

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
class SoftConfig:
    """What a soft object is made of: an elastic, isotropic solid.

    The defaults are those of a dry kitchen sponge of flexible polyurethane foam, 30
    kg/m³ (Gibson and Ashby, Cellular Solids, 2nd ed., ch. 5, for open cells): modulus
    (30 / 1200)² of the solid's 45 MPa, Poisson's ratio a third.
    """

    youngs_modulus: float = dc.field(default=28.0e3, metadata=positive())  # Pa
    # Linear tetrahedra lock as this comes near 0.5.
    poissons_ratio: float = dc.field(default=0.33, metadata={"ge": 0.0, "le": 0.45})
    # Viscosity over stiffness [s]: loss factor over angular frequency.
    damping: float = dc.field(default=0.01, metadata={"ge": 0.0})


@dc.dataclass(kw_only=True)
class OcclusionConfig:
    """A card that hangs before a camera, out of the arm's reach, and hides something.

    Its edge runs square to `direction`, in the camera's image.
    """

    # Of the object's width, as the camera sees it.
    share: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 1.0})
    # From which side it covers the object, about the vertical from world's x [rad].
    direction: float = 0.0


@dc.dataclass(kw_only=True)
class ObjectConfig:
    """An object that can be moved; at the start it stands upright on the table."""

    # Model with one link, or else `shape`. Where the link has one collision geometry, a
    # cylinder, box or ball around its origin, the localizer and the planner know that
    # shape. Any other object is one that they neither see nor pick; its origin is under
    # it, on the table.
    model: str | None = None
    shape: Cylinder | Box | Sphere | None = None
    # Makes a `shape`, a box, of finite elements; a script can pick it, the planner not.
    # The plant must have the contact approximation `sap` and steps of up to 5 ms.
    soft: SoftConfig | None = None
    # kg; with a model, null keeps the model's.
    mass: float | None = dc.field(default=None, metadata=positive())
    # Coulomb friction coefficient; with a model, null keeps the model's.
    friction: float | None = dc.field(default=None, metadata={"ge": 0.0})
    # Edge length of the facets that stand for round geometry in contact [m]; null keeps
    # the model's, or takes 0.3 of a shape's radius. For a soft object, longest edge of
    # the cells that are cut into elements; null takes a quarter of its least extent.
    resolution: float | None = dc.field(default=None, metadata=positive())
    # Hydroelastic modulus [Pa]; null keeps the model's, or takes 50 MPa for a shape. A
    # light object rattles on a stiff support where contact is too stiff for the step.
    modulus: float | None = dc.field(default=None, metadata=positive())
    # Red, green, blue 0 .. 1: what a `shape` is painted with and what the localizer
    # looks for.
    color: list[float] = dc.field(
        default_factory=lambda: [0.8, 0.1, 0.1],
        metadata={"length": 3, "ge": 0.0, "le": 1.0},
    )
    # What the localizer looks for, where `color` and its default tolerance do not do.
    color_range: ColorRangeConfig | None = None
    # [x, y] of the centre on the table, in world [m]; null draws it in `task.region`.
    position: list[float] | None = dc.field(default=None, metadata={"length": 2})
    yaw: float = 0.0  # rad, about the vertical
    # Where the object is at the start, in world or in the frame `base_frame` of a model
    # among the directives, instead of `position` and `yaw`: lying, on something, in the
    # hand.
    pose: Transform | None = None
    present: bool = True  # false leaves the object out
    covered: bool = False  # true puts a lid over it that hides it from the cameras
    # What hides a part of it from the first of the localizer's cameras.
    occlusion: OcclusionConfig | None = None
    # False keeps it from localizer and planner: to them it is a thing in the way.
    known: bool = True
    # The size that localizer and planner take it for, over its own: products are not
    # all alike.
    known_scale: float = dc.field(default=1.0, metadata=positive())


@dc.dataclass(kw_only=True)
class ClutterConfig:
    """Things that stand about: `objects` named `clutter_1` and so on.

    Each is of one of the kinds, drawn for itself. They stand in `task.region` where
    their kind gives no position, and are not `known` unless it says so.
    """

    count: int = dc.field(default=0, metadata={"ge": 0})
    kinds: dict[str, ObjectConfig] = dc.field(default_factory=dict)
