"""Our shapes as Drake's geometry."""

from pydrake import geometry

from drake_srg.common.convex_pieces import ConvexPieces, Solid
from drake_srg.types import Box, Cylinder, Sphere


def drake_shape(solid: Solid) -> geometry.Shape:
    """Return a shape as Drake's geometry; several pieces become their convex hull."""
    match solid:
        case Cylinder(radius, length):
            return geometry.Cylinder(radius, length)
        case Box(size):
            return geometry.Box(*size)
        case Sphere(radius):
            return geometry.Sphere(radius)
        case ConvexPieces():
            return geometry.Convex(solid.corners.T, "hull")
