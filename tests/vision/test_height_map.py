import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo, ImageDepth32F

from drake_srg.types import Box
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.height_map import HeightMapper, height_map, points_of
from drake_srg.vision.surfaces import Surface
from vision.vision_scene import CAN, Camera, render, standing

TABLE = Surface((-0.2, -0.15), (0.2, 0.15), 0.7)
DOWN = RotationMatrix(np.diag([1.0, -1.0, -1.0]))


def cloud(*boxes, spacing=0.001):
    """Return points of the table and the tops of boxes (x0, x1, y0, y1, height)."""
    x, y = np.meshgrid(
        np.arange(-0.25, 0.25, spacing), np.arange(-0.2, 0.2, spacing), indexing="ij"
    )
    z = np.full(x.shape, TABLE.height)
    for x0, x1, y0, y1, height in boxes:
        z[(x >= x0) & (x < x1) & (y >= y0) & (y < y1)] += height
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


BOX = (-0.03, 0.05, 0.02, 0.06, 0.08)


def test_a_box_and_the_table():
    found = height_map([cloud(BOX)], TABLE)
    middles, above = found.centers(), found.height - TABLE.height
    inside = (middles[..., 0] > -0.028) & (middles[..., 0] < 0.048)
    inside &= (middles[..., 1] > 0.022) & (middles[..., 1] < 0.058)
    np.testing.assert_allclose(above[inside], 0.08)
    outside = (middles[..., 0] < -0.032) | (middles[..., 0] > 0.052)
    np.testing.assert_allclose(above[outside], 0.0, atol=1e-9)


def test_what_no_camera_sees_is_unknown_but_for_narrow_holes():
    points = cloud(BOX)
    wide = (points[:, 0] > 0.1) & (points[:, 0] < 0.13)
    narrow = np.abs(points[:, 0] + 0.1005) < 0.0012
    found = height_map([points[~wide & ~narrow]], TABLE)
    x = found.centers()[..., 0]
    assert np.isnan(found.height[(x > 0.105) & (x < 0.125)]).all()
    assert np.isfinite(found.height[x < 0.09]).all()


def test_an_ignored_part_is_unknown_and_what_leans_on_it_is_not():
    part = Surface((-0.03, 0.02), (0.01, 0.06), TABLE.height)
    low = (0.01, 0.05, 0.02, 0.06, 0.08)
    tall = (-0.03, 0.01, 0.02, 0.06, 0.5)
    found = height_map([cloud(low, tall)], TABLE, ignored=[part])
    middles = found.centers()
    inside = part.contains(middles.reshape(-1, 2)).reshape(found.height.shape)
    np.testing.assert_array_equal(np.isnan(found.height), inside)
    beside = (middles[..., 0] > 0.012) & (middles[..., 0] < 0.048)
    beside &= (middles[..., 1] > 0.022) & (middles[..., 1] < 0.058)
    np.testing.assert_allclose(found.height[beside] - TABLE.height, 0.08)


def test_another_camera_fills_a_shadow():
    points = cloud(BOX)
    left, right = points[points[:, 0] < 0.1], points[points[:, 0] > 0.0]
    found = height_map([left, right], TABLE)
    assert np.isfinite(found.height).all()


@pytest.mark.parametrize(
    "robot",
    [(-0.03, 0.05, 0.02, 0.06, 0.5), (0.1, 0.25, 0.0, 0.05, 0.1)],
    ids=["too high", "over the edge"],
)
def test_the_robot_is_unknown(robot):
    found = height_map([cloud(robot)], TABLE)
    middles = found.centers()
    inside = (middles[..., 0] > robot[0]) & (middles[..., 0] < robot[1])
    inside &= (middles[..., 1] > robot[2]) & (middles[..., 1] < robot[3])
    assert np.isnan(found.height[inside]).all()
    rest = found.height[np.isfinite(found.height)]
    np.testing.assert_allclose(rest, TABLE.height, atol=1e-9)


@settings(max_examples=15, deadline=None)
@given(offset=st.floats(-0.004, 0.004), seed=st.integers(0, 99))
def test_a_camera_that_is_believed_too_high_or_low_sees_the_table_where_it_is(
    offset, seed
):
    points = cloud(BOX)
    noise = np.random.default_rng(seed).normal(0.0, 5e-4, len(points))
    points[:, 2] += offset + noise
    found = height_map([points], TABLE)
    flat = found.height[np.abs(found.height - TABLE.height) < 0.01]
    assert abs(np.median(flat) - TABLE.height) < 1e-4


def test_points_of_a_depth_image():
    info = CameraInfo(64, 48, np.deg2rad(30.0))
    imager = CameraModel(info).imager("depth")
    depth = np.full((48, 64), 0.8, np.float32)
    depth[10, 10], depth[11, 11] = 0.0, np.inf
    X_WB = RigidTransform(DOWN, [0.1, 0.2, 1.5])
    points = points_of(depth, X_WB, imager)
    assert len(points) == 48 * 64 - 2
    np.testing.assert_allclose(points[:, 2], 0.7, atol=1e-6)
    # Drake's pixels are centred half a pixel off the middle of the image.
    pixel = 0.8 / info.focal_x()
    np.testing.assert_allclose(points.mean(axis=0)[:2], [0.1, 0.2], atol=0.6 * pixel)
    finer = points_of(depth, X_WB, imager, subpixels=3)
    assert len(finer) == 9 * len(points)
    np.testing.assert_allclose(finer.mean(axis=0), points.mean(axis=0), atol=1e-6)


@given(st.floats(-0.15, 0.15), st.floats(0.0, 0.5))
def test_points_far_from_the_table_do_not_change_its_map(x, lean):
    info = CameraInfo(64, 48, np.deg2rad(30.0))
    imager = CameraModel(info).imager("depth")
    v, u = np.mgrid[:48, :64]
    depth = (0.7 + 0.002 * u + 0.003 * (v > 20)).astype(np.float32)
    X_WB = RigidTransform(DOWN @ RotationMatrix.MakeXRotation(lean), [x, 0.1, 1.5])
    every, near = (
        points_of(depth, X_WB, imager, subpixels=2, within=surface)
        for surface in (None, TABLE)
    )
    assert len(near) < len(every)
    maps = [height_map([cloud], TABLE).height for cloud in (every, near)]
    np.testing.assert_array_equal(*maps)


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
    middles = found.centers()
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
    mapper = HeightMapper({"top": MODEL}, MAPPED)
    with pytest.raises(RuntimeError, match=r"'top.depth_image' is not connected"):
        mapper.GetOutputPort("height_map").Eval(mapper.CreateDefaultContext())
