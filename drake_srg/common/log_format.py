"""Names and rows of a run's logged signals."""

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from drake_srg.types import Mode, Vector

_POSE = "object_pose."


def pose_key(name: str) -> str:
    """Return the key of an object's poses in a log."""
    return f"{_POSE}{name}"


def is_pose(key: str) -> bool:
    """Return whether a key of a log is that of an object's poses."""
    return key.startswith(_POSE)


# A log's `mode` is an index into this list.
MODES = list(Mode)


def pose_to_row(X: RigidTransform) -> Vector:
    """Return a pose as [x, y, z, qw, qx, qy, qz], shape (7,)."""
    return np.concatenate([X.translation(), X.rotation().ToQuaternion().wxyz()])


def row_to_pose(row: Vector) -> RigidTransform:
    """Return the pose of a row of `pose_to_row`; its quaternion is normalized."""
    return RigidTransform(Quaternion(row[3:] / np.linalg.norm(row[3:])), row[:3])
