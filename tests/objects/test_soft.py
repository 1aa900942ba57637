from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.systems import contact_approximations
from drake_srg.objects.config import ObjectConfig, SoftConfig
from drake_srg.objects.models import AddObject, object_shape
from drake_srg.objects.poses import ContactReader
from drake_srg.objects.soft import box_mesh, nearest_pose, vtk_text
from drake_srg.scenario import load_scenario
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.station import MakeStation
from drake_srg.types import Box, Sphere

lengths = st.floats(0.01, 0.1)


@given(st.tuples(lengths, lengths, lengths), st.floats(0.02, 0.2))
def test_the_tetrahedra_fill_the_box_without_overlap(size, resolution):
    vertices, tetrahedra = box_mesh(size, resolution)
    a, b, c, d = np.moveaxis(vertices[tetrahedra], 1, 0)
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
    assert np.all(volumes > 0.0)
    assert volumes.sum() == pytest.approx(np.prod(size))
    np.testing.assert_allclose(vertices.min(axis=0), -0.5 * np.array(size))
    np.testing.assert_allclose(vertices.max(axis=0), 0.5 * np.array(size))


def test_neighbours_share_their_faces():
    size = np.array([0.04, 0.06, 0.02])
    vertices, tetrahedra = box_mesh(size, 0.02)
    faces = Counter(
        tuple(sorted(np.delete(tetrahedron, i)))
        for tetrahedron in tetrahedra
        for i in range(4)
    )
    for face, count in faces.items():
        sides = vertices[list(face)] / (0.5 * size)
        on_surface = any(np.allclose(sides[:, k], s) for k in range(3) for s in (-1, 1))
        assert count == (1 if on_surface else 2)


def test_every_tetrahedron_has_a_vertex_inside():
    size = np.array([0.03, 0.05, 0.02])
    vertices, tetrahedra = box_mesh(size, 0.02)
    inside = np.all(np.abs(vertices) < 0.499 * size, axis=1)
    assert np.all(inside[tetrahedra].any(axis=1))


def test_the_mesh_is_mirror_symmetric():
    # With even counts of cells, so that an evenly squeezed box does not turn.
    vertices, tetrahedra = box_mesh([0.04, 0.04, 0.04], 0.02)

    def cells(points):
        return {tuple(sorted(map(tuple, points[t].round(9) + 0.0))) for t in tetrahedra}

    for axis in range(3):
        mirrored = vertices.copy()
        mirrored[:, axis] *= -1.0
        assert cells(mirrored) == cells(vertices)


def test_the_file_has_all_vertices_and_tetrahedra():
    vertices, tetrahedra = box_mesh([0.02, 0.02, 0.02], 0.02)
    lines = vtk_text(vertices, tetrahedra).splitlines()
    assert lines[4] == "POINTS 9 double"
    assert [float(x) for x in lines[5].split()] == [-0.01, -0.01, -0.01]
    assert lines[14] == "CELLS 12 60"
    assert [int(x) for x in lines[15].split()] == [4, *tetrahedra[0]]
    assert lines[27:] == ["CELL_TYPES 12", *["10"] * 12]


SPONGE = ObjectConfig(
    shape=Box([0.04, 0.06, 0.05]),
    soft=SoftConfig(),
    mass=0.02,
    friction=0.6,
    resolution=0.03,
)
SETTINGS = {"time_step": 0.005, "discrete_contact_approximation": "sap"}
angles = st.floats(-3.0, 3.0)


def add(config=SPONGE, **settings):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(**{**SETTINGS, **settings}), builder
    )
    model = AddObject(plant, "sponge", config)
    plant.Finalize()
    deformables = plant.deformable_model()
    (body,) = map(deformables.GetBody, deformables.GetBodyIds(model))
    return builder.Build(), plant, body


def test_a_box_becomes_a_soft_body_of_its_material():
    _, plant, body = add()
    assert plant.GetModelInstanceName(body.model_instance()) == "sponge"
    config = body.config()
    assert config.youngs_modulus() == SPONGE.soft.youngs_modulus
    assert config.poissons_ratio() == SPONGE.soft.poissons_ratio
    assert config.stiffness_damping_coefficient() == SPONGE.soft.damping
    assert config.mass_density() == pytest.approx(0.02 / (0.04 * 0.06 * 0.05))
    p = body.reference_positions().reshape(-1, 3)
    np.testing.assert_allclose(np.ptp(p, axis=0), SPONGE.shape.size)


def test_a_soft_object_falls_freely():
    diagram, plant, body = add()
    simulator = Simulator(diagram)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    start = body.GetPositions(context)
    simulator.AdvanceTo(0.1)
    fallen = np.zeros(3)
    fallen[2] = -0.5 * 9.81 * 0.1**2
    np.testing.assert_allclose(
        body.GetPositions(context) - start,
        np.tile(fallen[:, None], start.shape[1]),
        atol=1e-6,
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"time_step": 0.006}, "time_step above 0 and up to 0.005 s, got 0.006 s"),
        ({"time_step": 0.0}, "time_step above 0 and up to 0.005 s, got 0 s"),
        *(
            ({"discrete_contact_approximation": name}, "approximation: sap")
            for name in contact_approximations()
            if name != "sap"
        ),
    ],
)
def test_an_unsuitable_plant_is_refused(settings, message):
    with pytest.raises(ScenarioError, match=rf"^objects\.sponge\.soft: .*{message}"):
        add(**settings)


def test_an_unsuitable_scenario_is_refused():
    bench = bench_scenario(SPONGE, overrides=["plant_config.time_step=0.01"])
    with pytest.raises(ScenarioError, match=r"objects\.thing\.soft: .* up to 0\.005 s"):
        Rig(bench)


@pytest.mark.parametrize(
    "thing", ["shape: !Sphere {radius: 0.03}", "model: package://drake_srg/sdf/lid.sdf"]
)
def test_only_a_box_can_be_soft(thing):
    override = f"objects.x={{{thing}, soft: {{}}, mass: 0.1, friction: 0.5}}"
    message = r"objects\.x\.soft: needs a shape \(allowed: !Box\)"
    with pytest.raises(ScenarioError, match=message):
        load_scenario("gripper_bench", overrides=[override])
    ball = ObjectConfig(shape=Sphere(), soft=SoftConfig(), mass=0.1, friction=0.5)
    with pytest.raises(ScenarioError, match=r"\(allowed: !Box\)"):
        add(ball)


def test_a_planner_cannot_pick_a_soft_object():
    with pytest.raises(
        ScenarioError, match=r"^objects\.sponge\.soft: a planner .* use a script"
    ):
        object_shape("sponge", SPONGE)


def test_a_soft_object_stands_in_its_place_and_presses_with_its_weight():
    scenario = bench_scenario(SPONGE, overrides=["plant_config.time_step=0.005"])
    scenario.objects["thing"].yaw = 0.5
    with Rig(scenario) as rig:
        X_WO = rig.X_WO()
        rig.advance(0.5)
        forces = rig.contact_forces()
        settled = rig.X_WO()
    turned = RigidTransform(RollPitchYaw(0.0, 0.0, 0.5), [0.5, 0.0, 0.025])
    assert X_WO.IsNearlyEqualTo(turned, 1e-9)
    assert forces == {"support": pytest.approx(0.02 * 9.81, rel=0.01)}
    assert settled.IsNearlyEqualTo(X_WO, 1e-3)


@pytest.mark.slow
def test_contacts_between_soft_and_rigid_objects_are_named():
    bench = bench_scenario(SPONGE, overrides=["plant_config.time_step=0.005"])
    bench.objects["box"] = ObjectConfig(
        shape=Box([0.03, 0.03, 0.03]), mass=0.2, friction=0.5
    )
    bench.objects["box"].pose = Transform(RigidTransform([0.5, 0.0, 0.065]))
    station = MakeStation(bench)
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    home = bench.arm.home
    station.GetInputPort("arm.position_commanded").FixValue(context, home)
    station.GetInputPort("gripper.closure_commanded").FixValue(context, [0.0])
    simulator.AdvanceTo(1.0)
    contacts = station.GetOutputPort("contact_results_cheat").Eval(context)
    plant = station.GetSubsystemByName("plant")
    weight = pytest.approx(0.2 * 9.81, rel=0.05)
    assert ContactReader(plant, "box").forces(contacts) == {"thing": weight}
    assert ContactReader(plant, "thing").forces(contacts)["box"] == weight


@given(angles, angles, angles)
def test_the_nearest_pose_to_a_rigid_motion_is_that_motion(roll, pitch, yaw):
    p_RV = np.random.default_rng(0).normal(size=(3, 9))
    X_WR = RigidTransform(RollPitchYaw(roll, pitch, yaw), [1.0, 2.0, 3.0])
    assert nearest_pose(p_RV, X_WR @ p_RV).IsNearlyEqualTo(X_WR, 1e-9)


def test_an_even_squeeze_does_not_turn_the_pose():
    p_RV = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1)
    X = nearest_pose(p_RV, p_RV * [[1.0], [0.5], [1.2]])
    assert X.IsNearlyEqualTo(RigidTransform(), 1e-12)


def test_a_flat_body_has_a_rotation():
    p_RV = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0], [0.0] * 4])
    X_WR = RigidTransform(RollPitchYaw(0.3, 0.2, 0.1), [0.0, 0.0, 1.0])
    assert nearest_pose(p_RV, X_WR @ p_RV).IsNearlyEqualTo(X_WR, 1e-9)
