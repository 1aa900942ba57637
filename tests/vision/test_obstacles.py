import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo, ImageDepth32F

from drake_srg.types import Blob, BlobFlag, Box, Cylinder, Sphere
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.obstacles import ObstacleFinder
from drake_srg.vision.surfaces import Surface
from vision.vision_scene import CAN, DOWN, Camera, Thing, render, standing

TABLE = Surface((-0.5, -0.4), (0.5, 0.4), 0.0)
CAMERA = Camera()
MODEL = CameraModel(CameraInfo(CAMERA.width, CAMERA.height, CAMERA.fov_y))
PIXEL = 1.5 / MODEL.color.focal_x()  # m, on the table
BOX = Box([0.06, 0.09, 0.05])
# 25 degrees off the vertical, above the table's edge.
SLANTED = Camera(
    RigidTransform(
        RotationMatrix.MakeXRotation(np.deg2rad(25)) @ DOWN, [0.0, -0.7, 1.5]
    )
)


def find(things, *, blobs=None, known=None, cameras=None, change=None, **options):
    """Return the obstacles among things on the table; `change` may spoil the depth."""
    cameras = cameras or {"top": CAMERA}
    finder = ObstacleFinder(
        dict.fromkeys(cameras, MODEL), [TABLE], known or {}, **options
    )
    context = finder.CreateDefaultContext()
    for name, camera in cameras.items():
        depth = render(things, camera)[1]
        image = ImageDepth32F(camera.width, camera.height)
        image.mutable_data[..., 0] = change(depth) if change else depth
        finder.GetInputPort(f"{name}.depth_image").FixValue(context, image)
        finder.GetInputPort(f"{name}.body_pose_in_world").FixValue(context, camera.X_WB)
    if blobs is not None:
        finder.GetInputPort("blobs").FixValue(context, blobs)
    return finder.get_output_port().Eval(context)


def blob_of(thing, name="can"):
    X_WO = RigidTransform(thing.rotation, thing.position)
    return Blob(name, "top", (0.0, 0.0), X_WO, 1.0)


def corners(thing):
    """Return the corners of a box on the table, seen from above, shape (4, 2)."""
    half = 0.5 * np.array(thing.shape.size[:2])
    square = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * half
    R = RotationMatrix(thing.rotation).matrix()[:2, :2]
    return square @ R.T + np.array(thing.position)[:2]


def test_an_empty_table_has_no_obstacles():
    assert find([]) == []


@pytest.mark.parametrize("camera", [CAMERA, SLANTED], ids=["above", "slanted"])
@pytest.mark.parametrize("yaw", [0.0, 0.5, 2.0])
def test_a_box_is_covered_within_two_pixels(yaw, camera):
    thing = standing(BOX, 0.1, 0.05, rotation=RotationMatrix.MakeZRotation(yaw))
    [obstacle] = find([thing], cameras={"top": camera})
    p_O = obstacle.X_WO.inverse().multiply(np.c_[corners(thing), np.zeros(4)].T).T
    beyond = np.abs(p_O[:, :2]) - 0.5 * np.array(obstacle.shape.size[:2])
    assert beyond.max() < 0.5 * PIXEL
    assert sorted(obstacle.shape.size[:2]) == pytest.approx([0.06, 0.09], abs=2 * PIXEL)
    assert obstacle.shape.height == pytest.approx(0.05, abs=5e-4)
    bottom = obstacle.X_WO.translation()[2] - 0.5 * obstacle.shape.height
    assert bottom == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("shape", [CAN, Sphere(0.04), Cylinder(0.008, 0.02)])
def test_any_shape_is_found(shape):
    thing = standing(shape, -0.2, 0.1)
    [obstacle] = find([thing])
    assert obstacle.shape.height == pytest.approx(shape.height, abs=1e-3)
    off = obstacle.X_WO.translation()[:2] - thing.position[:2]
    assert np.linalg.norm(off) < PIXEL
    assert obstacle.shape.size[:2] == pytest.approx([2 * shape.radius] * 2, abs=0.004)


def test_neighbours_are_separate_and_two_cameras_see_each_thing_once():
    things = [standing(BOX, x, 0.0) for x in (-0.1, 0.0, 0.1)]
    cameras = {"top": CAMERA, "slanted": SLANTED}
    found = find(things, cameras=cameras)
    x = sorted(obstacle.X_WO.translation()[0] for obstacle in found)
    assert x == pytest.approx([-0.1, 0.0, 0.1], abs=PIXEL)


def test_known_objects_and_markers_are_left_out():
    can, box = standing(CAN, 0.1, 0.1), standing(BOX, -0.1, 0.0)
    marker = standing(Cylinder(0.05, 0.001), 0.2, -0.2)
    found = find([can, box, marker], blobs=[blob_of(can)], known={"can": CAN})
    assert [o.shape.height for o in found] == pytest.approx([0.05], abs=1e-3)
    # A blob does not show a box's yaw.
    turned = dc.replace(box, rotation=RotationMatrix.MakeZRotation(1.0))
    blobs = [blob_of(turned, "box")]
    assert find([turned, marker], blobs=blobs, known={"box": BOX}) == []


@pytest.mark.parametrize(
    "doubt",
    [{"flags": frozenset({BlobFlag.UNCERTAIN})}, {"misfit": 0.05}, {"quality": 0.9}],
)
def test_only_the_most_trustworthy_blob_counts(doubt):
    can, other = standing(CAN, 0.1, 0.1), standing(CAN, -0.1, 0.0)
    blobs = [dc.replace(blob_of(other), **doubt), blob_of(can)]
    [obstacle] = find([can, other], blobs=blobs, known={"can": CAN})
    assert obstacle.X_WO.translation()[0] == pytest.approx(-0.1, abs=PIXEL)


def test_things_that_do_not_stand_on_the_surface_are_left_out():
    arm = Thing(Box([0.05, 0.5, 0.05]), (0.0, 0.4, 0.2))  # reaches over the edge
    hand = Thing(Box([0.1, 0.1, 0.5]), (0.2, -0.1, 0.4))  # comes from above
    beside = standing(BOX, 0.6, 0.0)
    card = Thing(Box([0.1, 0.1, 0.001]), (-0.2, -0.1, 0.9))
    assert find([arm, hand, beside, card]) == []


@pytest.mark.parametrize("noise", [0.5e-3, 3e-3])
def test_noise_and_holes_neither_make_obstacles_nor_hide_them(noise):
    rng = np.random.default_rng(0)

    def change(depth):
        depth = depth + rng.normal(0.0, noise, depth.shape)
        return np.where(rng.random(depth.shape) < 0.03, 0.0, depth)

    things = [standing(BOX, 0.1, 0.05), standing(CAN, -0.1, 0.05)]
    found = find(things, change=change)
    assert len(found) == 2
    heights = sorted(obstacle.shape.height for obstacle in found)
    assert heights == pytest.approx([0.05, CAN.height], abs=3 * noise)
    assert find([], change=change) == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cameras": {}}, "at least one camera"),
        ({"surfaces": []}, "one surface"),
    ],
)
def test_bad_arguments_are_named(options, message):
    arguments = {"cameras": {"top": MODEL}, "surfaces": [TABLE], "known": {}}
    with pytest.raises(ValueError, match=message):
        ObstacleFinder(**arguments | options)
