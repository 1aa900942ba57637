"""Groups of pixels that may show a target. The fit of its shape decides later."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.common.geometry import ConvexPieces, Solid
from drake_srg.vision.camera import Imager
from drake_srg.vision.color import ColorImage, ColorRange
from drake_srg.vision.images import Mask, grow, has_depth

# Least step in depth at an object's edge, as a share of the object's least extent:
# surfaces behind the object are farther away than this.
_STEP = 0.25
_DEVIATIONS = 6.0  # a step also exceeds this many standard deviations of noise
# Least area of a region, as a share of the object's smallest face. A smaller region
# cannot identify the object.
_LEAST_AREA = 0.08
# The same for a thing that is fully visible. From any side, a box, cylinder or ball
# covers at least 0.79 of the smallest face of the box around it.
_LEAST_WHOLE_AREA = 0.5
# A thing is fully visible if at most this share of the pixels beside it is neither the
# ground nor far behind it.
_MOST_ELSE_BESIDE = 0.05
# Least share of a region's surroundings that must lie behind it, and greatest share
# that may lie level with it. The rest may be in front of the region or touch it.
_LEAST_BEHIND = 0.3
_MOST_LEVEL = 0.25
# Width of the rim around a region [pixels]. The pixels of a step itself are neither
# before nor behind it.
_RIM = 2
_BESIDE = 5  # width of the band beyond the rim that shows the surroundings [pixels]


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


Search: TypeAlias = Callable[[Picture, Solid, ColorRange, int], Iterator[Candidate]]


def by_color(
    picture: Picture,
    shape: Solid,
    colors: ColorRange,
    min_area: int,
) -> Iterator[Candidate]:
    """Yield groups of at least `min_area` connected pixels in a range of colours.

    Fully visible things that are too small for the shape are left out.
    """
    colored = colors.mask(picture.color)
    aligned = picture.color_imager.same_as(picture.depth_imager)
    for region in _regions(colored, min_area):
        edge = _edge_of(picture, shape, region) if aligned else None
        if edge and edge.is_too_small(picture, shape):
            continue
        if edge and picture.noise and edge.sets_off():
            blob = edge.refined(picture)
        else:
            blob = region.mask()
        yield Candidate(blob, colored)


def by_steps(
    picture: Picture,
    shape: Solid,
    colors: ColorRange,
    min_area: int,
) -> Iterator[Candidate]:
    """Yield regions bounded by steps in depth, in the range's colours under any light.

    If colour and depth are not seen along the same rays, there are none.
    """
    if not picture.color_imager.same_as(picture.depth_imager):
        return
    depth = picture.depth
    known = has_depth(depth)
    near = np.where(known, depth, np.float32(0.0))
    steps = cv2.morphologyEx(near, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    level = known & (steps < _step(picture, shape, near))
    level &= colors.mask_in_any_light(picture.color)
    focal = picture.depth_imager.info.focal_x()
    least_area = _LEAST_AREA * _smallest_face(shape)
    for region in _regions(level, min_area):
        distances = depth[region.window][region.part(region.window)]
        pixel = float(np.median(distances)) / focal
        extent = pixel * (max(s.stop - s.start for s in region.window) - 1)
        area = pixel**2 * region.area
        if area < least_area or extent > np.linalg.norm(shape.bounding_size):
            continue
        edge = _edge_of(picture, shape, region)
        if edge is None or not edge.sets_off():
            continue
        if not edge.is_too_small(picture, shape):
            blob = edge.refined(picture)
            yield Candidate(blob, blob)


@dc.dataclass(frozen=True)
class _Region:
    """A group of connected pixels.

    Attributes:
        labels: The number of each pixel's group, shape (h, w).
        number: The number of this group.
        window: Rows and columns of the group, without a margin.
        area: Number of its pixels.
    """

    labels: npt.NDArray[Any]
    number: int
    window: tuple[slice, slice]
    area: int

    def mask(self) -> Mask:
        """Return its pixels, shape (h, w)."""
        return np.asarray(self.labels == self.number)

    def part(self, window: tuple[slice, slice]) -> Mask:
        """Return its pixels in a window."""
        return np.asarray(self.labels[window] == self.number)

    def around(self, margin: int) -> tuple[slice, slice]:
        """Return the window, enlarged on each side within the image [pixels]."""
        rows, columns = (
            slice(max(0, s.start - margin), min(size, s.stop + margin))
            for s, size in zip(self.window, self.labels.shape, strict=True)
        )
        return rows, columns


@dc.dataclass(frozen=True)
class _Edge:
    """Surroundings of a region of pixels, in a window of an image.

    Attributes:
        region: The region.
        window: Rows and columns of the window.
        usable: Pixels of the region that have depth.
        rim: The region and the pixels of its own edge.
        beside: Pixels beside the rim.
        behind: Pixels beside the rim that lie behind the region.
        behind_share: Share of the pixels beside the rim that lie behind the region.
        level_share: Share of the pixels beside the rim that lie level with the region.
        cut: Whether the region reaches the image's border.
        distance: Distance of the region, along the depth imager's z [m].
        step: Least step in depth at the edge of an object of the shape [m].
        pixel: Width of a pixel at the region [m].
    """

    region: _Region
    window: tuple[slice, slice]
    usable: Mask
    rim: Mask
    beside: Mask
    behind: Mask
    behind_share: float
    level_share: float
    cut: bool
    distance: float
    step: float
    pixel: float

    def sets_off(self) -> bool:
        """Return whether a step in depth separates the region from its surroundings."""
        return self.behind_share >= _LEAST_BEHIND and self.level_share <= _MOST_LEVEL

    def is_too_small(self, picture: Picture, shape: Solid) -> bool:
        """Return whether the region is fully visible but too small for a shape.

        The pixels beside the thing must show the ground or something far behind it.
        Other parts of the same thing, in another colour, would be nearer. Convex pieces
        are never too small, because they need not fill the box around them.
        """
        area = self.region.area * self.pixel**2
        if (
            self.cut
            or isinstance(shape, ConvexPieces)
            or area >= _LEAST_WHOLE_AREA * _smallest_face(shape)
        ):
            return False
        extent = float(np.linalg.norm(shape.bounding_size))
        about = picture.depth[self.region.around(int(np.ceil(extent / self.pixel)))]
        ground = np.median(about[has_depth(about)])
        beside = picture.depth[self.window][self.beside]
        is_ground = np.abs(beside - ground) <= self.step
        is_ground &= beside > self.distance + self.step
        is_far = beside > self.distance + extent
        return bool(np.mean(~(is_ground | is_far)) <= _MOST_ELSE_BESIDE)

    def refined(self, picture: Picture) -> Mask:
        """Return the region, with its edge between its own colour and the background's.

        Blur mixes the two colours, so the edge is where both have equal shares.
        """
        color = picture.color[self.window][..., :3].astype(np.float32)
        own, other = (np.median(color[m], axis=0) for m in (self.usable, self.behind))
        blob = np.zeros(picture.depth.shape, bool)
        # A pixel is inside if its colour is nearer to `own` than to `other`.
        inside = (color[self.rim] - 0.5 * (own + other)) @ (own - other) > 0
        blob[self.window][self.rim] = inside
        return blob


def _edge_of(picture: Picture, shape: Solid, region: _Region) -> _Edge | None:
    """Return a region's edge, None if the region has no depth.

    Colour and depth must be seen along the same rays.
    """
    border = _RIM + _BESIDE
    around = region.around(border)
    own, depth = region.part(around), picture.depth[around]
    usable = own & has_depth(depth)
    if not usable.any():
        return None
    distance = float(np.median(depth[usable]))
    step = float(_step(picture, shape, np.float32(distance)))
    rim = grow(own, _RIM)
    beside = grow(own, border) & ~rim
    behind = beside & (depth > distance + step)
    level = beside & (np.abs(depth - distance) <= step)
    return _Edge(
        region=region,
        window=around,
        usable=usable,
        rim=rim,
        beside=beside,
        behind=behind,
        behind_share=behind.sum() / max(1, beside.sum()),
        level_share=level.sum() / max(1, beside.sum()),
        cut=bool(own[[0, -1]].any() or own[:, [0, -1]].any()),
        distance=distance,
        step=step,
        pixel=distance / picture.depth_imager.info.focal_x(),
    )


def _smallest_face(shape: Solid) -> float:
    """Return the area of the smallest face of the box around a shape [m^2]."""
    size = np.sort(shape.bounding_size)
    return float(size[0] * size[1])


def _step(
    picture: Picture,
    shape: Solid,
    depth: npt.NDArray[np.float32] | np.float32,
) -> npt.NDArray[np.float32] | np.float32:
    """Return the least step in depth at the edge of an object of a shape [m]."""
    least = np.float32(_STEP * shape.bounding_size.min())
    return least + np.float32(_DEVIATIONS * picture.noise) * depth**2


def _regions(mask: Mask, min_area: int) -> Iterator[_Region]:
    """Yield groups of connected pixels, diagonals included."""
    count, found, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=8
    )
    labels = np.asarray(found)
    for i in range(1, count):  # 0 is the background
        x, y, w, h, area = (int(value) for value in stats[i])
        if area >= min_area:
            window = (slice(y, y + h), slice(x, x + w))
            yield _Region(labels, i, window, area)
