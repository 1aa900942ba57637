"""Names and rows of a run's logged signals."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from drake_srg.types import AnyMode, Mode, Vector, mode_name

_POSE = "object_pose."


def pose_key(name: str) -> str:
    """Return the key of an object's poses in a log."""
    return f"{_POSE}{name}"


def is_pose(key: str) -> bool:
    """Return whether a key of a log is that of an object's poses."""
    return key.startswith(_POSE)


# A log's `mode` is an index into this list; a planner's own modes have higher numbers.
MODES = list(Mode)
_NAMES = [mode.value for mode in MODES]


def mode_columns(modes: Sequence[AnyMode]) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a log with a planner's modes, one row per sample.

    The column `mode` holds indices into `MODES`. If the planner has modes of its own,
    they get the next numbers in order of appearance, and there is also a column
    `mode_name`.
    """
    names = [mode_name(mode) for mode in modes]
    index = {name: i for i, name in enumerate(dict.fromkeys([*_NAMES, *names]))}
    columns = {"mode": np.array([float(index[name]) for name in names])}
    return (
        columns
        if len(index) == len(MODES)
        else columns | {"mode_name": np.array(names)}
    )


def logged_modes(log: Mapping[str, npt.NDArray[Any]]) -> list[str]:
    """Return the name of the mode in each sample of a log."""
    if "mode_name" in log:
        return [str(name) for name in log["mode_name"]]
    return [_NAMES[int(i)] for i in log["mode"]]


def pose_to_row(X: RigidTransform) -> Vector:
    """Return a pose as [x, y, z, qw, qx, qy, qz], shape (7,)."""
    return np.concatenate([X.translation(), X.rotation().ToQuaternion().wxyz()])


def row_to_pose(row: Vector) -> RigidTransform:
    """Return the pose of a row of `pose_to_row`; its quaternion is normalized."""
    return RigidTransform(Quaternion(row[3:] / np.linalg.norm(row[3:])), row[:3])
