import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageRgba8U
from vision.vision_scene import DOWN

from drake_srg.theses.blob_localizer import (
    ThesisBlobLocalizer,
    blob_position,
    first_blob,
)
from drake_srg.vision.camera import CameraModel

WIDTH, HEIGHT = 64, 48
INFO = CameraInfo(WIDTH, HEIGHT, np.deg2rad(44.0))
TARGET = (217, 217, 255)  # 0.85, 0.85, 1.0
X_WB = RigidTransform(DOWN, [0.1, 0.2, 1.0])


def picture(*blobs, color=TARGET):
    """Return an image, and its depth: blobs of (row, column, side), 0.85 m away."""
    image = np.full((HEIGHT, WIDTH, 4), 60, dtype=np.uint8)
    depth = np.full((HEIGHT, WIDTH), 0.9, dtype=np.float32)
    for row, column, side in blobs:
        image[row : row + side, column : column + side, :3] = color
        depth[row : row + side, column : column + side] = 0.85
    return image, depth


@pytest.mark.parametrize(
    ("color", "seen"),
    [
        (TARGET, True),
        ((204, 204, 243), True),  # 0.8, 0.8, 0.95: the end of the tolerance
        ((202, 217, 255), False),
        ((217, 231, 255), False),
    ],
)
def test_every_channel_must_be_within_the_tolerance(color, seen):
    image, _ = picture((10, 10, 5), color=color)
    assert (first_blob(image) is not None) == seen


def test_the_first_blob_is_the_lowest():
    image, _ = picture((5, 5, 10), (30, 40, 4))
    assert first_blob(image) == pytest.approx((42 / 64, 16 / 48))


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.2, 3.0))
def test_the_formulas_are_those_of_a_pinhole_camera(x, y, distance):
    depth = np.full((HEIGHT, WIDTH), distance, dtype=np.float32)
    p = blob_position((x, y), depth, INFO, 0.0)
    assert p[2] == pytest.approx(distance, rel=1e-6)
    pixel = np.array([INFO.focal_x(), INFO.focal_y()]) * p[:2] / p[2]
    # The thesis counts from the middle of the image, wherever the optical axis is.
    assert pixel == pytest.approx([(x - 0.5) * WIDTH, (0.5 - y) * HEIGHT], abs=1e-6)


@pytest.mark.parametrize(("size", "larger"), [((64, 48), 0), ((48, 64), 1)])
def test_the_larger_side_has_the_cameras_angle(size, larger):
    info = CameraInfo(*size, np.deg2rad(44.0))
    depth = np.ones(size[::-1], dtype=np.float32)
    p = blob_position((1.0, 0.0), depth, info, 0.0)
    focal = (info.focal_x(), info.focal_y())[larger]
    assert abs(p[larger]) == pytest.approx(0.5 * size[larger] / focal)
    assert p[0] / p[1] == pytest.approx(size[0] / size[1])


def test_the_depth_is_that_of_one_pixel_plus_the_offset():
    # floor(5.5 / 64 (64 - 0.99)) = 5; in the far half, the rule is a pixel short.
    for row, column, used in ((5, 5, (5, 5)), (40, 60, (39, 59))):
        _, depth = picture((HEIGHT - 1 - used[0], used[1], 1))
        center = np.array([(column + 0.5) / WIDTH, (row + 0.5) / HEIGHT])
        assert blob_position(center, depth, INFO, 0.01)[2] == pytest.approx(0.86)
        beside = (center[0] + 1.0 / WIDTH, center[1])
        assert blob_position(beside, depth, INFO, 0.01)[2] == pytest.approx(0.91)


@pytest.mark.parametrize("center", [(0.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
def test_the_corners_have_a_depth(center):
    _, depth = picture()
    assert blob_position(center, depth, INFO, 0.0)[2] == pytest.approx(0.9)


def simulate(image, depth):
    """Return a function that advances a localizer and returns its blobs."""
    builder = DiagramBuilder()
    localizer = builder.AddSystem(
        ThesisBlobLocalizer("cylinder", "top", CameraModel(INFO))
    )
    simulator = Simulator(builder.Build())
    context = localizer.GetMyContextFromRoot(simulator.get_mutable_context())
    color_image, depth_image = ImageRgba8U(WIDTH, HEIGHT), ImageDepth32F(WIDTH, HEIGHT)

    def show(image, depth):
        color_image.mutable_data[:] = image
        depth_image.mutable_data[..., 0] = depth
        for name, value in (
            ("color_image", color_image),
            ("depth_image", depth_image),
            ("body_pose_in_world", X_WB),
        ):
            localizer.GetInputPort(f"top.{name}").FixValue(context, value)

    def advance(time, *new):
        if new:
            show(*new)
        simulator.AdvanceTo(time)
        return localizer.GetOutputPort("blobs").Eval(context)

    show(image, depth)
    return advance


def test_it_waits_for_the_colour_and_then_reports_it_once():
    advance = simulate(*picture())
    assert advance(0.12) == []
    (first,) = advance(0.3, *picture((20, 30, 4)))
    assert (first.object_name, first.camera) == ("cylinder", "top")
    assert first.pixel == pytest.approx((31.5, 21.5))
    (again,) = advance(0.6, *picture((5, 5, 4)))
    assert np.array_equal(again.position, first.position)


def test_the_position_is_in_the_world():
    # The middle of the image, from 1 m above (0.1, 0.2).
    (blob,) = simulate(*picture((22, 30, 4)))(0.1)
    assert blob.position == pytest.approx([0.1, 0.2, 1.0 - 0.85 - 0.01], abs=1e-6)
    assert blob.axis.tolist() == [0.0, 0.0, 1.0]
