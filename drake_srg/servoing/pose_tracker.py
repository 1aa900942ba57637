"""From blobs to the sightings of a position-based servo."""

from __future__ import annotations

import zlib

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageRgba8U

from drake_srg.lifetime import LeafSystem
from drake_srg.servoing.sightings import PoseSighting
from drake_srg.types import Blob, BlobFlag


class PoseTracker(LeafSystem):
    """Outputs the pose of an object in a camera, from blobs in world.

    .. pydrake_system::

        name: PoseTracker
        input_ports:
        - blobs
        - color_image
        - body_pose_in_world
        output_ports:
        - sighting

    Inputs: `blobs` (list[Blob]) of one camera; `color_image` (ImageRgba8U), which only
    tells one image from another; `body_pose_in_world` (RigidTransform X_WB), the
    camera's pose that the localizer believes. Output: `sighting` (PoseSighting),
    computed when it is evaluated. It has no pose if the object's best blob is uncertain
    or touches the image's border.

    Args:
        object_name: Name of the object's blobs.
        X_BC: The colour imager in the camera's body [m].
    """

    def __init__(self, object_name: str, X_BC: RigidTransform) -> None:
        super().__init__()
        self._name, self._X_BC = object_name, X_BC
        none: list[Blob] = []
        for name, value in (
            ("blobs", none),
            ("color_image", ImageRgba8U()),
            ("body_pose_in_world", RigidTransform()),
        ):
            self.DeclareAbstractInputPort(
                name=name, model_value=AbstractValue.Make(value)
            )
        self.DeclareAbstractOutputPort(
            name="sighting",
            alloc=lambda: AbstractValue.Make(PoseSighting()),
            calc=self._calc_sighting,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def _calc_sighting(self, context: Context, output: AbstractValue) -> None:
        image = self.GetInputPort("color_image").Eval(context).data
        X_WB = self.GetInputPort("body_pose_in_world").Eval(context)
        own = [
            blob
            for blob in self.GetInputPort("blobs").Eval(context)
            if blob.object_name == self._name
        ]
        blob = max(own, key=lambda blob: blob.trust, default=None)
        X_CO = None
        if blob and blob.certain and BlobFlag.BORDER not in blob.flags:
            X_CO = (X_WB @ self._X_BC).inverse() @ blob.X_WO
        output.set_value(PoseSighting(zlib.crc32(image.tobytes()), X_CO))
