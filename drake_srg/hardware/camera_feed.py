"""A hardware camera as a system."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, ValueProducer
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from drake_srg.hardware.cameras import Camera
from drake_srg.hardware.pictures import Picture
from drake_srg.lifetime import LeafSystem, weak


class CameraFeed(LeafSystem):
    """Outputs pictures of a camera, with the ports of Drake's RgbdSensor.

    .. pydrake_system::

        name: CameraFeed
        input_ports:
        - stamp
        output_ports:
        - color_image
        - depth_image
        - body_pose_in_world

    An image is evaluated only when somebody looks. It then waits for a picture that is
    newer than `stamp` (1), the time by the robot's clock [s]: one from before might
    show the arm on its way. So whoever looks must not be in a hurry.

    Args:
        camera: The camera.
        X_WB: The pose of its body in world [m].
    """

    def __init__(self, camera: Camera, X_WB: RigidTransform) -> None:
        super().__init__()
        self._camera = camera
        self._stamp = self.DeclareVectorInputPort(name="stamp", size=1)
        # Time, too: the camera sees more than the inputs tell. No update event could
        # fetch the picture instead, because none knows whether anybody will look, and
        # each would wait for the camera.
        entry = self.DeclareCacheEntry(
            description="picture",
            value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make(object()),
                calc=weak(self._calc_picture),
            ),
            prerequisites_of_calc={self.time_ticket(), self._stamp.ticket()},
        )
        self._entry = entry.cache_index()
        for name, model, calc in (
            ("color_image", ImageRgba8U(), self._calc_color),
            ("depth_image", ImageDepth32F(), self._calc_depth),
        ):
            self.DeclareAbstractOutputPort(
                name, AbstractValue.Make(model).Clone, calc, {entry.ticket()}
            )
        self.DeclareAbstractOutputPort(
            "body_pose_in_world",
            AbstractValue.Make(X_WB).Clone,
            lambda context, output: None,  # it never moves
            {self.nothing_ticket()},
        )

    def _calc_picture(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._camera.picture(self._stamp.Eval(context)[0]))

    def _picture(self, context: Context) -> Picture:
        entry = self.get_cache_entry(self._entry)
        picture: Picture = entry.EvalAbstract(context).get_value()
        return picture

    def _calc_color(self, context: Context, output: AbstractValue) -> None:
        pixels = self._picture(context).color
        image = ImageRgba8U(pixels.shape[1], pixels.shape[0])
        image.mutable_data[:] = pixels
        output.set_value(image)

    def _calc_depth(self, context: Context, output: AbstractValue) -> None:
        depth = self._picture(context).depth
        image = ImageDepth32F(depth.shape[1], depth.shape[0])
        image.mutable_data[:] = depth[..., np.newaxis]
        output.set_value(image)
