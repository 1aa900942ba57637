import pytest
from pydrake import geometry

from drake_srg.common.shapes import drake_shape
from drake_srg.types import Box, Cylinder, Sphere


def test_a_cylinder_keeps_radius_and_length():
    shape = drake_shape(Cylinder(0.1, 0.3))
    assert isinstance(shape, geometry.Cylinder)
    assert (shape.radius(), shape.length()) == (0.1, 0.3)


def test_a_box_keeps_its_sides():
    shape = drake_shape(Box([0.1, 0.2, 0.3]))
    assert isinstance(shape, geometry.Box)
    assert (shape.width(), shape.depth(), shape.height()) == (0.1, 0.2, 0.3)


def test_a_ball_keeps_its_radius():
    shape = drake_shape(Sphere(0.1))
    assert isinstance(shape, geometry.Sphere)
    assert shape.radius() == pytest.approx(0.1)
