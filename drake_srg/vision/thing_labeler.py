"""Labels of things on a height map, by their colours and known shapes."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from drake_srg.common.geometry import Solid
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Blob, HeightMap, LabeledHeightMap, Vector
from drake_srg.vision.camera import (
    CameraModel,
    Imager,
    declare_camera_ports,
    eval_camera_port,
)
from drake_srg.vision.color import COLORS, NUM_HUES, ColorImage, color_names
from drake_srg.vision.images import Mask
from drake_srg.vision.solids import signed_distance

Labels = npt.NDArray[np.int8]
# Anything lower than this above the table belongs to the table [m].
_LEAST_HEIGHT = 0.004
# Greatest distance of a cell's top from the surface of its object [m]. It allows for
# errors of pose and map; steep flanks have the height of their upper edge.
_ON_SURFACE = 0.008
# A thing is colourful if more than this share of its cells has a hue. Then its grey and
# white parts get the hue of the nearest coloured part.
_LEAST_SHARE = 0.15
_KERNEL = np.ones((3, 3), np.uint8)


def things(height_map: HeightMap, table: float) -> Mask:
    """Return the cells that show something on a table at height `table` [m]."""
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
    """Return each cell's colour as an index in `COLORS`, -1 where the table is empty.

    Args:
        height_map: The map.
        table: Height of the table [m].
        image: Image of the colour camera, RGB or RGBA, shape (height, width, 3 or 4).
        imager: Its colour imager.
        X_WB: Pose of the camera's body in world.
    """
    on = things(height_map, table)
    labels = np.full(on.shape, -1, np.int8)
    p_W = np.column_stack([height_map.centers()[on], height_map.height[on]])
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
    """Return labels in which grey parts of colourful things get the nearest hue."""
    hued = (labels >= 0) & (labels < NUM_HUES)
    # Opening removes the narrow edges where pixels blend.
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
    """Return the cells that show the surface of a solid.

    Args:
        height_map: The map.
        table: Height of the table [m].
        solid: Solid of the object.
        X_WC: Pose of the solid's centre in world.
    """
    mask = things(height_map, table)
    radius = 0.5 * float(np.linalg.norm(solid.bounding_size)) + _ON_SURFACE
    centers: Vector = height_map.centers()
    away = np.linalg.norm(centers - X_WC.translation()[:2], axis=-1)
    mask &= away < radius
    p_W = np.column_stack([centers[mask], height_map.height[mask]])
    p_C = (p_W - X_WC.translation()) @ X_WC.rotation().matrix()
    distance, _ = signed_distance(solid, p_C)
    mask[mask] = np.abs(distance) < _ON_SURFACE
    return mask


ALL = "all"
_UPRIGHT = np.cos(np.deg2rad(8.0))  # cosine of the angle from the vertical


@dc.dataclass(frozen=True)
class KnownThing:
    """An object that the localizer knows.

    Attributes:
        solid: Its shape or its pieces.
        p_OC: Centre of `solid` in the object's frame [m].
    """

    solid: Solid
    p_OC: tuple[float, float, float] = (0.0, 0.0, 0.0)


class ThingLabeler(LeafSystem):
    """Labels the cells of a height map by their objects.

    A label is an object's name, a colour, or `all` for everything on the table. Each
    cell gets the first label that fits. Names come from the poses that a localizer
    finds: a cell belongs to an object if its top is on the object's surface. Only the
    most trustworthy blob of each object counts, and only if it is certain. Colours come
    from the colour images, registered to the map. The grey and white parts of a
    coloured thing get the colour of its nearest coloured part.

    .. pydrake_system::

        name: ThingLabeler
        input_ports:
        - height_map
        - blobs (with names)
        - CAMERA.color_image (with colours)
        - CAMERA.body_pose_in_world (with colours)
        output_ports:
        - labeled_height_map

    `height_map` is a HeightMap, `blobs` is BlobLocalizer's output. The output is a
    LabeledHeightMap, computed only when it is evaluated.

    Args:
        names: Labels in the order of precedence: names of `known`, of `COLORS`, `all`.
        cameras: Camera name to its model.
        known: Objects by name.
        table: Height of the table [m].
        upright: Whether only upright objects get names.

    Raises:
        ValueError: If a label is none of these, or there are colours but no cameras.
    """

    def __init__(
        self,
        names: Sequence[str],
        cameras: Mapping[str, CameraModel],
        known: Mapping[str, KnownThing],
        table: float,
        *,
        upright: bool = False,
    ) -> None:
        super().__init__()
        self._upright = upright
        for name in names:
            if name not in (*known, *COLORS, ALL):
                raise ValueError(f"ThingLabeler: unknown label {name!r}")
        self._names, self._known, self._table = tuple(names), dict(known), table
        colored = any(name in COLORS and name not in known for name in names)
        if colored and not cameras:
            raise ValueError("ThingLabeler needs a camera to tell colours")
        self._imagers = {
            camera: model.imager("color")
            for camera, model in (cameras if colored else {}).items()
        }
        empty = HeightMap(np.zeros(2), 1.0, np.zeros((0, 0)))
        self._map = self.DeclareAbstractInputPort(
            "height_map", AbstractValue.Make(empty)
        )
        if any(name in known for name in names):
            self.DeclareAbstractInputPort("blobs", AbstractValue.Make([]))
        declare_camera_ports(self, self._imagers, ("color_image", "body_pose_in_world"))
        labeled = self._labeled(empty, np.zeros((0, 0), np.int8))
        self.DeclareAbstractOutputPort(
            "labeled_height_map",
            lambda: AbstractValue.Make(labeled),
            self._calc_labels,
            {self.all_input_ports_ticket()},
        )

    def _labeled(self, height_map: HeightMap, label: Labels) -> LabeledHeightMap:
        return LabeledHeightMap(
            height_map.origin,
            height_map.resolution,
            height_map.height,
            label,
            self._names,
        )

    def _calc_labels(self, context: Context, output: AbstractValue) -> None:
        height_map: HeightMap = self._map.Eval(context)
        label = np.full(height_map.height.shape, -1, np.int8)
        colors = [
            color_labels(
                height_map,
                self._table,
                eval_camera_port(self, context, camera, "color_image"),
                imager,
                eval_camera_port(self, context, camera, "body_pose_in_world"),
            )
            for camera, imager in self._imagers.items()
        ]
        for i, name in enumerate(self._names):
            if name in self._known:
                mask = self._named(context, height_map, name)
            elif name == ALL:
                mask = things(height_map, self._table)
            else:
                seen = [found == COLORS.index(name) for found in colors]
                mask = np.asarray(np.logical_or.reduce(seen))
            label[mask & (label < 0)] = i
        output.set_value(self._labeled(height_map, label))

    def _named(self, context: Context, height_map: HeightMap, name: str) -> Mask:
        """Return the cells of an object at its best blob's pose, if that is certain."""
        thing = self._known[name]
        blobs: list[Blob] = self.GetInputPort("blobs").Eval(context)
        best = next((blob for blob in blobs if blob.object_name == name), None)
        if best is None or not best.certain or (self._upright and not _stands(best)):
            return np.zeros(height_map.height.shape, bool)
        p_OC: Vector = np.array(thing.p_OC)
        X_WC = best.X_WO @ RigidTransform(p_OC)
        return solid_mask(height_map, self._table, thing.solid, X_WC)


def _stands(blob: Blob) -> bool:
    return bool(blob.axis[2] > _UPRIGHT)
