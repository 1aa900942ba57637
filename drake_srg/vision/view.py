"""The window of a depth image in which a blob's object must lie."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import Solid
from drake_srg.types import Vector
from drake_srg.vision.camera import Imager
from drake_srg.vision.mask import Mask, has_depth, window


@dc.dataclass(frozen=True)
class View:
    """A window of one depth image around a blob, with its geometry in world W.

    Attributes:
        origin: p_WD, the imager's centre [m], shape (3,).
        R_WD: Orientation of the imager, shape (3, 3).
        rays: Directions in W per unit of depth, shape (h, w, 3).
        depth: Along the imager's z [m], shape (h, w); 0 is too near, inf too far.
        valid: Pixels that have depth, shape (h, w).
        points: The visible surface in W [m], shape (h, w, 3); not finite where it is
            too far.
        blob: Pixels of the blob, shape (h, w).
        others: Pixels of the same colour outside the blob, shape (h, w).
        project: Takes points in W (n, 3) to the window's (column, row), (n, 2).
        focal: Focal lengths [pixels], shape (2,).
        noise: Standard deviation of depth at the blob [m].
    """

    origin: Vector
    R_WD: Vector
    rays: Vector
    depth: Vector
    valid: Mask
    points: Vector
    blob: Mask
    others: Mask
    project: Callable[[Vector], Vector]
    focal: Vector
    noise: float = 0.0

    @property
    def seen(self) -> Vector:
        """The points that the blob shows, in W [m], shape (n, 3)."""
        return np.asarray(self.points[self.blob & self.valid])


def view_around(
    shape: Solid,
    blob: Mask,
    colored: Mask,
    depth: npt.NDArray[Any],
    color_imager: Imager,
    depth_imager: Imager,
    X_WB: RigidTransform,
    noise: float = 0.0,
) -> View | None:
    """Return the view of a blob, as far as the whole object may extend.

    Args:
        shape: The object's shape. Its size sets the window's margin.
        blob: Pixels of the blob, shape (color height, color width).
        colored: Pixels of the target's colour, same shape.
        depth: Along the depth imager's z [m], shape (depth height, depth width).
        color_imager: The imager of `blob` and `colored`.
        depth_imager: The imager of `depth`.
        X_WB: Pose of the camera body in world.
        noise: Standard deviation of 1 / depth [1/m].

    Returns:
        None if no pixel of the blob has depth.
    """
    h, w = depth.shape
    if not depth_imager.same_as(color_imager):
        # Carry the masks over to the depth image's pixels.
        finite = np.where(np.isfinite(depth), depth, 0.0)
        p_D = depth_imager.rays(slice(0, w), slice(0, h)) * finite[..., None]
        X_CD = color_imager.X_BI.inverse() @ depth_imager.X_BI
        p_C = p_D @ X_CD.rotation().matrix().T + X_CD.translation()
        blob, colored = (color_imager.lookup(p_C, mask) for mask in (blob, colored))
    usable = blob & has_depth(depth)
    if not usable.any():
        return None
    reach = np.linalg.norm(shape.bounding_size) * depth_imager.info.focal_x()
    margin = int(np.ceil(reach / depth[usable].min())) + 3
    noise *= float(np.median(depth[usable])) ** 2
    rows, columns = window(usable, margin)
    blob, colored = blob[rows, columns], colored[rows, columns]
    depth = depth[rows, columns].astype(float)
    X_WD = X_WB @ depth_imager.X_BI
    R_WD, p_WD = X_WD.rotation().matrix(), X_WD.translation()
    rays = depth_imager.rays(columns, rows) @ R_WD.T
    with np.errstate(invalid="ignore"):  # 0 times infinity
        points = p_WD + rays * depth[..., None]
    corner = np.array([columns.start, rows.start])
    return View(
        origin=p_WD,
        R_WD=R_WD,
        rays=rays,
        depth=depth,
        valid=has_depth(depth),
        points=points,
        blob=blob,
        others=colored & ~blob,
        project=lambda p_W: depth_imager.project((p_W - p_WD) @ R_WD) - corner,
        focal=np.array([depth_imager.info.focal_x(), depth_imager.info.focal_y()]),
        noise=noise,
    )
