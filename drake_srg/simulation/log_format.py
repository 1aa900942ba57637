"""How a log represents modes and poses."""

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from drake_srg.types import Mode, Vector

# A log's `mode` is an index into this list.
MODES = list(Mode)


def pose_to_row(X: RigidTransform) -> Vector:
    """Return a pose as [x, y, z, qw, qx, qy, qz], shape (7,)."""
    return np.concatenate([X.translation(), X.rotation().ToQuaternion().wxyz()])


def row_to_pose(row: Vector) -> RigidTransform:
    """Return the pose of a row of `pose_to_row`; its quaternion is normalized."""
    return RigidTransform(Quaternion(row[3:] / np.linalg.norm(row[3:])), row[:3])
