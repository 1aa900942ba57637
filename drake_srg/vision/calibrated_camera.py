"""A camera's calibration: what is believed of its intrinsics and its pose."""

import dataclasses as dc

from pydrake.common.schema import Transform
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from pydrake.systems.sensors import CameraConfig, CameraInfo

from drake_srg.lifetime import LeafSystem
from drake_srg.types import positive
from drake_srg.vision.camera import CameraModel


@dc.dataclass(kw_only=True)
class CameraCalibrationConfig:
    """A camera's calibrated intrinsics and pose, as `drake-srg calibrate` writes them.

    The localizer believes them. Simulated images still come from the camera's entry in
    `cameras`.
    """

    # Focal lengths and principal point of the colour image [pixels]; the image's upper
    # left corner is [0, 0], as in Drake's CameraInfo.
    focal: list[float] = dc.field(
        default_factory=lambda: [500.0] * 2, metadata=positive(length=2)
    )
    center: list[float] = dc.field(
        default_factory=lambda: [320.0, 240.0], metadata={"length": 2}
    )
    # Pose of the camera's body. Its base frame is that of the entry in `cameras`.
    X_PB: Transform = dc.field(default_factory=Transform)


def calibrated_model(
    config: CameraConfig, calibration: CameraCalibrationConfig | None
) -> CameraModel:
    """Return a camera's model with its calibrated intrinsics.

    They also replace those of the depth image where both images share them.

    Args:
        config: The camera.
        calibration: Of it; None: it is as configured.
    """
    model = CameraModel.from_config(config)
    if calibration is None:
        return model
    (fx, fy), (cx, cy) = calibration.focal, calibration.center
    width, height = model.color.width(), model.color.height()
    color = CameraInfo(width, height, fx, fy, cx, cy)
    shared = model.imager("depth").same_as(model.imager("color"))
    return dc.replace(model, color=color, depth=color if shared else model.depth)


class CalibratedPose(LeafSystem):
    """Moves a camera's pose from where its config has it to where it is calibrated.

    .. pydrake_system::

        name: CalibratedPose
        input_ports:
        - body_pose_in_world
        output_ports:
        - body_pose_in_world

    Args:
        X_PB: The camera's body in its base frame, according to its config [m].
        X_PB_calibrated: The same, calibrated [m].
    """

    def __init__(self, X_PB: RigidTransform, X_PB_calibrated: RigidTransform) -> None:
        super().__init__()
        self._X_BE = X_PB.inverse() @ X_PB_calibrated
        value = AbstractValue.Make(RigidTransform())
        source = self.DeclareAbstractInputPort("body_pose_in_world", value)
        self.DeclareAbstractOutputPort(
            "body_pose_in_world", value.Clone, self._calc_pose, {source.ticket()}
        )

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self.get_input_port().Eval(context) @ self._X_BE)
