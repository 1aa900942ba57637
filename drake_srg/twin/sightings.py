"""Where cameras see objects, as messages tell."""

from __future__ import annotations

import dataclasses as dc
import json
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from drake_srg.bridges.commands import CommandError
from drake_srg.types import BlobFlag


@dc.dataclass(frozen=True)
class Sighting:
    """An object in one camera image.

    Attributes:
        name: The object's.
        time: Of the image [s].
        X_WO: Its pose in world [m].
        clear: Whether nothing hides a part of it.
    """

    name: str
    time: float
    X_WO: RigidTransform
    clear: bool = True


def read_blobs(text: str) -> tuple[Sighting, ...]:
    """Return what a message of `serve`'s topic /blobs tells, but for uncertain poses.

    Args:
        text: JSON, as `drake_srg.bridges.topics` describes it.

    Raises:
        CommandError: If it is anything else.
    """
    try:
        message = json.loads(text)
        time = float(message["stamp"])
        found = [_sighting(time, blob) for blob in message["blobs"]]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise CommandError("blobs", f"needs blobs as JSON, got {error!r}") from None
    if not np.isfinite(time):
        raise CommandError("blobs", f"needs a finite stamp, got {time}")
    return tuple(sighting for sighting in found if sighting is not None)


def _sighting(time: float, blob: Any) -> Sighting | None:
    flags = {BlobFlag(flag) for flag in blob["flags"]}
    wxyz = np.array([float(blob["orientation"][key]) for key in "wxyz"])
    p_WO = np.array(blob["position"], dtype=float)
    norm = float(np.linalg.norm(wxyz))
    if p_WO.shape != (3,) or not np.isfinite([*p_WO, norm]).all() or norm < 0.5:
        raise ValueError("a pose that is not one")
    X_WO = RigidTransform(Quaternion(wxyz / norm), p_WO)
    if BlobFlag.UNCERTAIN in flags:
        return None
    return Sighting(str(blob["object_name"]), time, X_WO, clear=not flags)
