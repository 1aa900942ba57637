"""The five-axis arm and its workplace, measured from the parsed models."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, object_body
from drake_srg.parsing import configure_parser
from drake_srg.types import Cylinder
from models.built_models import Built, Distances, build, extent

SEED = 20240607
G = 9.81
CYLINDER = {"radius": 0.0125, "length": 0.05}
CYLINDER_COLOR = np.array([0.85, 0.85, 1.0])


@pytest.fixture
def arm() -> Built:
    built = Built("assistive_arm")
    built.plant.SetPositions(built.plant_context, np.zeros(5))
    return built


def level_hand(built: Built, rng: np.random.Generator) -> np.ndarray:
    """Sets random positions with the hand level over the tables, and returns them."""
    plant = built.plant
    lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    tip = plant.GetFrameByName("tip")
    while True:
        q = rng.uniform(lower, upper)
        q[3:] = 0.0, -q[1] - q[2]
        plant.SetPositions(built.plant_context, q)
        x, y, z = tip.CalcPoseInWorld(built.plant_context).translation()
        if 0.118 < z < 0.35 and np.hypot(x, y) > 0.22 and lower[4] < q[4] < upper[4]:
            return q


# ---- the arm


def test_home_pose(arm):
    tip = arm.plant.GetFrameByName("tip").CalcPoseInWorld(arm.plant_context)
    home = RigidTransform(
        RotationMatrix.MakeYRotation(0.0018), [-0.25308, 0.0, 0.19001]
    )
    assert tip.IsNearlyEqualTo(home, 1e-11)


def test_palm_is_behind_the_tip_and_looks_at_it(arm):
    tip, flange = (arm.plant.GetFrameByName(name) for name in ("tip", "flange"))
    X_FT = tip.CalcPose(arm.plant_context, flange)
    expected = RigidTransform(RotationMatrix.MakeZRotation(np.pi), [0.095, 0, 0])
    assert X_FT.IsNearlyEqualTo(expected, 1e-11)


@pytest.mark.parametrize(
    ("joint", "axis", "point"),
    [
        (1, (0, 0, 1), (0, 0, 0)),
        (2, (0, -1, 0), (0.06981, 0, 0)),
        (3, (0, -1, 0), (0.11993, 0, 0.18974)),
        (4, (-1, 0, 0), (0, 0.03813, 0.18974)),
        (5, (0, -1, 0), (-0.11617, 0, 0.18974)),
    ],
)
def test_joint_axes_at_home(arm, joint, axis, point):
    context = arm.plant_context
    axis = np.array(axis)
    joint = arm.plant.GetJointByName(f"joint_{joint}")
    X_WJ = joint.frame_on_child().CalcPoseInWorld(context)
    np.testing.assert_allclose(X_WJ.rotation() @ joint.revolute_axis(), axis)
    offset = X_WJ.translation() - point
    np.testing.assert_allclose(np.cross(offset, axis), 0, atol=1e-9)


def test_limits_are_within_the_servos(arm):
    plant = arm.plant
    names = [
        plant.get_joint_actuator(a).name() for a in plant.GetJointActuatorIndices()
    ]
    assert names == [f"joint_{i}" for i in range(1, 6)]
    lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    assert np.all(lower < 0) and np.all(upper > 0)
    assert np.all(upper - lower <= np.radians(270) + 1e-9)
    # Half of 35 and 12 kgf cm, two servos at the shoulder; half of 60 degrees in
    # 0.12 and 0.16 s.
    kgf_cm = 9.80665 / 100
    np.testing.assert_allclose(
        plant.GetEffortUpperLimits(),
        kgf_cm * np.array([17.5, 35, 17.5, 6, 6]),
        rtol=1e-9,
    )
    np.testing.assert_allclose(
        plant.GetVelocityUpperLimits(),
        np.radians([250, 250, 250, 187.5, 187.5]),
        rtol=1e-9,
    )
    assert np.all(plant.GetAccelerationUpperLimits() > 0)


def test_moving_links_carry_their_servos(arm):
    """65 g each with horn, screws and wire; the printed parts weigh no more."""
    for name, servos in {"link_1": 2, "link_2": 1, "link_3": 1, "link_4": 1}.items():
        mass = arm.plant.GetBodyByName(name).default_mass()
        assert 0.065 * servos < mass < 0.13 * servos + 0.01, name


def load(arm: Built) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix and gravity torques with a gripper of 0.1 kg and 0.1 kg in it."""
    plant, context, world = arm.plant, arm.plant_context, arm.plant.world_frame()
    mass = plant.CalcMassMatrix(context)
    torque = -plant.CalcGravityGeneralizedForces(context)
    flange = plant.GetFrameByName("flange")
    for x in (0.05, 0.095):  # its middle, and between its fingers
        J = plant.CalcJacobianTranslationalVelocity(
            context, JacobianWrtVariable.kV, flange, [x, 0, 0], world, world
        )
        mass += 0.1 * J.T @ J
        torque += 0.1 * G * J[2]
    return mass, torque


def test_holds_its_gripper_and_100_g_in_any_position(arm):
    """With margin, at half the servos' stall torque: a quarter to spare at least."""
    plant = arm.plant
    rng = np.random.default_rng(SEED)
    lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    stretched = [0, np.radians(104.8), np.radians(-104), 0, 0]  # level, at full reach
    for q in [stretched, *rng.uniform(lower, upper, (2000, 5))]:
        plant.SetPositions(arm.plant_context, q)
        _, torque = load(arm)
        assert np.all(np.abs(torque) < 0.75 * plant.GetEffortUpperLimits()), q


def test_accelerates_all_joints_at_once_within_their_effort(arm):
    plant = arm.plant
    rng = np.random.default_rng(SEED)
    signs = np.array(list(itertools.product((-1, 1), repeat=5)))
    accelerations = signs * plant.GetAccelerationUpperLimits()
    for _ in range(200):
        q = level_hand(arm, rng)
        mass, torque = load(arm)
        needed = np.abs(accelerations @ mass + torque).max(axis=0)
        assert np.all(needed < plant.GetEffortUpperLimits()), q


def test_does_not_touch_itself_with_a_level_hand_over_the_tables(arm):
    rng = np.random.default_rng(SEED)
    for _ in range(200):
        q = level_hand(arm, rng)
        assert not arm.touching(), q


# ---- the workplace


def test_tables_stand_on_the_bench_and_the_bench_on_the_floor():
    """The arm's mounting plane is the world's z = 0, tables are 0.1 m high above it."""
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


def touched(name: str) -> Distances:
    built = build(name)
    return Distances(built.shapes(built.bodies()[0], Role.kProximity))


def ring(radius: float, z: float, count: int = 101) -> np.ndarray:
    a = np.linspace(0, 2 * np.pi, count)
    return np.column_stack([radius * np.cos(a), radius * np.sin(a), np.full(count, z)])


def test_recess_leaves_a_millimetre_around_the_cylinder():
    table = touched("small_table_recess")
    for p in ring(CYLINDER["radius"], -0.0015):
        # The floor is farther away. 48 flats: corners are 0.03 mm farther out.
        assert 1.0e-3 - 1e-6 < min(table.at(p).values()) < 1.03e-3


def test_recess_is_5_mm_deep_and_flat():
    table = touched("small_table_recess")
    for radius in (0.0, 0.006, 0.012):
        for p in ring(radius, -0.0045, 13):
            assert min(table.at(p).values()) == pytest.approx(5e-4, abs=1e-8)


def test_table_around_the_recess_is_flat_and_closed():
    table = touched("small_table_recess")
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
    # Released by a hand that is 0.9 mm off.
    plant.SetFreeBodyPose(context, body, RigidTransform([9e-4, 0, 0.0205]))
    simulator.AdvanceTo(0.5)
    X_WO = plant.EvalBodyPoseInWorld(context, body)
    assert X_WO.translation()[2] == pytest.approx(0.020, abs=1e-4)
    assert X_WO.rotation().matrix()[2, 2] > np.cos(np.radians(0.5))


@pytest.mark.parametrize(
    "name", ("assistive_arm", "small_table", "small_table_recess", "bench", "floor")
)
def test_nothing_has_the_cylinders_colour(name):
    built = build(name)
    for body in built.bodies():
        frame = built.plant.GetBodyFrameIdOrThrow(body.index())
        for g in built.inspector.GetGeometries(frame, Role.kIllustration):
            color = built.inspector.GetIllustrationProperties(g).GetProperty(
                "phong", "diffuse"
            )
            rgb = np.array([color.r(), color.g(), color.b()])
            assert np.max(np.abs(rgb - CYLINDER_COLOR)) > 0.1
