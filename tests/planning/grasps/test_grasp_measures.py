import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    Box,
    ProximityProperties,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from drake_srg.planning.grasps.grasp_measures import (
    MEASURES,
    Body,
    Patch,
    cone_wrenches,
    contact_patches,
    friction_margin,
    merged,
    resisted_acceleration,
    slip_margin,
    wrench_space,
)


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
        # So heavy that the one step that computes the forces moves nothing.
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


# Few examples, because a hull takes milliseconds.
HULLS = settings(max_examples=5)
BODY = Body(mass=0.5, p_WB=np.zeros(3), size=0.05)


def pad(side, force=10.0, friction=0.6, half=0.01, shear=(0.0, 0.0)):
    """A square pad across y, with its corners as points."""
    corners = [(x, side * 0.03, z) for x in (-half, half) for z in (-half, half)]
    n = np.tile([0.0, -side, 0.0], (4, 1))
    f_W = np.array([shear[0], -side * force, shear[1]])
    return Patch(np.array(corners), n, np.full(4, force / 4), friction, f_W)


def pinch(**changes):
    return [pad(1.0, **changes), pad(-1.0, **changes)]


def test_two_points_resist_no_torsion_but_two_pads_do():
    points = [patch.centroid for patch in pinch()]
    assert not wrench_space(points, BODY).closed
    assert wrench_space(pinch(), BODY).closed
    assert wrench_space(pinch(), BODY).epsilon > 0.0


@HULLS
@given(st.floats(0.1, 1.0), st.floats(0.002, 0.02))
def test_the_hull_is_that_of_exact_points(friction, half):
    from scipy.spatial import ConvexHull

    patches = pinch(friction=friction, half=half)
    exact = ConvexHull(cone_wrenches(patches, BODY).reshape(-1, 6))
    found = wrench_space(patches, BODY)
    assert found.epsilon == pytest.approx(-exact.equations[:, -1].max(), abs=1e-8)
    assert found.volume == pytest.approx(exact.volume, rel=1e-6)


def test_one_side_has_no_force_closure():
    assert not wrench_space([pad(1.0)], BODY).closed


@HULLS
@given(st.floats(0.1, 1.0), st.floats(1.1, 2.0))
def test_more_friction_is_never_worse(friction, factor):
    low, high = (
        wrench_space(pinch(friction=mu), BODY) for mu in (friction, friction * factor)
    )
    assert high.epsilon >= low.epsilon - 1e-9
    assert high.volume >= low.volume - 1e-12


@HULLS
@given(st.floats(2.0, 50.0), st.floats(1.5, 3.0))
def test_pressing_harder_counts_only_where_forces_do(force, factor):
    low, high = (pinch(force=f) for f in (force, factor * force))
    assert wrench_space(low, BODY) == wrench_space(high, BODY)
    weighted = [wrench_space(p, BODY, weighted=True).epsilon for p in (low, high)]
    assert weighted[1] == pytest.approx(factor * weighted[0], rel=1e-6)
    assert friction_margin(high, BODY) == pytest.approx(
        factor * friction_margin(low, BODY)
    )


def test_wrenches_of_an_edge_are_on_its_cone():
    wrenches = cone_wrenches(pinch(friction=0.3), BODY)
    assert wrenches.shape == (8, 8, 6)
    normal, across = wrenches[:4, :, 1], wrenches[:4, :, [0, 2]]
    np.testing.assert_allclose(normal, -1.0)
    np.testing.assert_allclose(np.linalg.norm(across, axis=2), 0.3)


def test_a_pinch_bears_what_its_friction_allows_beyond_the_weight():
    # Upwards, both pads' friction less the weight; sideways (x), what remains of it.
    # The pyramid's edges lie along x and z.
    force, mu = 20.0, 0.6
    found = resisted_acceleration(pinch(force=force, friction=mu), BODY)
    most = 2.0 * mu * force / BODY.mass - 9.81
    assert 0.5 * most < found <= most + 1e-6


def test_a_pinch_that_cannot_carry_the_weight_resists_nothing():
    assert resisted_acceleration(pinch(force=1.0), BODY) == 0.0


@HULLS
@given(st.floats(5.0, 50.0))
def test_turning_the_world_changes_nothing(force):
    R = RotationMatrix.MakeZRotation(0.7).matrix()
    turned = [
        dc.replace(p, p_W=p.p_W @ R.T, n_W=p.n_W @ R.T, f_W=R @ p.f_W)
        for p in pinch(force=force)
    ]
    assert slip_margin(turned) == pytest.approx(slip_margin(pinch(force=force)))
    # Friction pyramids turn with the contact's axes, so hulls agree only roughly.
    assert wrench_space(turned, BODY).epsilon == pytest.approx(
        wrench_space(pinch(force=force), BODY).epsilon, rel=0.3
    )


def test_the_slip_margin_is_the_unused_share_of_friction():
    assert slip_margin(pinch()) == 1.0
    assert slip_margin(pinch(shear=(0.0, 3.0))) == pytest.approx(0.5)
    assert slip_margin([pad(1.0), pad(-1.0, shear=(6.0, 0.0))]) == pytest.approx(0.0)
    assert slip_margin(pinch(friction=0.0)) == 0.0


@pytest.mark.parametrize("name", MEASURES)
def test_every_measure_prefers_a_pinch_to_no_contact(name):
    firm = pinch(force=50.0)
    assert MEASURES[name](firm, BODY) >= MEASURES[name]([], BODY) == 0.0


def test_the_centroid_keeps_the_force():
    patch = pad(1.0)
    np.testing.assert_allclose(patch.centroid.p_W, [[0.0, 0.03, 0.0]], atol=1e-12)
    assert patch.centroid.normal_force.tolist() == [10.0]
