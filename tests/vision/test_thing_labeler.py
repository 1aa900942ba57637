"""Labels of rendered scenes."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo, ImageRgba8U

from drake_srg.types import Blob, BlobFlag, Box, Cylinder
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.height_map import height_map, points_of
from drake_srg.vision.surfaces import Surface
from drake_srg.vision.thing_labeler import KnownThing, ThingLabeler
from vision.vision_scene import BLUE, RED, Camera, Thing, render, standing

TABLE = Surface((-0.3, -0.3), (0.3, 0.3), 0.0)
CAMERA = Camera()
MODEL = CameraModel(CameraInfo(CAMERA.width, CAMERA.height, CAMERA.fov_y))
BLOCK, CAN = Box([0.05, 0.05, 0.05]), Cylinder(0.03, 0.1)
WHITE = (0.95, 0.95, 0.95)


@pytest.fixture(scope="module")
def seen():
    """Return images and map of red and blue blocks that touch, and of a banded can."""
    things = [
        standing(BLOCK, 0.1, 0.0, color=RED),
        standing(BLOCK, 0.15, 0.0, color=BLUE),
        standing(CAN, -0.1, 0.1, color=BLUE),
        Thing(Cylinder(0.02, 0.002), (-0.1, 0.1, 0.101), color=WHITE),
        standing(BLOCK, -0.1, -0.15, color=WHITE),
    ]
    color, depth = render(things)[:2]
    imager = MODEL.imager("depth")
    points = points_of(depth, CAMERA.X_WB, imager, subpixels=2)
    return color, height_map([points], TABLE)


def labels(seen, names, known=None, blobs=(), *, upright=False):
    """Return the labelled map."""
    color, seen_map = seen
    labeler = ThingLabeler(names, {"top": MODEL}, known or {}, 0.0, upright=upright)
    context = labeler.CreateDefaultContext()

    def fix(name, value):
        if labeler.HasInputPort(name):
            labeler.GetInputPort(name).FixValue(context, value)

    image = ImageRgba8U(CAMERA.width, CAMERA.height)
    image.mutable_data[:] = color
    fix("height_map", AbstractValue.Make(seen_map))
    fix("top.color_image", image)
    fix("top.body_pose_in_world", CAMERA.X_WB)
    fix("blobs", AbstractValue.Make(list(blobs)))
    return labeler.get_output_port().Eval(context)


def share(found, label, x, y, radius=0.02):
    """Return the share of the cells around a place that have a label."""
    near = np.abs(found.centers() - [x, y]).max(axis=-1) < radius
    return np.mean(found.label[near] == label)


def test_colours_of_things_that_touch(seen):
    found = labels(seen, ["red", "blue", "green"])
    assert share(found, 0, 0.1, 0.0) > 0.95
    assert share(found, 1, 0.15, 0.0) > 0.95
    assert not np.any(found.label == 2)


def test_the_white_part_of_a_blue_can_is_blue(seen):
    found = labels(seen, ["white", "blue"])
    assert share(found, 1, -0.1, 0.1) > 0.95
    assert share(found, 0, -0.1, -0.15) > 0.95  # and a white block is white


def test_the_table_has_no_label(seen):
    found = labels(seen, ["red", "white", "all"])
    assert share(found, -1, 0.1, 0.15) == 1.0
    np.testing.assert_array_equal(found.height, seen[1].height)


def test_what_has_no_other_label_is_among_all(seen):
    found = labels(seen, ["red", "all"])
    assert share(found, 0, 0.1, 0.0) > 0.95
    assert share(found, 1, -0.1, 0.1) > 0.95


def blob(name, x, y, z, rotation=None, flags=()):
    X_WO = RigidTransform(rotation or RotationMatrix(), [x, y, z])
    return Blob(name, "top", (0.0, 0.0), X_WO, 1.0, frozenset(flags))


def test_names_come_from_poses(seen):
    known = {"can": KnownThing(CAN), "block": KnownThing(BLOCK, (0.0, 0.0, 0.025))}
    blobs = [blob("can", -0.1, 0.1, 0.05), blob("block", 0.1, 0.0, 0.0)]
    found = labels(seen, ["can", "block"], known, blobs)
    assert share(found, 0, -0.1, 0.1) > 0.9
    assert share(found, 1, 0.1, 0.0) > 0.9
    assert share(found, 1, 0.165, 0.0, 0.008) == 0.0  # its neighbour


UNSURE = blob("can", -0.1, 0.1, 0.05, flags=[BlobFlag.UNCERTAIN])


@pytest.mark.parametrize("blobs", [[], [UNSURE]])
def test_what_is_not_certain_has_no_name(seen, blobs):
    found = labels(seen, ["can"], {"can": KnownThing(CAN)}, blobs)
    assert np.all(found.label == -1)


@pytest.mark.parametrize(("roll", "stands"), [(0.0, True), (0.3, False), (3.1, False)])
def test_only_what_stands_has_a_name_if_asked_for(seen, roll, stands):
    turned = [blob("can", -0.1, 0.1, 0.05, RotationMatrix.MakeXRotation(roll))]
    known = {"can": KnownThing(CAN)}
    assert np.any(labels(seen, ["can"], known, turned).label == 0)
    found = labels(seen, ["can"], known, turned, upright=True)
    assert np.any(found.label == 0) == stands


def test_an_unknown_label_is_refused():
    with pytest.raises(ValueError, match="unknown label 'mauve'"):
        ThingLabeler(["mauve"], {"top": MODEL}, {}, 0.0)
    with pytest.raises(ValueError, match="needs a camera"):
        ThingLabeler(["red"], {}, {}, 0.0)
