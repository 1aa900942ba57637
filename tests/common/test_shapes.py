import numpy as np
import pytest
from pydrake import geometry

from drake_srg.common.convex_pieces import ConvexPieces
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


def test_several_pieces_become_their_hull():
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    inside = 0.1 * corners + [0.1, 0.1, 0.1]
    hull = drake_shape(ConvexPieces((inside, corners))).GetConvexHull()
    found = [hull.vertex(i) for i in range(hull.num_vertices())]
    assert sorted(map(tuple, found)) == sorted(map(tuple, corners))
