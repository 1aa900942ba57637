import numpy as np
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.corners import body_corners
from drake_srg.objects.models import AddObject
from drake_srg.types import Cylinder


def test_the_corners_enclose_a_shape():
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    shape = Cylinder(0.03, 0.1)
    model = AddObject(plant, "thing", ObjectConfig(shape=shape, mass=1.0, friction=0.5))
    plant.Finalize()
    (index,) = plant.GetBodyIndices(model)
    corners = body_corners(plant, scene_graph.model_inspector(), plant.get_body(index))
    assert corners.shape == (8, 3)
    np.testing.assert_allclose(np.abs(corners), [[0.03, 0.03, 0.05]] * 8, atol=1e-9)
