"""Objects in poor images: other lights, other paints, noise, occlusion."""

import numpy as np
import pytest
from pydrake.geometry import LightParameter, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageRgba8U

from drake_srg.types import BlobFlag, Box, Cylinder
from drake_srg.vision.blob_localizer import BlobLocalizer
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.camera_errors import CameraErrors, CameraErrorsConfig
from vision.test_cylinders import CEILING, CYLINDER, LAVENDER, TARGET, WOOD, on_table
from vision.vision_scene import (
    BLUE,
    CAN,
    RED,
    Camera,
    Thing,
    make_sensors,
    standing,
    target,
)

NOISY = CameraErrorsConfig(
    color_noise=3.0, blur=0.7, depth_noise=5e-4, depth_dropout=0.01
)
WARM, COLD = (1.0, 0.83, 0.66), (0.82, 0.9, 1.0)  # 3000 K and 8000 K


def lamp(color, intensity, direction=(0.2, -0.1, -1.0)):
    return LightParameter(
        type="directional",
        frame="world",
        direction=direction,
        intensity=intensity,
        color=Rgba(*color),
    )


def locate(things, wanted, camera, lights, errors=NOISY):
    """Return the blobs in the images of a camera with errors."""
    builder = DiagramBuilder()
    sensor = make_sensors(builder, things, {"eye": camera}, lights=lights)["eye"]
    model = CameraModel.from_sensor(sensor)
    spoiled = builder.AddSystem(
        CameraErrors(errors, focal=model.color.focal_x(), seed=0, name="eye")
    )
    localizer = builder.AddSystem(BlobLocalizer([wanted], {"eye": model}))
    for port, output in (
        ("color_image", sensor.color_image_output_port()),
        ("depth_image", sensor.depth_image_32F_output_port()),
        ("body_pose_in_world", sensor.body_pose_in_world_output_port()),
    ):
        builder.Connect(output, spoiled.GetInputPort(port))
        builder.Connect(
            spoiled.GetOutputPort(port), localizer.GetInputPort(f"eye.{port}")
        )
    context = builder.Build().CreateDefaultContext()
    return localizer.get_output_port().Eval(localizer.GetMyContextFromRoot(context))


def check(blob, thing, millimetres):
    off = np.linalg.norm(blob.position - np.array(thing.position))
    assert off < 1e-3 * millimetres
    assert BlobFlag.UNCERTAIN not in blob.flags
    assert blob.axis == pytest.approx([0, 0, 1], abs=1e-6)  # noise hides small leans


@pytest.mark.parametrize("light", [WARM, COLD], ids=["warm", "cold"])
@pytest.mark.parametrize("intensity", [0.5, 1.4])
def test_a_pale_cylinder_is_found_in_any_light(light, intensity):
    """Its range of colours is too narrow, but it stands out in depth."""
    x, y = -0.3, -0.2
    cylinder = Thing(CYLINDER, (x, y, 0.025), LAVENDER)
    disc = Thing(Cylinder(0.0125, 0.005), (x + 0.1, y, 0.0025), LAVENDER)
    lights = [lamp(light, intensity)]
    things = [cylinder, disc, on_table(WOOD)]
    [blob] = locate(things, TARGET, CEILING, lights)
    check(blob, cylinder, 0.7)  # half a pixel


@pytest.mark.parametrize("light", [WARM, COLD], ids=["warm", "cold"])
def test_a_can_is_distinguished_from_other_things_of_its_colour(light):
    can = standing(CAN, 0.1, 0.05)
    others = [
        standing(Box([0.045, 0.045, 0.1018]), -0.1, 0.0, color=RED),
        standing(Cylinder(0.02, 0.1), 0.0, 0.2, color=RED),
        standing(CAN, -0.1, 0.2, color=BLUE),
    ]
    blobs = locate([can, *others], target(), Camera(), [lamp(light, 0.8)])
    check(blobs[0], can, 1.0)
    assert all(BlobFlag.UNCERTAIN in blob.flags for blob in blobs[1:])


def hiding_a_third(can, side):
    """Return a card half way to the camera that hides a third of the can's width."""
    x, y, _ = can.position
    card = 0.5 * np.array([x, y]) + np.array(side) * (0.5 * CAN.radius / 3 + 0.05)
    return Thing(Box([0.1, 0.1, 0.001]), (*card, 0.8), BLUE)


@pytest.mark.parametrize("side", [(1, 0), (0, -1)], ids=["right", "below"])
def test_a_can_is_located_with_a_third_hidden(side):
    can = standing(CAN, 0.1, 0.05)
    things = [can, hiding_a_third(can, side)]
    [blob] = locate(things, target(), Camera(), [lamp(COLD, 0.9)])
    check(blob, can, 1.5)
    assert BlobFlag.OCCLUDED in blob.flags


def test_a_partly_hidden_can_is_trusted_over_a_carton_in_full_view():
    can = standing(CAN, 0.1, 0.05)
    carton = standing(Box([0.06, 0.06, CAN.height]), -0.1, 0.0, color=RED)
    things = [can, hiding_a_third(can, (1, 0)), carton]
    blobs = locate(things, target(), Camera(), [lamp(WARM, 0.9)])
    check(blobs[0], can, 1.5)
    # Only its shape speaks against the carton: all of its outline is seen.
    assert blobs[1].certain
    assert blobs[1].quality > blobs[0].quality
    assert blobs[1].misfit > blobs[0].misfit


@pytest.mark.parametrize("stops", [-0.7, 0.7])
def test_a_can_is_located_in_overexposed_and_underexposed_images(stops):
    can = standing(CAN, -0.1, 0.1)
    errors = CameraErrorsConfig(exposure=stops, color_noise=3.0, depth_noise=1e-3)
    [blob] = locate([can], target(), Camera(), [lamp(WARM, 0.9)], errors)
    check(blob, can, 1.0)


def test_a_lower_thing_is_not_taken_for_the_target():
    low = standing(Cylinder(CAN.radius, 0.06), 0.1, 0.05)
    assert locate([low], target(), Camera(), [lamp(COLD, 0.9)]) == []


def test_noise_alone_gives_no_certain_blobs():
    rng = np.random.default_rng(0)
    localizer = BlobLocalizer(
        [target()], {"eye": CameraModel(CameraInfo(160, 120, 1.0))}
    )
    context = localizer.CreateDefaultContext()
    color, depth = ImageRgba8U(160, 120), ImageDepth32F(160, 120)
    color.mutable_data[:] = rng.integers(0, 256, color.data.shape)
    depth.mutable_data[:] = rng.uniform(0.5, 2.0, depth.data.shape)
    X_WB = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 1.5])
    for port, value in (
        ("color_image", color),
        ("depth_image", depth),
        ("body_pose_in_world", X_WB),
    ):
        localizer.GetInputPort(f"eye.{port}").FixValue(context, value)
    blobs = localizer.get_output_port().Eval(context)
    assert all(BlobFlag.UNCERTAIN in blob.flags for blob in blobs)
