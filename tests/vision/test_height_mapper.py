import numpy as np
import pytest
from pydrake.systems.sensors import CameraInfo, ImageDepth32F

from drake_srg.types import Box
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.height_mapper import HeightMapper
from drake_srg.vision.surface import Surface
from vision.vision_scene import CAN, Camera, render, standing

MAPPED = Surface((-0.3, -0.3), (0.3, 0.3), 0.0)
CAMERA = Camera()
MODEL = CameraModel(CameraInfo(CAMERA.width, CAMERA.height, CAMERA.fov_y))
THINGS = [standing(CAN, 0.1, 0.05), standing(Box([0.06, 0.09, 0.05]), -0.1, 0.0)]


def connected(things):
    """Return a mapper and its context, with the image of a scene."""
    mapper = HeightMapper({"top": MODEL}, MAPPED)
    context = mapper.CreateDefaultContext()
    image = ImageDepth32F(CAMERA.width, CAMERA.height)
    image.mutable_data[..., 0] = render(things)[1]
    mapper.GetInputPort("top.depth_image").FixValue(context, image)
    mapper.GetInputPort("top.body_pose_in_world").FixValue(context, CAMERA.X_WB)
    return mapper, context


def test_it_maps_a_rendered_scene():
    mapper, context = connected(THINGS)
    found = mapper.GetOutputPort("height_map").Eval(context)
    middles = found.middles()
    for thing in THINGS:
        away = np.abs(middles - thing.position[:2]).max(axis=-1)
        top = found.height[away < 0.015]
        np.testing.assert_allclose(top, thing.shape.height, atol=5e-4)
    cloud = mapper.GetOutputPort("point_cloud").Eval(context).xyzs()
    assert abs(cloud[2].max() - CAN.height) < 5e-4
    assert np.isfinite(cloud).all()


def test_an_empty_table_is_flat():
    mapper, context = connected([])
    found = mapper.GetOutputPort("height_map").Eval(context)
    np.testing.assert_allclose(found.height, 0.0, atol=5e-4)


def test_bad_input():
    with pytest.raises(ValueError, match="at least one camera"):
        HeightMapper({}, MAPPED)
    with pytest.raises(ValueError, match="resolution > 0"):
        HeightMapper({"top": MODEL}, MAPPED, resolution=0.0)
    mapper = HeightMapper({"top": MODEL}, MAPPED)
    with pytest.raises(RuntimeError, match=r"'top.depth_image' is not connected"):
        mapper.GetOutputPort("height_map").Eval(mapper.CreateDefaultContext())
