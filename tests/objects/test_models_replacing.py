import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, SetObject, object_body
from drake_srg.types import Box, Cylinder, Sphere

CAN = "package://drake_srg/sdf/005_tomato_soup_can.sdf"


class Scene:
    def __init__(self, config):
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
        model = AddObject(self.plant, "thing", config)
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.body = object_body(self.plant, model)

    def replace(self, config):
        SetObject(self.plant, self.scene_graph, self.context, self.body, config)

    def described(self):
        """Inertia, shapes and contact properties in the context."""
        body = self.plant.get_body(self.body)
        context = self.plant.GetMyContextFromRoot(self.context)
        inertia = body.CalcSpatialInertiaInBodyFrame(context).CopyToFullMatrix6()
        graph = self.scene_graph.GetMyContextFromRoot(self.context)
        inspector = self.scene_graph.get_query_output_port().Eval(graph).inspector()
        (touched,) = self.plant.GetCollisionGeometriesForBody(body)
        seen = self.plant.GetVisualGeometriesForBody(body)
        properties = inspector.GetProximityProperties(touched)
        friction = properties.GetProperty("material", "coulomb_friction")
        hint = properties.GetPropertyOrDefault("hydroelastic", "resolution_hint", 0.0)
        return (
            inertia.tolist(),
            (friction.static_friction(), friction.dynamic_friction()),
            hint,
            [repr(inspector.GetShape(g)) for g in (touched, *seen)],
        )


SHAPES = [
    ObjectConfig(shape=Box([0.03, 0.05, 0.1]), mass=0.2, friction=0.7),
    ObjectConfig(shape=Cylinder(0.02, 0.1), mass=0.3, friction=0.4),
    ObjectConfig(shape=Sphere(0.03), mass=0.1, friction=0.9, resolution=0.01),
]


@pytest.mark.parametrize("old", SHAPES)
@pytest.mark.parametrize("new", SHAPES)
def test_a_replaced_object_is_like_one_that_was_built_so(old, new):
    scene = Scene(old)
    scene.replace(new)
    assert scene.described() == Scene(new).described()


def test_a_model_takes_mass_and_friction():
    scene = Scene(ObjectConfig(model=CAN))
    before = scene.described()
    scene.replace(ObjectConfig(model=CAN, mass=0.7, friction=0.33))
    after = scene.described()
    assert after[1] == (0.33, 0.33)
    assert after[2:] == before[2:]
    scaled = np.array(before[0]) * 0.7 / before[0][5][5]
    assert np.allclose(after[0], scaled)
