import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, object_body
from drake_srg.objects.solids import body_corners, hull_points
from drake_srg.types import Box, Cylinder, Sphere


def make(**what):
    """Return the plant, the inspector and the body of an object."""
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    model = AddObject(plant, "thing", ObjectConfig(**what))
    plant.Finalize()
    body = plant.get_body(object_body(plant, model))
    return plant, scene_graph.model_inspector(), body


def solid(shape):
    return make(shape=shape, mass=1.0, friction=0.5)


def test_the_corners_enclose_a_shape():
    corners = body_corners(*solid(Cylinder(0.03, 0.1)))
    assert corners.shape == (8, 3)
    np.testing.assert_allclose(np.abs(corners), [[0.03, 0.03, 0.05]] * 8, atol=1e-9)


@pytest.mark.parametrize(
    "shape", [Box([0.1, 0.2, 0.3]), Cylinder(0.03, 0.1), Sphere(0.04)]
)
def test_hulls_reach_as_far_as_their_shape(shape):
    (points,) = hull_points(*solid(shape))
    rng = np.random.default_rng(0)
    for normal in rng.normal(size=(50, 3)):
        direction = normal / np.linalg.norm(normal)
        reach, most = (points @ direction).max(), shape.half_extent(direction)
        assert 0.985 * most <= reach <= most + 1e-9
    np.testing.assert_allclose(np.ptp(points, axis=0), shape.bounding_size)


def test_boxes_around_pieces_enclose_their_hulls():
    thing = make(model="package://drake_srg/sdf/mug.sdf")
    pieces, corners = hull_points(*thing), body_corners(*thing)
    assert len(corners) == 8 * len(pieces)
    for points, box in zip(pieces, corners.reshape(-1, 8, 3), strict=True):
        assert (points.min(axis=0) >= box.min(axis=0) - 1e-6).all()
        assert (points.max(axis=0) <= box.max(axis=0) + 1e-6).all()
