"""Finds objects of known colour and shape in colour and depth images."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, State
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Blob, BlobFlag, Shape
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.candidates import Candidate, Picture, Search, by_color, by_steps
from drake_srg.vision.color import ColorRange
from drake_srg.vision.depth_noise import clean
from drake_srg.vision.shape_fit import Fit, fit_shape
from drake_srg.vision.solids import bounding_size
from drake_srg.vision.view import view_around

# More misfit than another blob's: what a target's own noise and edges hardly make. What
# other values change is measured by experiment localizer_thresholds.
_LESS_LIKE = 0.05


@dc.dataclass(frozen=True)
class BlobTarget:
    """What to look for."""

    name: str
    shape: Shape
    color: ColorRange


class BlobLocalizer(LeafSystem):
    """Positions of the targets that the cameras see, one Blob a sighting.

    A target's pixels are found by colour, their connected components give the blobs,
    and depth and the known shape give each blob the position of the object's centre
    (see `fit_shape`). Cylinders may stand, lean or lie; boxes are taken to stand,
    within 15 degrees. The colour need not hold all over an object: depth tells what
    belongs to it, so a strict range may find it by its lit parts. Where none is certain
    by its colour, as in other light, what steps in depth set off is looked at, too. Two
    blobs nearer to each other than the object is wide are the same object seen in two
    parts; the better one stays.

    Noise is measured in the depth image itself: it is cleaned, everything is judged by
    what noise is left, and where noise hides small leans, what stands is upright. What
    fits the target's shape clearly worse than another blob is UNCERTAIN.

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
    (RigidTransform X_WB). The output `blobs` is a list[Blob], in the order of the
    targets and the best first, by `Blob.trust`; poses in world [m].

    With `period` 0 the output is computed when it is evaluated, so cameras that nobody
    asks cost nothing. With a positive period the images are sampled by a periodic event
    and the output repeats the last sample.

    Args:
        targets: What to look for, by unique names.
        cameras: Camera name to its model.
        period: 0, or the sampling period [s].
        min_area: Smaller blobs are dropped [pixels].
        min_quality: Uncertain blobs with a smaller share of the outline seen are
            dropped, 0 .. 1.

    Raises:
        ValueError: If targets or cameras are empty, a name appears twice, or a number
            is out of range.
    """

    def __init__(
        self,
        targets: Sequence[BlobTarget],
        cameras: Mapping[str, CameraModel],
        *,
        period: float = 0.0,
        min_area: int = 12,
        min_quality: float = 0.2,
    ):
        super().__init__()
        names = [target.name for target in targets]
        if not names or len(set(names)) < len(names):
            raise ValueError(
                f"BlobLocalizer needs targets of unique names, got {names}"
            )
        if not cameras:
            raise ValueError("BlobLocalizer needs at least one camera")
        if period < 0 or min_area < 1 or not 0 <= min_quality <= 1:
            raise ValueError(
                f"BlobLocalizer has period={period}, min_area={min_area}, min_quality="
                f"{min_quality}; allowed are period >= 0, min_area >= 1 and a "
                "min_quality of 0 .. 1"
            )
        self._targets = tuple(targets)
        self._cameras = {
            name: (model.imager("color"), model.imager("depth"))
            for name, model in cameras.items()
        }
        self._min_area = min_area
        self._min_quality = min_quality

        image_types = {"color_image": ImageRgba8U, "depth_image": ImageDepth32F}
        for camera in cameras:
            for port, image in image_types.items():
                self.DeclareAbstractInputPort(
                    name=f"{camera}.{port}", model_value=AbstractValue.Make(image())
                )
            self.DeclareAbstractInputPort(
                name=f"{camera}.body_pose_in_world",
                model_value=AbstractValue.Make(RigidTransform()),
            )
        empty: list[Blob] = []
        if period == 0:
            calc, prerequisites = self._calc_blobs, {self.all_input_ports_ticket()}
        else:
            self._sample = self.DeclareAbstractState(AbstractValue.Make(empty))
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
            calc = self._copy_sample
            prerequisites = {self.abstract_state_ticket(self._sample)}
        self.DeclareAbstractOutputPort(
            name="blobs",
            alloc=lambda: AbstractValue.Make(empty),
            calc=calc,
            prerequisites_of_calc=prerequisites,
        )

    def _calc_blobs(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._locate(context))

    def _copy_sample(self, context: Context, output: AbstractValue) -> None:
        output.set_value(
            list(context.get_abstract_state(int(self._sample)).get_value())
        )

    def _update(self, context: Context, state: State) -> EventStatus:
        found = self._locate(context)
        state.get_mutable_abstract_state(int(self._sample)).set_value(found)
        return EventStatus.Succeeded()

    def _locate(self, context: Context) -> list[Blob]:
        found: dict[str, list[Blob]] = {target.name: [] for target in self._targets}
        for camera, (color_imager, depth_imager) in self._cameras.items():
            color = self._image(context, camera, "color")
            depth, noise = clean(self._image(context, camera, "depth")[..., 0])
            picture = Picture(
                color,
                depth,
                noise,
                color_imager,
                depth_imager,
                self._input(context, f"{camera}.body_pose_in_world"),
            )
            for target in self._targets:
                found[target.name] += self._see(target, camera, picture)
        return [blob for blobs in found.values() for blob in _best_first(blobs)]

    def _see(self, target: BlobTarget, camera: str, picture: Picture) -> list[Blob]:
        """The blobs of one target in one camera."""

        def fits(search: Search) -> list[Blob]:
            found = search(picture, target.shape, target.color, self._min_area)
            blobs = (self._fit(target, camera, picture, c) for c in found)
            return [blob for blob in blobs if blob is not None]

        seen = fits(by_color)
        if not any(blob.certain for blob in seen):
            others = fits(by_steps)
            # What is seen in the target's own colour is told better, not replaced.
            seen += [o for o in others if not seen or _near(o, seen, target.shape)]
        return _told_apart(_distinct(seen, target.shape))

    def _fit(
        self, target: BlobTarget, camera: str, picture: Picture, candidate: Candidate
    ) -> Blob | None:
        """The blob of a candidate, None where the shape does not fit."""
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
        if fit is None or (fit.uncertain and fit.quality < self._min_quality):
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
            position=fit.position,
            axis=fit.axis,
            quality=fit.quality,
            flags=_flags(fit, bool(at_border)),
            misfit=fit.misfit,
        )

    def _image(self, context: Context, camera: str, which: str) -> npt.NDArray[Any]:
        image = self._input(context, f"{camera}.{which}_image").data
        info = self._cameras[camera][which == "depth"].info
        if image.shape[:2] != (info.height(), info.width()):
            raise ValueError(
                f"{camera}.{which}_image is {image.shape[1]}x{image.shape[0]} pixels, "
                f"but its camera model says {info.width()}x{info.height()}"
            )
        return np.asarray(image)

    def _input(self, context: Context, name: str) -> Any:
        port = self.GetInputPort(name)
        if not port.HasValue(context):
            raise RuntimeError(f"BlobLocalizer's input port {name!r} is not connected")
        return port.Eval(context)


def _flags(fit: Fit, at_border: bool) -> frozenset[BlobFlag]:
    flags = {
        BlobFlag.BORDER: fit.cut or at_border,
        BlobFlag.OCCLUDED: fit.hidden,
        BlobFlag.UNCERTAIN: fit.uncertain,
    }
    return frozenset(flag for flag, raised in flags.items() if raised)


def _best_first(blobs: Iterable[Blob]) -> list[Blob]:
    return sorted(blobs, key=lambda blob: blob.trust, reverse=True)


def _near(blob: Blob, others: list[Blob], shape: Shape) -> bool:
    """Whether it is nearer to another than the object is wide: the same object."""
    width = float(bounding_size(shape)[:2].min())
    return any(
        np.linalg.norm(blob.position - other.position) < width / 2 for other in others
    )


def _distinct(blobs: list[Blob], shape: Shape) -> list[Blob]:
    """The blobs without those that repeat a better one's object."""
    kept: list[Blob] = []
    for blob in _best_first(blobs):
        if not _near(blob, kept, shape):
            kept.append(blob)
    return kept


def _told_apart(blobs: list[Blob]) -> list[Blob]:
    """The blobs, uncertain where another one is clearly more like the target."""
    least = min((blob.misfit for blob in blobs if blob.certain), default=0.0)
    return [
        blob
        if blob.misfit <= least + _LESS_LIKE
        else dc.replace(blob, flags=blob.flags | {BlobFlag.UNCERTAIN})
        for blob in blobs
    ]
