"""Where cameras are and what they look at."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import Vector


def look_at(p_WC: Vector, p_WL: Vector) -> RigidTransform:
    """Return the pose of an upright camera (z ahead, y down) that looks at a point.

    Args:
        p_WC: Position of the camera, shape (3,) [m].
        p_WL: The point, not straight above or below the camera, shape (3,) [m].
    """
    z = (p_WL - p_WC) / np.linalg.norm(p_WL - p_WC)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), p_WC)
