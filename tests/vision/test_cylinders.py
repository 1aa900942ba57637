"""A small cylinder in the arm thesis's colour, on tables and in a gripper."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import BlobFlag, Box, Cylinder
from drake_srg.vision.blob_localizer import BlobTarget
from drake_srg.vision.color import ColorRange
from vision.vision_scene import TENT, Camera, Thing, directional, locate

CYLINDER = Cylinder(0.0125, 0.05)
LAVENDER = (0.85, 0.85, 1.0)
STRICT = ColorRange((0.8, 0.8, 0.95), (0.9, 0.9, 1.0), "rgb")
TARGET = BlobTarget("cylinder", CYLINDER, STRICT)
WOOD, WHITE, CREAM, BLACK = (
    (0.75, 0.6, 0.45),
    (0.95, 0.95, 0.95),
    (0.95, 0.9, 0.8),
    (0.1, 0.1, 0.1),
)
# A pixel is 1.4 mm wide where the cylinder is.
DOWN = RotationMatrix(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]))
CEILING = Camera(RigidTransform(DOWN, [-0.17, -0.015, 0.9]), fov_y=np.deg2rad(44.0))
PLACES = [(-0.4, -0.25), (-0.25, -0.1), (-0.17, -0.015), (0.07, 0.2)]


def at(x, y, tilt=0.0, azimuth=0.0):
    """Return a cylinder on the table, tilted from upright [rad]."""
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    axis = np.sin(tilt) * level + [0.0, 0.0, np.cos(tilt)]
    z = 0.5 * CYLINDER.length * np.cos(tilt) + CYLINDER.radius * np.sin(tilt)
    R = RotationMatrix.MakeFromOneVector(axis, 2)
    return Thing(CYLINDER, (x, y, z), LAVENDER, R)


def see(cylinder, *others):
    """Return the only blob of a cylinder in the light tent."""
    [blob] = locate([cylinder, *others], [TARGET], {"ceiling": CEILING}, lights=TENT)
    return blob


def check(blob, cylinder, millimetres, degrees=0.2):
    np.testing.assert_allclose(
        blob.position, cylinder.position, atol=1e-3 * millimetres
    )
    axis = cylinder.rotation.matrix()[:, 2]
    turn = np.linalg.norm(np.cross(blob.axis, axis))
    assert turn < np.sin(np.deg2rad(degrees))
    assert blob.axis[2] >= 0.0
    assert BlobFlag.UNCERTAIN not in blob.flags


def on_table(color, height=0.001):
    return Thing(Box([3.0, 3.0, height]), (0.0, 0.0, -0.5 * height + 1e-5), color)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "color"), list(zip(PLACES, (WOOD, WHITE, CREAM, WOOD), strict=True))
)
def test_a_standing_cylinder_is_located_within_a_tenth_of_a_millimetre(place, color):
    cylinder = at(*place)
    blob = see(cylinder, on_table(color))
    check(blob, cylinder, 0.1)
    assert blob.quality > 0.9
    assert blob.flags == frozenset()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "azimuth"), list(zip(PLACES, (0.0, 0.02, 1.2, 0.0), strict=True))
)
def test_a_lying_cylinder_is_located_within_half_a_pixel(place, azimuth):
    cylinder = at(*place, np.pi / 2, azimuth)
    check(see(cylinder, on_table(CREAM)), cylinder, 0.75)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tilt", "azimuth"),
    [(10, 0.3), (30, 2.5), (40, -1.8), (50, 0.3), (60, 2.5), (80, -1.8)],
)
def test_a_cylinder_is_located_at_any_tilt(tilt, azimuth):
    cylinder = at(-0.3, -0.2, np.deg2rad(tilt), azimuth)
    check(see(cylinder, on_table(WHITE)), cylinder, 0.5)


def test_a_cylinder_that_leans_on_a_wall_is_located():
    tilt = np.deg2rad(35.0)
    cylinder = at(-0.3, -0.2, tilt)
    touched = -0.3 + 0.025 * np.sin(tilt) + 0.0125 * np.cos(tilt)
    wall = Thing(Box([0.02, 0.08, 0.05]), (touched + 0.01, -0.2, 0.025), BLACK)
    check(see(cylinder, wall), cylinder, 0.3)


def test_a_cylinder_in_a_recess_is_located():
    x, y = 0.0, 0.145
    cylinder = at(x + 5e-4, y - 3e-4)
    # Twenty-four bars around it, 5 mm high, leave a hole with a radius of 13.5 mm.
    ring = []
    for angle in 2 * np.pi * np.arange(24) / 24:
        R = RotationMatrix.MakeZRotation(angle)
        p = np.array([x, y, 0.0025]) + R @ np.array([0.0535, 0.0, 0.0])
        ring.append(Thing(Box([0.08, 0.02, 0.005]), tuple(p), WOOD, R))
    blob = see(cylinder, *ring)
    check(blob, cylinder, 0.1)
    assert blob.flags <= {BlobFlag.OCCLUDED}  # the lowest 5 mm


@pytest.mark.parametrize("azimuth", [0.0, 0.7, 2.0])
def test_a_cylinder_between_fingertips_is_located(azimuth):
    cylinder = at(-0.25, -0.1)
    R = RotationMatrix.MakeZRotation(azimuth)

    def part(size, *p):
        return Thing(Box(size), tuple(R @ np.array(p) + cylinder.position), BLACK, R)

    hand = [part([0.04, 0.07, 0.028], -0.085, 0.0, 0.0)]
    for side in (1, -1):
        hand.append(part([0.02, 0.01, 0.028], 0.0, side * 0.0175, 0.0))
        hand.append(part([0.06, 0.008, 0.014], -0.035, side * 0.022, 0.0))
    check(see(cylinder, *hand), cylinder, 0.1)


def test_a_part_in_the_right_colour_is_enough():
    """Under one lamp, only the top of a lying cylinder is bright enough."""
    cylinder = at(-0.3, -0.2, np.pi / 2, 0.8)
    lamp = directional([0.0, 0.0, -1.0], 1.0)
    [blob] = locate([cylinder], [TARGET], {"ceiling": CEILING}, lights=[lamp])
    check(blob, cylinder, 0.75)
    assert blob.quality > 0.8
