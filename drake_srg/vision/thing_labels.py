"""Labels of a height map's cells: by colour, and by the poses of known objects."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import Solid
from drake_srg.types import HeightMap, Vector
from drake_srg.vision.camera import Imager
from drake_srg.vision.color import ColorImage
from drake_srg.vision.color_names import NUM_HUES, color_names
from drake_srg.vision.mask import Mask
from drake_srg.vision.solids import signed_distance

Labels = npt.NDArray[np.int8]
# What is lower than this above the table belongs to the table [m].
_LEAST_HEIGHT = 0.004
# Distance of a cell's top from the surface of the object that it belongs to, at most
# [m]: errors of pose and map. Steep flanks show at their upper edge's height.
_ON_SURFACE = 0.008
# A thing has a hue if at least this share of its cells has one; then its grey and white
# parts count as the nearest part with a hue.
_LEAST_SHARE = 0.15
_KERNEL = np.ones((3, 3), np.uint8)


def things(height_map: HeightMap, table: float) -> Mask:
    """Return which cells show something on a table at height `table` [m]."""
    return np.asarray(
        np.nan_to_num(height_map.height, nan=-np.inf) > table + _LEAST_HEIGHT
    )


def color_labels(
    height_map: HeightMap,
    table: float,
    image: ColorImage,
    imager: Imager,
    X_WB: RigidTransform,
) -> Labels:
    """Return the index in `COLORS` of what is in each cell, -1 where nothing is.

    Args:
        height_map: The map.
        table: Height of the table [m].
        image: Of the colour camera, RGB or RGBA, shape (height, width, 3 or 4).
        imager: Its colour imager.
        X_WB: Pose of the camera's body in world.
    """
    on = things(height_map, table)
    labels = np.full(on.shape, -1, np.int8)
    p_W = np.column_stack([height_map.middles()[on], height_map.height[on]])
    p_C = (p_W - (X_WB @ imager.X_BI).translation()) @ (
        X_WB @ imager.X_BI
    ).rotation().matrix()
    uv = np.rint(imager.project(p_C)).astype(int)
    seen = ((uv >= 0) & (uv < np.array(image.shape[1::-1]))).all(axis=1)
    found = np.full(len(uv), -1, np.int8)
    found[seen] = color_names(image)[uv[seen, 1], uv[seen, 0]]
    labels[on] = found
    return _by_hue(labels, on)


def _by_hue(labels: Labels, on: Mask) -> Labels:
    """Return labels in which a colourful thing's grey parts have the nearest hue."""
    hued = (labels >= 0) & (labels < NUM_HUES)
    # Blended pixels at edges are narrow.
    hued = cv2.morphologyEx(hued.astype(np.uint8), cv2.MORPH_OPEN, _KERNEL) > 0
    count, number = cv2.connectedComponents(on.astype(np.uint8), connectivity=8)
    share = np.bincount(number[hued], minlength=count) / np.maximum(
        np.bincount(number.ravel(), minlength=count), 1
    )
    colorful = on & (share > _LEAST_SHARE)[number]
    seeds = colorful & hued
    if not seeds.any():
        return labels
    _, nearest = cv2.distanceTransformWithLabels(
        (~seeds).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    value = np.full(nearest.max() + 1, -1, np.int8)
    value[nearest[seeds]] = labels[seeds]
    return np.asarray(np.where(colorful, value[nearest], labels), np.int8)


def solid_mask(
    height_map: HeightMap, table: float, solid: Solid, X_WC: RigidTransform
) -> Mask:
    """Return which cells show the surface of a solid.

    Args:
        height_map: The map.
        table: Height of the table [m].
        solid: Of the object.
        X_WC: Pose of the solid's centre in world.
    """
    mask = things(height_map, table)
    radius = 0.5 * float(np.linalg.norm(solid.bounding_size)) + _ON_SURFACE
    middles: Vector = height_map.middles()
    away = np.linalg.norm(middles - X_WC.translation()[:2], axis=-1)
    mask &= away < radius
    p_W = np.column_stack([middles[mask], height_map.height[mask]])
    p_C = (p_W - X_WC.translation()) @ X_WC.rotation().matrix()
    distance, _ = signed_distance(solid, p_C)
    mask[mask] = np.abs(distance) < _ON_SURFACE
    return mask
