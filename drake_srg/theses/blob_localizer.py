"""The localizer of the five-axis arm's thesis: a colour, a depth and two formulas.

It serves only for comparison with `BlobLocalizer`.
"""

import dataclasses as dc
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, State
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageRgba8U

from drake_srg.config import Config, positive
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Blob, Vector
from drake_srg.vision.camera import CameraModel, Imager

# The target's red, green and blue, 0 .. 1, and the tolerance of each.
COLOR = np.array([0.85, 0.85, 1.0])
COLOR_TOLERANCE = 0.05
DEPTH_OFFSET = 0.01  # added to the depth of the blob's centroid [m]


@dc.dataclass(kw_only=True)
class ThesisBlobConfig(Config):
    """Options of the thesis's localizer; all else is as printed."""

    # Time between images, as long as no blob has been found [s].
    period: float = dc.field(default=0.05, metadata=positive())


class ThesisBlobLocalizer(LeafSystem):
    """Locates the first blob of a colour, once, by the thesis's formulas.

    .. pydrake_system::

        name: ThesisBlobLocalizer
        input_ports:
        - CAMERA.color_image
        - CAMERA.depth_image
        - CAMERA.body_pose_in_world
        output_ports:
        - blobs

    The inputs are those of a `BlobLocalizer` with one camera. `blobs` (list[Blob]) is
    empty until an image shows the colour. From then on it holds that one blob: the
    thesis's script sends it once (its flag `detectionSent`), wherever the object goes.

    The position is a point near the middle of the visible surface (`blob_position`), in
    world [m], not the object's centre, because the formulas know no shape. For the same
    reason, `axis` is always the world's z, and `quality` is 1.

    Args:
        object_name: Name of the blob.
        camera: Name of the camera.
        model: The camera's intrinsics. Both imagers must be at the body's pose.
        config: The time between images.
    """

    def __init__(
        self,
        object_name: str,
        camera: str,
        model: CameraModel,
        config: ThesisBlobConfig | None = None,
    ) -> None:
        super().__init__()
        self._object_name = object_name
        self._camera = camera
        self._imager: Imager = model.imager("depth")
        empty: list[Blob] = []
        self._color = self.DeclareAbstractInputPort(
            name=f"{camera}.color_image", model_value=AbstractValue.Make(ImageRgba8U())
        )
        self._depth = self.DeclareAbstractInputPort(
            name=f"{camera}.depth_image",
            model_value=AbstractValue.Make(ImageDepth32F()),
        )
        self._pose = self.DeclareAbstractInputPort(
            name=f"{camera}.body_pose_in_world",
            model_value=AbstractValue.Make(RigidTransform()),
        )
        self._sent = self.DeclareAbstractState(AbstractValue.Make(empty))
        period = (config or ThesisBlobConfig()).period
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
        self.DeclareAbstractOutputPort(
            name="blobs",
            alloc=lambda: AbstractValue.Make(empty),
            calc=self._calc_blobs,
            prerequisites_of_calc={self.abstract_state_ticket(self._sent)},
        )

    def _calc_blobs(self, context: Context, output: AbstractValue) -> None:
        output.set_value(list(self._state(context)))

    def _state(self, context: Context) -> list[Blob]:
        blobs: list[Blob] = context.get_abstract_state(int(self._sent)).get_value()
        return blobs

    def _update(self, context: Context, state: State) -> EventStatus:
        if self._state(context):
            return EventStatus.DidNothing()
        found = self.locate(context)
        if found is None:
            return EventStatus.DidNothing()
        state.get_mutable_abstract_state(int(self._sent)).set_value([found])
        return EventStatus.Succeeded()

    def locate(self, context: Context) -> Blob | None:
        """Return the blob in the present images, or None, whatever the state is."""
        color: Any = self._color.Eval(context).data
        depth: Any = self._depth.Eval(context).data[..., 0]
        center = first_blob(color)
        if center is None:
            return None
        p_IO = blob_position(center, depth, self._imager.info)
        X_WI = self._pose.Eval(context) @ self._imager.X_BI
        height, width = depth.shape
        return Blob(
            object_name=self._object_name,
            camera=self._camera,
            pixel=(center[0] * width - 0.5, (1.0 - center[1]) * height - 0.5),
            X_WO=RigidTransform(X_WI @ p_IO),
            quality=1.0,
        )


def first_blob(image: npt.NDArray[np.uint8]) -> tuple[float, float] | None:
    """Return the centroid of the first blob of the colour, or None.

    CoppeliaSim's images begin at the lower left, row by row, so the first blob is the
    one whose lowest row is lowest.

    Args:
        image: Shape (height, width, 3 or 4), from the top left.

    Returns:
        Its position as shares of the image's width from the left and height from below.
    """
    channels = image[::-1, :, :3].astype(float) / 255.0
    off = np.abs(channels - COLOR)
    # Half a step of 8 bits: 0.8 of 1 is 204 of 255, and 0.05 is no exact number.
    mask = np.all(off <= COLOR_TOLERANCE + 0.5 / 255.0, axis=2)
    count, _, statistics, centers = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8)
    )
    if count == 1:  # only the background
        return None
    first = 1 + int(np.argmin(statistics[1:, cv2.CC_STAT_TOP]))
    height, width = mask.shape
    x, y = centers[first]
    return (float(x) + 0.5) / width, (float(y) + 0.5) / height


def blob_position(
    center: tuple[float, float],
    depth: npt.NDArray[np.float32],
    info: CameraInfo,
    depth_offset: float = DEPTH_OFFSET,
) -> Vector:
    """Return the position that the thesis's formulas give a blob.

    With b the blob's centroid and a the camera's angles of view:

        d = depth at pixel 1 + floor(b (resolution - 0.99)), plus the offset
        x = d tan(a_x / 2) (0.5 - b_x) / 0.5
        y = d tan(a_y / 2) (b_y - 0.5) / 0.5

    The formulas count pixels from 1 at the lower left; x points to the left, y up. The
    larger side has the camera's angle, the other follows by the aspect ratio.

    Args:
        center: b, shares of the image's width and height from the lower left.
        depth: Shape (height, width) [m], from the top left.
        info: Intrinsics of the depth image.
        depth_offset: Added to the depth [m].

    Returns:
        In Drake's frame of the imager [m] (x right, y down, z ahead), shape (3,).
    """
    b = np.array(center)
    resolution = np.array([info.width(), info.height()])
    column, row = np.floor(b * (resolution - 0.99)).astype(int)
    d = float(depth[::-1][row, column]) + depth_offset
    larger = int(np.argmax(resolution))
    focal = (info.focal_x(), info.focal_y())[larger]
    tangent = resolution / resolution[larger] * (0.5 * resolution[larger] / focal)
    x, y = d * tangent * np.array([0.5 - b[0], b[1] - 0.5]) / 0.5
    return np.array([-x, -y, d])
