import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    ProximityProperties,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlantConfig,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.contacts import each_contact, relaxation_time
from drake_srg.objects.config import ObjectConfig, SoftConfig
from drake_srg.objects.models import AddObject, SetDefaultObjectPose
from drake_srg.types import Box as BoxShape
from drake_srg.types import Sphere

DEPTH = 2e-4  # m


@given(st.floats(0.0, 100.0), st.floats(-1.0, 1.0))
def test_both_models_press_alike_at_the_same_depth(dissipation, rate):
    hunt_crossley = DEPTH * (1.0 + dissipation * rate)
    kelvin_voigt = DEPTH + relaxation_time(dissipation) * rate
    assert kelvin_voigt == pytest.approx(hunt_crossley, abs=1e-15)


MASS, WEIGHT = 0.2, 0.2 * 9.81
RIGID = ObjectConfig(shape=Sphere(0.03), mass=MASS, friction=0.5, modulus=1e6)
SOFT = ObjectConfig(
    shape=BoxShape([0.04, 0.06, 0.06]),
    soft=SoftConfig(),
    mass=MASS,
    friction=0.5,
    resolution=0.03,
)


def contacts(config, contact_model):
    """Return the contacts of an object at rest, and the numbers of both geometries."""
    builder = DiagramBuilder()
    settings = MultibodyPlantConfig(
        time_step=0.005,
        contact_model=contact_model,
        discrete_contact_approximation="sap",
    )
    plant, _ = AddMultibodyPlant(settings, builder)
    ground = ProximityProperties()
    AddContactMaterial(properties=ground, friction=CoulombFriction(0.5, 0.5))
    AddRigidHydroelasticProperties(0.1, ground)
    below = plant.RegisterCollisionGeometry(
        plant.world_body(),
        RigidTransform([0.0, 0.0, -0.1]),
        Box(1.0, 1.0, 0.2),
        "ground",
        ground,
    )
    model = AddObject(plant, "thing", config)
    SetDefaultObjectPose(plant, model, RigidTransform([0.1, 0.2, 0.03]))
    plant.Finalize()
    if config.soft:
        deformables = plant.deformable_model()
        (body,) = deformables.GetBodyIds(model)
        above = deformables.GetGeometryId(body)
    else:
        (index,) = plant.GetBodyIndices(model)
        (above,) = plant.GetCollisionGeometriesForBody(plant.get_body(index))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.0)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    results = plant.get_contact_results_output_port().Eval(context)
    # Evaluated here, while the simulator is alive.
    found = [
        (contact, contact.p_WC(), contact.F_Ac_W().translational())
        for contact in each_contact(results)
    ]
    return found, below.get_value(), above.get_value()


@pytest.mark.parametrize(
    ("config", "contact_model"),
    [(RIGID, "point"), (RIGID, "hydroelastic"), (SOFT, "hydroelastic_with_fallback")],
    ids=["point", "hydroelastic", "soft"],
)
def test_contacts_carry_the_weight_of_an_object_at_rest(config, contact_model):
    found, below, above = contacts(config, contact_model)
    assert found
    force = np.zeros(3)
    for contact, p_WC, f_Ac_W in found:
        assert {contact.id_A, contact.id_B} == {below, above}
        force += f_Ac_W if contact.id_A == above else -f_Ac_W
        assert p_WC == pytest.approx([0.1, 0.2, 0.0], abs=2e-3)
    assert force == pytest.approx([0.0, 0.0, WEIGHT], abs=0.01 * WEIGHT)


def test_an_object_in_the_air_has_no_contacts():
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.005), builder)
    AddObject(plant, "thing", RIGID)
    plant.Finalize()
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    results = plant.get_contact_results_output_port().Eval(context)
    assert list(each_contact(results)) == []
