import numpy as np
import pytest
from helpers import fix, read
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.schema import Transform
from pydrake.common.value import AbstractValue
from pydrake.lcm import DrakeLcm
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import ApplyCameraConfig, CameraConfig, CameraInfo

from drake_srg import types
from drake_srg.vision.camera import (
    DRAKE_PIXEL_CENTER,
    CalibratedPose,
    CameraCalibrationConfig,
    CameraModel,
    calibrated_model,
)
from vision.vision_scene import FOV_Y, RED, Camera, Thing, make_sensors, render

INFO = CameraInfo(640, 480, FOV_Y)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["color", "depth"])
def test_drake_samples_a_pixel_half_a_pixel_off_its_index(kind):
    """A pixel shows a plate if and only if its sampling point is on the plate.

    Every edge of a plate at a random place bounds the offset of the sampling points
    from one side. Thirty plates leave a narrow interval.
    """
    rng = np.random.default_rng(1)
    low, high = np.full(2, -1.0), np.full(2, 2.0)
    for _ in range(30):
        x, y = rng.uniform(-0.25, 0.25, 2)
        plate = Thing(types.Box((0.2, 0.2, 0.001)), (x, y, 0.0995), RED)
        color, depth = render([plate])
        on = depth < 1.45 if kind == "depth" else color[..., 1] < 60
        first = np.array([np.flatnonzero(on.any(axis=a))[0] for a in (0, 1)])
        last = np.array([np.flatnonzero(on.any(axis=a))[-1] for a in (0, 1)])
        middle = np.array([x, -y])
        center = np.array([INFO.center_x(), INFO.center_y()])
        left, right = (
            center + INFO.focal_x() * (middle + d) / 1.4 for d in (-0.1, 0.1)
        )
        low = np.maximum(low, np.maximum(left - first, right - last - 1))
        high = np.minimum(high, np.minimum(left - first + 1, right - last))
    # Edge pixels mix two colours, which may move an edge by a tenth of a pixel.
    assert np.all(low - 0.1 < DRAKE_PIXEL_CENTER)
    assert np.all(high + 0.1 > DRAKE_PIXEL_CENTER)
    assert np.all(high - low < 0.15)


def test_projecting_a_ray_gives_its_pixel():
    imager = CameraModel(INFO).imager("depth")
    rays = imager.rays(slice(10, 13), slice(400, 402))
    assert rays.shape == (2, 3, 3)
    np.testing.assert_allclose(imager.project(1.7 * rays)[1, 2], [12, 401])


def test_lookup_is_false_outside_the_image_and_behind_the_camera():
    imager = CameraModel(INFO).imager("color")
    image = np.ones((480, 640), dtype=bool)
    points = np.array([[0, 0, 1.0], [2.0, 0, 1.0], [0, 0, -1.0], [np.nan, 0, 1.0]])
    assert imager.lookup(points, image).tolist() == [True, False, False, False]


def test_depth_is_taken_like_color_unless_the_model_says_otherwise():
    shift = RigidTransform([0.01, 0, 0])
    model = CameraModel(INFO, X_BC=shift)
    assert model.imager("depth").same_as(model.imager("color"))
    model = CameraModel(INFO, X_BD=shift)
    assert not model.imager("depth").same_as(model.imager("color"))


def test_a_model_is_read_from_a_sensor():
    X_BD = RigidTransform([0.02, 0.0, 0.0])
    camera = Camera(depth_size=(320, 240), X_BD=X_BD)
    sensor = make_sensors(DiagramBuilder(), [], {"c": camera})["c"]
    model = CameraModel.from_sensor(sensor)
    assert model.color.width() == 640
    assert model.depth is not None
    assert model.depth.width() == 320
    assert model.imager("depth").X_BI.IsExactlyEqualTo(X_BD)


def test_a_config_gives_the_model_of_the_sensor_that_drake_makes_of_it():
    config = CameraConfig(
        name="eye",
        width=320,
        height=240,
        center_x=150.0,
        X_BC=Transform(translation=[0.01, 0.0, 0.0]),
        X_BD=Transform(translation=[0.02, 0.0, 0.0]),
        show_rgb=False,
    )
    model = CameraModel.from_config(config)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    plant.Finalize()
    ApplyCameraConfig(
        config, builder, plant=plant, scene_graph=scene_graph, lcm=DrakeLcm("memq://")
    )
    made = CameraModel.from_sensor(builder.GetSubsystemByName("rgbd_sensor_eye"))
    for which in ("color", "depth"):
        assert model.imager(which).same_as(made.imager(which))
    assert not model.imager("depth").same_as(model.imager("color"))


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
