"""The localizer of objects with known colour and shape in colour and depth images."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from drake_srg.common.geometry import Solid
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Blob, BlobFlag
from drake_srg.vision.camera import (
    CameraModel,
    Imager,
    declare_camera_ports,
    eval_camera_port,
)
from drake_srg.vision.candidates import Candidate, Picture, Search, by_color, by_steps
from drake_srg.vision.color import ColorRange
from drake_srg.vision.images import clean_and_measure, metres
from drake_srg.vision.shape_fit import Fit, fit_shape
from drake_srg.vision.sight import view_around

# A blob is uncertain if its misfit exceeds the best one's by more than this. On the
# target itself, noise and edges hardly add as much.
_MISFIT_MARGIN = 0.05
# Uncertain blobs are dropped if a smaller share of their outline is seen.
_MIN_QUALITY = 0.2
_PORTS = ("color_image", "depth_image", "body_pose_in_world")


@dc.dataclass(frozen=True)
class BlobTarget:
    """An object to look for.

    Attributes:
        name: The object's name.
        shape: Its shape.
        color: Its colours.
        p_OC: The centre of `shape` in the object's frame [m]. The shape's frame is
            parallel to the object's.
    """

    name: str
    shape: Solid
    color: ColorRange
    p_OC: tuple[float, float, float] = (0.0, 0.0, 0.0)


class BlobLocalizer(LeafSystem):
    """Locates targets in camera images, with one Blob for each sighting.

    Connected pixels of a target's colour form a blob. Depth and the known shape
    determine the pose of the object in each blob (see `fit_shape`). Cylinders may
    stand, lean or lie. Boxes are assumed to rest on one of their faces, within 15
    degrees. Depth decides which pixels belong to the object, so a narrow range of
    colours is enough, even if it matches only lit parts. If no blob is certain by its
    colour, as under another light, regions bounded by steps in depth become blobs, too.
    Two blobs closer than half of the object's width show the same object, and only the
    better one is kept.

    The localizer filters the noise of the depth image and measures the rest, which sets
    the tolerances. If noise hides small leans, standing objects count as upright. A
    blob that fits the target's shape clearly worse than another one is UNCERTAIN.

    .. pydrake_system::

        name: BlobLocalizer
        input_ports:
        - CAMERA.color_image
        - CAMERA.depth_image
        - CAMERA.body_pose_in_world
        output_ports:
        - blobs

    Every camera has its three input ports: `{camera}.color_image` (ImageRgba8U),
    `{camera}.depth_image` (ImageDepth32F) and `{camera}.body_pose_in_world`
    (RigidTransform X_WB). The output `blobs` is a list[Blob] in world [m], in the order
    of the targets and, for each target, the most trustworthy first (`Blob.trust`).

    The output is computed when it is evaluated, so cameras cost no time while nobody
    reads the blobs.

    Args:
        targets: The objects to look for, by unique names.
        cameras: Camera name to its model.
        min_area: Smaller blobs are dropped [pixels].

    Raises:
        ValueError: If targets or cameras are empty, a name appears twice, or a number
            is out of range.
    """

    def __init__(
        self,
        targets: Sequence[BlobTarget],
        cameras: Mapping[str, CameraModel],
        *,
        min_area: int = 12,
    ):
        super().__init__()
        names = [target.name for target in targets]
        if not names or len(set(names)) < len(names):
            raise ValueError(
                f"BlobLocalizer needs targets of unique names, got {names}"
            )
        if not cameras:
            raise ValueError("BlobLocalizer needs at least one camera")
        if min_area < 1:
            raise ValueError(f"BlobLocalizer needs min_area >= 1, got {min_area}")
        self._targets = tuple(targets)
        self._cameras = {
            name: (model.imager("color"), model.imager("depth"))
            for name, model in cameras.items()
        }
        self._min_area = min_area

        declare_camera_ports(self, cameras, _PORTS)
        empty: list[Blob] = []
        self.DeclareAbstractOutputPort(
            name="blobs",
            alloc=lambda: AbstractValue.Make(empty),
            calc=self._calc_blobs,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def _calc_blobs(self, context: Context, output: AbstractValue) -> None:
        def read(camera: str) -> tuple[npt.NDArray[Any], npt.NDArray[Any], Any]:
            color, depth, X_WB = (
                eval_camera_port(self, context, camera, port) for port in _PORTS
            )
            return color, depth, X_WB

        output.set_value(
            self.locate({camera: read(camera) for camera in self._cameras})
        )

    def locate(
        self,
        images: Mapping[str, tuple[npt.NDArray[Any], npt.NDArray[Any], RigidTransform]],
    ) -> list[Blob]:
        """Return the blobs in images, as in the output `blobs`.

        Args:
            images: Colour, depth and X_WB of each camera; see `localize`.

        Raises:
            ValueError: If an image does not fit its camera's model.
        """
        found: dict[str, list[Blob]] = {target.name: [] for target in self._targets}
        for camera, (color, depth, X_WB) in images.items():
            color_imager, depth_imager = self._cameras[camera]
            _check_size(f"{camera}.color_image", color, color_imager)
            _check_size(f"{camera}.depth_image", depth, depth_imager)
            cleaned, noise = clean_and_measure(metres(depth))
            picture = Picture(color, cleaned, noise, color_imager, depth_imager, X_WB)
            for target in self._targets:
                found[target.name] += self._see(target, camera, picture)
        return [blob for blobs in found.values() for blob in _best_first(blobs)]

    def _see(self, target: BlobTarget, camera: str, picture: Picture) -> list[Blob]:
        """Return the blobs of one target in one camera."""

        def fits(search: Search) -> list[Blob]:
            found = search(picture, target.shape, target.color, self._min_area)
            blobs = (self._fit(target, camera, picture, c) for c in found)
            return [blob for blob in blobs if blob is not None]

        seen = fits(by_color)
        if not any(blob.certain for blob in seen):
            others = fits(by_steps)
            # These may replace blobs of the target's own colour, but not add to them.
            seen += [o for o in others if not seen or _near(o, seen, target.shape)]
        return _doubt_worse_fits(_distinct(seen, target.shape))

    def _fit(
        self, target: BlobTarget, camera: str, picture: Picture, candidate: Candidate
    ) -> Blob | None:
        """Return the blob of a candidate, None if the shape does not fit."""
        view = view_around(
            target.shape,
            candidate.blob,
            candidate.colored,
            picture.depth,
            picture.color_imager,
            picture.depth_imager,
            picture.X_WB,
            picture.noise,
        )
        fit = fit_shape(target.shape, view) if view else None
        if fit is None or (fit.uncertain and fit.quality < _MIN_QUALITY):
            return None
        rows, columns = np.nonzero(candidate.blob)
        h, w = candidate.blob.shape
        at_border = (
            min(rows.min(), columns.min()) == 0
            or rows.max() == h - 1
            or columns.max() == w - 1
        )
        return Blob(
            object_name=target.name,
            camera=camera,
            pixel=(float(columns.mean()), float(rows.mean())),
            X_WO=fit.X_WO @ RigidTransform(target.p_OC).inverse(),
            quality=fit.quality,
            flags=_flags(fit, bool(at_border)),
            misfit=fit.misfit,
        )


def localize(
    targets: Sequence[BlobTarget],
    color: npt.NDArray[np.uint8],
    depth: npt.NDArray[Any],
    model: CameraModel,
    X_WB: RigidTransform,
) -> list[Blob]:
    """Return the blobs of targets in the images of one camera, without a diagram.

    Args:
        targets: The objects to look for, by unique names.
        color: RGB or RGBA, shape (height, width, 3 or 4).
        depth: Floats [m] or whole numbers of 16 bits [mm], shape (height, width) or
            (height, width, 1). 0 is too near; inf, or 65535, is too far.
        model: Model of the camera.
        X_WB: Pose of the camera's body in world.

    Returns:
        The blobs, of a camera named `camera`.

    Raises:
        ValueError: If an image does not fit the model, or targets are missing.
    """
    localizer = BlobLocalizer(targets, {"camera": model})
    return localizer.locate({"camera": (color, depth, X_WB)})


def _check_size(name: str, image: npt.NDArray[Any], imager: Imager) -> None:
    info = imager.info
    if image.shape[:2] != (info.height(), info.width()):
        raise ValueError(
            f"{name} is {image.shape[1]}x{image.shape[0]} pixels, but its camera model "
            f"says {info.width()}x{info.height()}"
        )


def _flags(fit: Fit, at_border: bool) -> frozenset[BlobFlag]:
    flags = {
        BlobFlag.BORDER: fit.cut or at_border,
        BlobFlag.OCCLUDED: fit.hidden,
        BlobFlag.UNCERTAIN: fit.uncertain,
    }
    return frozenset(flag for flag, raised in flags.items() if raised)


def _best_first(blobs: Iterable[Blob]) -> list[Blob]:
    return sorted(blobs, key=lambda blob: blob.trust, reverse=True)


def _near(blob: Blob, others: list[Blob], shape: Solid) -> bool:
    """Return whether a blob is within half of the object's width of one of the others.

    Such blobs show the same object.
    """
    width = float(shape.bounding_size[:2].min())
    return any(
        np.linalg.norm(blob.position - other.position) < width / 2 for other in others
    )


def _distinct(blobs: list[Blob], shape: Solid) -> list[Blob]:
    """Return the best blob of each object."""
    kept: list[Blob] = []
    for blob in _best_first(blobs):
        if not _near(blob, kept, shape):
            kept.append(blob)
    return kept


def _doubt_worse_fits(blobs: list[Blob]) -> list[Blob]:
    """Return the blobs; those that fit clearly worse than another are UNCERTAIN."""
    least = min((blob.misfit for blob in blobs if blob.certain), default=0.0)
    return [
        blob
        if blob.misfit <= least + _MISFIT_MARGIN
        else dc.replace(blob, flags=blob.flags | {BlobFlag.UNCERTAIN})
        for blob in blobs
    ]
