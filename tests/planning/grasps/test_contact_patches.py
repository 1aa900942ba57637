import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    Box,
    ProximityProperties,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from drake_srg.planning.grasps.contact_patches import contact_patches, merged


def pressed(model, depth=0.002, frictions=(0.4, 1.2)):
    """Contacts of a box (the hand) that dips into the top of another (the thing)."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=0.001,
            contact_model=model,
            # Contacts of the pose that is set, not of the last step.
            use_sampled_output_ports=False,
        ),
        builder,
    )
    ids = []
    for name, size, friction in zip(
        ("thing", "hand"), (0.1, 0.04), frictions, strict=True
    ):
        # So heavy that the step in which Drake finds the forces moves nothing.
        heavy = SpatialInertia.SolidBoxWithMass(1e3, 1.0, 1.0, 1.0)
        body = plant.AddRigidBody(name, heavy)
        properties = ProximityProperties()
        AddContactMaterial(
            dissipation=0.0,
            friction=CoulombFriction(friction, friction),
            properties=properties,
        )
        AddCompliantHydroelasticProperties(0.02, 1e6, properties)
        ids.append(
            plant.RegisterCollisionGeometry(
                body, RigidTransform(), Box(size, size, 0.04), name, properties
            )
        )
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own = plant.GetMyMutableContextFromRoot(context)
    thing, hand = (plant.GetBodyByName(n) for n in ("thing", "hand"))
    plant.SetFreeBodyPose(own, thing, RigidTransform())
    plant.SetFreeBodyPose(own, hand, RigidTransform([0.01, 0.0, 0.04 - depth]))
    results = plant.get_contact_results_output_port().Eval(own)
    return results, scene_graph.model_inspector(), {ids[0]}, {ids[1]}


@pytest.mark.parametrize("model", ["hydroelastic", "point"])
def test_a_hand_on_top_presses_down(model):
    results, inspector, thing, hand = pressed(model)
    (patch,) = contact_patches(results, inspector, thing=thing, hand=hand)
    # Beyond the edge, the field of the larger box bends them a little.
    np.testing.assert_allclose(patch.n_W[:, 2], -1.0, atol=0.01)
    assert patch.f_W[2] < 0.0
    # Of two frictions a and b, Drake uses 2 a b / (a + b).
    assert patch.friction == pytest.approx(0.6)
    np.testing.assert_allclose(patch.normal_force.sum(), -patch.f_W[2], rtol=0.05)


def test_the_point_of_a_patch_is_its_middle_and_five_spread_over_it():
    results, inspector, thing, hand = pressed("hydroelastic")
    (whole,) = contact_patches(results, inspector, thing=thing, hand=hand, points=1)
    (parts,) = contact_patches(results, inspector, thing=thing, hand=hand)
    np.testing.assert_allclose(whole.p_W[0, :2], [0.01, 0.0], atol=1e-3)
    assert len(whole.p_W) == 1 < len(parts.p_W) <= 5
    np.testing.assert_allclose(parts.centroid.p_W, whole.p_W, atol=1e-9)


def test_others_do_not_count():
    results, inspector, thing, hand = pressed("hydroelastic")
    assert contact_patches(results, inspector, thing=thing, hand=set()) == []
    assert contact_patches(results, inspector, thing=set(), hand=hand) == []


@given(st.integers(1, 40), st.integers(0, 1000), st.sampled_from([1, 5]))
def test_merging_keeps_force_and_moment(count, seed, points):
    rng = np.random.default_rng(seed)
    p = rng.uniform(-0.02, 0.02, (count, 3)) * [1.0, 1.0, 0.0]
    n = np.tile([0.0, 0.0, 1.0], (count, 1))
    force = rng.uniform(0.1, 1.0, count)
    where, normal, parts = merged(p, n, force, points)
    assert len(where) <= points
    assert parts.sum() == pytest.approx(force.sum())
    np.testing.assert_allclose(parts @ where, force @ p, atol=1e-12)
    np.testing.assert_allclose(normal, np.tile([0.0, 0.0, 1.0], (len(where), 1)))
