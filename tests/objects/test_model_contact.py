"""Contact of objects made of a shape."""

import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, SetDefaultObjectPose
from drake_srg.parsing import configure_parser
from drake_srg.types import Box, Cylinder


@pytest.mark.parametrize("excess", [-1e-4, -3.3e-5, -1e-6, 0.0, 1e-9, 2e-5, 1e-4])
def test_a_cylinder_as_long_as_it_is_wide_can_be_touched(excess):
    shape = Cylinder(0.0183, 0.0366 + excess)
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.0, contact_model="hydroelastic")
    plant, _ = AddMultibodyPlant(config, builder)
    for name in ("below", "above"):
        thing = ObjectConfig(shape=shape, mass=0.1, friction=0.5, modulus=1e7)
        model = AddObject(plant, name, thing)
        height = 0.0 if name == "below" else shape.length - 1e-4
        SetDefaultObjectPose(plant, model, RigidTransform([0.002, 0.0, height]))
    plant.Finalize()
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    contacts = plant.get_contact_results_output_port().Eval(context)
    assert contacts.num_hydroelastic_contacts() == 1


def impact(approximation):
    """Return the largest force [N] of a box of rubber that lands on a floor."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=1e-4,
            contact_model="hydroelastic",
            discrete_contact_approximation=approximation,
        ),
        builder,
    )
    parser = Parser(plant)
    configure_parser(parser)
    parser.AddModelsFromUrl("package://drake_srg/sdf/floor.sdf")
    box = ObjectConfig(
        shape=Box([0.04, 0.05, 0.06]), mass=0.25, friction=0.7, modulus=2e6
    )
    (body,) = map(plant.get_body, plant.GetBodyIndices(AddObject(plant, "box", box)))
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetFreeBodyPose(context, body, RigidTransform([0.0, 0.0, -0.7199]))
    plant.SetVelocities(context, [0.0, 0.0, 0.0, 0.0, 0.0, -0.3])  # 0.3 m/s down
    forces = []
    for step in range(200):
        simulator.AdvanceTo(1e-4 * step)
        results = plant.get_contact_results_output_port().Eval(context)
        for i in range(results.num_hydroelastic_contacts()):
            force = results.hydroelastic_contact_info(i).F_Ac_W()
            forces.append(abs(force.translational()[2]))
    return max(forces)


def test_contact_is_damped_alike_in_each_approximation():
    sap, lagged = impact("sap"), impact("lagged")
    assert lagged / 2.0 < sap < 2.0 * lagged
