"""Groups of pixels that may show a target; its shape decides later."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Iterator
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import Solid
from drake_srg.vision.camera import Imager
from drake_srg.vision.color import ColorImage, ColorRange
from drake_srg.vision.config import BlobLocalizerConfig, CandidatesConfig
from drake_srg.vision.mask import Mask, grow, has_depth


@dc.dataclass(frozen=True)
class Picture:
    """A camera's images at one time.

    Attributes:
        color: Shape (color height, color width, 3 or 4).
        depth: Along the depth imager's z [m], shape (depth height, depth width).
        noise: Standard deviation of 1 / depth [1/m].
        color_imager: The imager of the colour image.
        depth_imager: The imager of the depth image.
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
        blob: The pixels, shape (color height, color width).
        colored: All pixels of the target's colour, same shape.
    """

    blob: Mask
    colored: Mask


Search: TypeAlias = Callable[
    [Picture, Solid, ColorRange, int, BlobLocalizerConfig], Iterator[Candidate]
]


def by_color(
    picture: Picture,
    shape: Solid,
    colors: ColorRange,
    min_area: int,
    config: BlobLocalizerConfig,
) -> Iterator[Candidate]:
    """Yield groups of at least `min_area` connected pixels in a range of colours."""
    colored = colors.mask(picture.color)
    for region in _components(colored, min_area):
        blob = None
        if picture.noise:
            blob = _refined(picture, shape, region, config.candidates)
        yield Candidate(region if blob is None else blob, colored)


def by_steps(
    picture: Picture,
    shape: Solid,
    colors: ColorRange,
    min_area: int,
    config: BlobLocalizerConfig,
) -> Iterator[Candidate]:
    """Yield regions bounded by steps in depth, in the range's colours under any light.

    There are none if colour and depth are not seen along the same rays.
    """
    if not picture.color_imager.same_as(picture.depth_imager):
        return
    depth, size = picture.depth, np.sort(shape.bounding_size)
    known = has_depth(depth)
    near = np.where(known, depth, np.float32(0.0))
    steps = cv2.morphologyEx(near, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    level = known & (steps < _step(picture, shape, near, config.candidates))
    level &= colors.mask_in_any_light(picture.color, config.any_light)
    focal = picture.depth_imager.info.focal_x()
    least_area = config.candidates.least_area * size[0] * size[1]
    for region in _components(level, min_area):
        pixel = float(np.median(depth[region])) / focal
        extent = pixel * max(np.ptp(np.nonzero(region), axis=1))
        area = pixel**2 * region.sum()
        if area < least_area or extent > np.linalg.norm(size):
            continue
        blob = _refined(picture, shape, region, config.candidates)
        if blob is not None:
            yield Candidate(blob, blob)


def _refined(
    picture: Picture, shape: Solid, region: Mask, config: CandidatesConfig
) -> Mask | None:
    """Return a region with its rim drawn between its own colour and the background's.

    Blur mixes the two, so the edge is where the mixture is even, whatever the colours.

    Returns:
        None if depth does not set the region off from its surroundings.
    """
    depth = picture.depth
    usable = region & has_depth(depth)
    if not (picture.color_imager.same_as(picture.depth_imager) and usable.any()):
        return None
    distance = float(np.median(depth[usable]))
    step = float(_step(picture, shape, np.float32(distance), config))
    rim = grow(region, config.rim)
    beside = grow(region, config.rim + config.beside) & ~rim
    behind = beside & (depth > distance + step)
    level = beside & (np.abs(depth - distance) <= step)
    if (
        behind.sum() < config.least_behind * beside.sum()
        or level.sum() > config.most_level * beside.sum()
    ):
        return None
    color = picture.color[..., :3].astype(np.float32)
    own, other = (np.median(color[pixels], axis=0) for pixels in (usable, behind))
    blob = np.zeros_like(region)
    # The nearer of two colours: the side of their middle on which a pixel is.
    blob[rim] = (color[rim] - 0.5 * (own + other)) @ (own - other) > 0
    return blob


def _step(
    picture: Picture,
    shape: Solid,
    depth: npt.NDArray[np.float32] | np.float32,
    config: CandidatesConfig,
) -> npt.NDArray[np.float32] | np.float32:
    """Return the least step in depth at the edge of an object of a shape [m]."""
    least = np.float32(config.step * shape.bounding_size.min())
    return least + np.float32(config.deviations * picture.noise) * depth**2


def _components(mask: Mask, min_area: int) -> Iterator[Mask]:
    """Yield groups of connected pixels, diagonals included."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=8
    )
    for i in range(1, count):  # 0 is the background
        if stats[i, cv2.CC_STAT_AREA] >= min_area:
            yield labels == i
