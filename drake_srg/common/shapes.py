"""Our shapes as Drake's geometry."""

from pydrake import geometry

from drake_srg.common.convex_pieces import ConvexPieces, Solid
from drake_srg.types import Box, Cylinder, Shape, Sphere


def drake_shape(shape: Shape) -> geometry.Shape:
    """Return a shape as Drake's geometry."""
    match shape:
        case Cylinder(radius, length):
            return geometry.Cylinder(radius, length)
        case Box(size):
            return geometry.Box(*size)
        case Sphere(radius):
            return geometry.Sphere(radius)


def drake_shapes(solid: Solid) -> list[geometry.Shape]:
    """Return a solid as Drake's geometries, one for each convex piece."""
    if isinstance(solid, ConvexPieces):
        return [geometry.Convex(piece.T, "piece") for piece in solid.pieces]
    return [drake_shape(solid)]
