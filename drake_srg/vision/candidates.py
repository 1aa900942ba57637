"""Groups of pixels that may show a target, to be judged by its shape."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Iterator
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.types import Shape
from drake_srg.vision.camera import Imager
from drake_srg.vision.color import ColorImage, ColorRange
from drake_srg.vision.mask import Mask, grown
from drake_srg.vision.solids import bounding_size

# What other values change is measured by experiment localizer_thresholds.
_STEP = 0.25  # of a solid's least extent; what goes on behind it is farther off
_DEVIATIONS = 6.0  # of noise; a step is more
_SMALLEST = 0.08  # of a solid's smallest face; less does not tell what it is
# Of what is around it: at least as much is behind, the rest may hide it or touch it.
_SET_OFF, _MOST_LEVEL = 0.3, 0.25
_RIM = 2  # pixels; a step's own are neither before nor behind it
_BESIDE = 5  # pixels beyond the rim that show what is around


@dc.dataclass(frozen=True)
class Picture:
    """What a camera tells at one time.

    Attributes:
        color: Shape (color height, color width, 3 or 4).
        depth: Along the depth imager's z [m], shape (depth height, depth width).
        noise: Standard deviation of 1 / depth [1/m].
        color_imager: Of the colour image.
        depth_imager: Of the depth image.
        X_WB: Pose of the camera body in world.
    """

    color: ColorImage
    depth: npt.NDArray[np.float32]
    noise: float
    color_imager: Imager
    depth_imager: Imager
    X_WB: RigidTransform


@dc.dataclass(frozen=True)
class Candidate:
    """Pixels of the colour image that may show a target.

    Attributes:
        blob: Which, shape (color height, color width).
        colored: All that have the target's colour, likewise.
    """

    blob: Mask
    colored: Mask


Search: TypeAlias = Callable[[Picture, Shape, ColorRange, int], Iterator[Candidate]]


def by_color(
    picture: Picture, shape: Shape, colors: ColorRange, min_area: int
) -> Iterator[Candidate]:
    """Connected pixels of a range of colours, at least `min_area` of them."""
    colored = colors.mask(picture.color)
    for region in _components(colored, min_area):
        blob = _refined(picture, shape, region) if picture.noise else None
        yield Candidate(region if blob is None else blob, colored)


def by_steps(
    picture: Picture, shape: Shape, colors: ColorRange, min_area: int
) -> Iterator[Candidate]:
    """What steps in depth set off, of colours that a range has under other lights.

    Where depth is not seen along the rays of colour, there are none.
    """
    if not picture.color_imager.same_as(picture.depth_imager):
        return
    depth, size = picture.depth, np.sort(bounding_size(shape))
    known = np.isfinite(depth) & (depth > 0)
    near = np.where(known, depth, np.float32(0.0))
    steps = cv2.morphologyEx(near, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    level = known & (steps < _step(picture, shape, near))
    focal = picture.depth_imager.info.focal_x()
    for region in _components(
        colors.mask_in_any_light(picture.color) & level, min_area
    ):
        pixel = float(np.median(depth[region])) / focal
        extent = pixel * max(np.ptp(np.nonzero(region), axis=1))
        area = pixel**2 * region.sum()
        if area < _SMALLEST * size[0] * size[1] or extent > np.linalg.norm(size):
            continue
        blob = _refined(picture, shape, region)
        if blob is not None:
            yield Candidate(blob, blob)


def _refined(picture: Picture, shape: Shape, region: Mask) -> Mask | None:
    """A region whose rim is told from what is behind by their own colours.

    Blur mixes the two: their middle is where the edge is, whatever they are.

    Returns:
        None where depth does not set the region off from what is around.
    """
    depth = picture.depth
    usable = region & np.isfinite(depth) & (depth > 0)
    if not (picture.color_imager.same_as(picture.depth_imager) and usable.any()):
        return None
    distance = float(np.median(depth[usable]))
    step = float(_step(picture, shape, np.float32(distance)))
    rim = grown(region, _RIM)
    beside = grown(region, _RIM + _BESIDE) & ~rim
    behind = beside & (depth > distance + step)
    level = beside & (np.abs(depth - distance) <= step)
    if (
        behind.sum() < _SET_OFF * beside.sum()
        or level.sum() > _MOST_LEVEL * beside.sum()
    ):
        return None
    color = picture.color[..., :3].astype(np.float32)
    own, other = (np.median(color[pixels], axis=0) for pixels in (usable, behind))
    blob = np.zeros_like(region)
    # Of two colours, the nearer one: on which side of their middle it is.
    blob[rim] = (color[rim] - 0.5 * (own + other)) @ (own - other) > 0
    return blob


def _step(
    picture: Picture, shape: Shape, depth: npt.NDArray[np.float32] | np.float32
) -> npt.NDArray[np.float32] | np.float32:
    """The least step in depth [m] at which a thing of a shape ends."""
    least = np.float32(_STEP * bounding_size(shape).min())
    return least + np.float32(_DEVIATIONS * picture.noise) * depth**2


def _components(mask: Mask, min_area: int) -> Iterator[Mask]:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=8
    )
    for i in range(1, count):  # 0 is the background
        if stats[i, cv2.CC_STAT_AREA] >= min_area:
            yield labels == i
