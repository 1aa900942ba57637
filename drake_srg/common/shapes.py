"""Our shapes as Drake's geometry."""

from pydrake import geometry

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
