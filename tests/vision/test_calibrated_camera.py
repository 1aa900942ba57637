import numpy as np
from helpers import fix, port_table, read
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.schema import Transform
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.sensors import CameraConfig

from drake_srg.vision.calibrated_camera import (
    CalibratedPose,
    CameraCalibrationConfig,
    calibrated_model,
)
from drake_srg.vision.camera import CameraModel

numbers = st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6)


def pose(values):
    return RigidTransform(RollPitchYaw(values[:3]), values[3:])


@given(numbers, numbers, numbers)
@settings(max_examples=20)
def test_the_camera_is_believed_where_it_is_calibrated(base, config, calibrated):
    X_WP, X_PB, X_PE = pose(base), pose(config), pose(calibrated)
    system = CalibratedPose(X_PB, X_PE)
    context = system.CreateDefaultContext()
    fix(system, context, body_pose_in_world=AbstractValue.Make(X_WP @ X_PB))
    found = read(system, context, "body_pose_in_world")
    assert found.IsNearlyEqualTo(X_WP @ X_PE, 1e-9)


def test_its_ports_pass_a_pose():
    system = CalibratedPose(RigidTransform(), RigidTransform())
    ports = {"body_pose_in_world": None}
    assert port_table(system) == (ports, ports)


def test_calibrated_intrinsics_replace_those_of_both_images():
    config = CameraConfig()
    calibration = CameraCalibrationConfig(
        focal=[600.0, 601.0], center=[310.0, 235.0], X_PB=Transform()
    )
    model = calibrated_model(config, calibration)
    for which in ("color", "depth"):
        pixel = model.imager(which).project(np.array([0.1, 0.2, 1.0]))
        np.testing.assert_allclose(pixel, [369.5, 354.7])
    plain = CameraModel.from_config(config).imager("color")
    assert calibrated_model(config, None).imager("color").same_as(plain)
