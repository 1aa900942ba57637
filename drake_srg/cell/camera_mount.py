"""Where a visual servo's camera is in the hand."""

from __future__ import annotations

import dataclasses as dc

from pydrake.math import RigidTransform
from pydrake.multibody.parsing import GetScopedFrameByName
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import Scenario, servo_of
from drake_srg.vision.calibrated_camera import calibrated_model
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.camera_errors import X_BE_believed


@dc.dataclass(frozen=True)
class CameraMount:
    """Where the camera's colour imager is in the hand.

    Attributes:
        X_GC: Truly [m].
        X_GC_believed: As calibrated [m].
        model: The camera's intrinsics, as calibrated.
    """

    X_GC: RigidTransform
    X_GC_believed: RigidTransform
    model: CameraModel

    @classmethod
    def of(cls, scenario: Scenario, plant: MultibodyPlant) -> CameraMount:
        """Return the mount of the servo's camera.

        Args:
            scenario: With a visual servo.
            plant: Of the scenario's models.

        Raises:
            ScenarioError: If the camera is not fixed to the hand.
        """
        servo = servo_of(scenario)
        assert servo is not None
        name = servo.camera
        config = scenario.cameras[name]
        palm = plant.GetBodyByName("palm", plant.GetModelInstanceByName("gripper"))
        base = config.X_PB.base_frame or "world"
        frame = GetScopedFrameByName(plant, base)
        if frame.body().index() not in {
            body.index() for body in plant.GetBodiesWeldedTo(palm)
        }:
            raise ScenarioError(
                f"cameras.{name}.X_PB.base_frame: must be fixed to the hand for "
                f"servoing, got {base} (allowed: gripper::palm)"
            )
        context = plant.CreateDefaultContext()
        X_GP = frame.CalcPose(context, palm.body_frame())
        calibration = scenario.camera_calibrations.get(name)
        model = calibrated_model(config, calibration)
        X_GB = X_GP @ config.X_PB.GetDeterministicValue()
        believed = X_GB
        if calibration is not None:
            believed = X_GP @ calibration.X_PB.GetDeterministicValue()
        elif name in scenario.camera_errors:
            believed = X_GB @ X_BE_believed(scenario.camera_errors[name])
        return cls(X_GB @ model.X_BC, believed @ model.X_BC, model)
