"""The five-axis arm's workplace: bench, tables, recess."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, object_body
from drake_srg.parsing import configure_parser
from drake_srg.types import Cylinder
from models.built_models import Distances, build, extent

SEED = 20240607
CYLINDER = {"radius": 0.0125, "length": 0.05}
CYLINDER_COLOR = np.array([0.85, 0.85, 1.0])


def test_tables_stand_on_the_bench_and_the_bench_on_the_floor():
    """The arm's mounting plane is z = 0 in world; table tops are 0.1 m above it."""
    bench = build("bench")
    low, high = extent(bench, bench.bodies()[0])
    assert high[2] == pytest.approx(0, abs=1e-9)
    arm = build("assistive_arm")
    foot, _ = extent(arm, arm.plant.GetBodyByName("base"))
    assert low[2] + foot[2] == pytest.approx(-0.75, abs=1e-6)  # floor.sdf
    for name in ("small_table", "small_table_recess"):
        table = build(name)
        low, high = extent(table, table.bodies()[0])
        np.testing.assert_allclose(high, [0.1, 0.1, 0], atol=1e-6)
        assert 0.1 + low[2] == pytest.approx(foot[2], abs=1e-6)


def collision_distances(name: str) -> Distances:
    built = build(name)
    return Distances(built.shapes(built.bodies()[0], Role.kProximity))


def ring(radius: float, z: float, count: int = 101) -> np.ndarray:
    a = np.linspace(0, 2 * np.pi, count)
    return np.column_stack([radius * np.cos(a), radius * np.sin(a), np.full(count, z)])


def test_recess_leaves_a_millimetre_around_the_cylinder():
    table = collision_distances("small_table_recess")
    for p in ring(CYLINDER["radius"], -0.0015):
        # The floor is farther away. Corners of the 48 flats are 0.03 mm farther out.
        assert 1.0e-3 - 1e-6 < min(table.at(p).values()) < 1.03e-3


def test_recess_is_5_mm_deep_and_flat():
    table = collision_distances("small_table_recess")
    for radius in (0.0, 0.006, 0.012):
        for p in ring(radius, -0.0045, 13):
            assert min(table.at(p).values()) == pytest.approx(5e-4, abs=1e-8)


def test_table_around_the_recess_is_flat_and_has_no_gaps():
    table = collision_distances("small_table_recess")
    rng = np.random.default_rng(SEED)
    for x, y in rng.uniform(-0.1, 0.1, (500, 2)):
        if np.hypot(x, y) > 0.01355:
            above, inside = (
                min(table.at(np.array([x, y, z])).values()) for z in (5e-4, -1e-4)
            )
            assert above == pytest.approx(5e-4, abs=1e-8)
            assert inside < 1e-9


def test_cylinder_stands_in_the_recess():
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(
        time_step=0.002,
        contact_model="hydroelastic_with_fallback",
        discrete_contact_approximation="lagged",
    )
    plant, _ = AddMultibodyPlant(config, builder)
    parser = Parser(plant)
    configure_parser(parser)
    parser.AddModelsFromUrl("package://drake_srg/sdf/small_table_recess.sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("table_top"))
    cylinder = ObjectConfig(shape=Cylinder(**CYLINDER), mass=0.02, friction=0.5)
    body = plant.get_body(object_body(plant, AddObject(plant, "cylinder", cylinder)))
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    # Released 0.9 mm off centre.
    plant.SetFreeBodyPose(context, body, RigidTransform([9e-4, 0, 0.0205]))
    simulator.AdvanceTo(0.5)
    X_WO = plant.EvalBodyPoseInWorld(context, body)
    assert X_WO.translation()[2] == pytest.approx(0.020, abs=1e-4)
    assert X_WO.rotation().matrix()[2, 2] > np.cos(np.radians(0.5))


@pytest.mark.parametrize(
    "name", ("assistive_arm", "small_table", "small_table_recess", "bench", "floor")
)
def test_nothing_else_has_the_cylinders_colour(name):
    built = build(name)
    for body in built.bodies():
        frame = built.plant.GetBodyFrameIdOrThrow(body.index())
        for g in built.inspector.GetGeometries(frame, Role.kIllustration):
            color = built.inspector.GetIllustrationProperties(g).GetProperty(
                "phong", "diffuse"
            )
            rgb = np.array([color.r(), color.g(), color.b()])
            assert np.max(np.abs(rgb - CYLINDER_COLOR)) > 0.1
