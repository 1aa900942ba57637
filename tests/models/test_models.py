from __future__ import annotations

import logging
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    CollisionFilterDeclaration,
    Convex,
    Cylinder,
    GeometrySet,
    ReadObjToTriangleSurfaceMesh,
    Role,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator

from drake_srg.parsing import models_path
from models.built_models import Built, Distances, build, extent, mesh_points, path_of

CAN = "005_tomato_soup_can"
NOT_CONVEX = ("mug", "bowl", "squeeze_bottle", "wrench")
ROBOTS = ("srg", "iiwa14", "gantry", "assistive_arm", "linkage_gripper")
WORKPLACE = ("small_table", "small_table_recess", "bench")
MODELS = (*ROBOTS, *WORKPLACE, "table", "floor", "marker", "lid", CAN, *NOT_CONVEX)
MASSES = {"srg": 0.4, "iiwa14": 30.61, "lid": 0.3, "marker": 0.01, CAN: 0.349}
SRG_JOINTS = (
    "left_base_joint",
    "right_base_joint",
    "left_tip_joint",
    "right_tip_joint",
)
SEED = 20240607


# ---- every model


@pytest.mark.parametrize("name", MODELS)
def test_parses_without_a_warning(name, caplog):
    with caplog.at_level(logging.WARNING, logger="drake"):
        built = Built(name)
    assert not caplog.records
    assert built.plant.GetModelInstanceName(built.model) == name


@pytest.mark.parametrize(("name", "mass"), MASSES.items())
def test_total_mass(name, mass):
    built = build(name)
    total = built.plant.CalcTotalMass(built.plant_context, [built.model])
    assert total == pytest.approx(mass)


@pytest.mark.parametrize(
    "name",
    ("srg", "assistive_arm", "linkage_gripper", "lid", "marker", CAN, *NOT_CONVEX),
)
def test_inertias_fit_inside_the_body(name):
    built = build(name)
    for body in built.bodies():
        M = body.CalcSpatialInertiaInBodyFrame(built.plant_context)
        assert M.IsPhysicallyValid()
        low, high = extent(built, body)
        com = M.get_com()
        assert np.all(low < com + 1e-9) and np.all(com < high + 1e-9)
        moments = M.Shift(com).get_unit_inertia().get_moments()
        x2, y2, z2 = ((high - low) / 2) ** 2
        # At most all mass at the bounding box's corners, at least a tenth of that.
        most = np.array([y2 + z2, x2 + z2, x2 + y2])
        assert np.all(moments <= most)
        assert np.all(moments >= 0.1 * most)


def test_arm_inertias_are_valid():
    built = build("iiwa14")
    for body in built.bodies():
        M = body.CalcSpatialInertiaInBodyFrame(built.plant_context)
        assert M.IsPhysicallyValid(), body.name()


# ---- what is seen is what is touched


def surface_points(shape: Any, rng: np.random.Generator) -> np.ndarray:
    """Random points of a shape's surface, in its own frame."""
    if isinstance(shape, Box):
        p = rng.uniform(-0.5, 0.5, (60, 3))
        rows = np.arange(len(p))
        axis = rng.integers(0, 3, len(p))
        p[rows, axis] = np.sign(p[rows, axis]) / 2
        return p * shape.size()
    if isinstance(shape, Cylinder):
        a = rng.uniform(0, 2 * np.pi, 60)
        r = np.where(rng.random(60) < 0.5, np.sqrt(rng.random(60)), 1.0)
        z = np.where(r < 1, np.sign(rng.normal(size=60)), rng.uniform(-1, 1, 60))
        R, h = shape.radius(), shape.length() / 2
        return np.column_stack([R * r * np.cos(a), R * r * np.sin(a), h * z])
    mesh = ReadObjToTriangleSurfaceMesh(str(path_of(shape)))
    V = np.array(mesh.vertices())
    weights = rng.dirichlet((1, 1, 1), mesh.num_triangles())
    corners = np.array(
        [[t.vertex(i) for i in range(3)] for t in mesh.triangles()], dtype=int
    )
    inside = np.einsum("ij,ijk->ik", weights, V[corners])
    points = np.vstack([inside, V])
    return rng.permutation(points)[:400]


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        ("srg", 0.002),
        ("srg_fast", 0.009),
        ("iiwa14", 0.002),
        ("assistive_arm", 0.002),
        ("linkage_gripper", 0.002),
        ("linkage_gripper_flat", 0.002),
        ("table", 0.002),
        ("lid", 0.002),
        (CAN, 3e-4),
    ]
    + [(name, 0.002) for name in (*NOT_CONVEX, *WORKPLACE)],
)
def test_what_is_seen_is_what_is_touched(name, tolerance):
    built = build(name)
    rng = np.random.default_rng(SEED)
    for body in built.bodies():
        seen = built.shapes(body, Role.kIllustration)
        touched = built.shapes(body, Role.kProximity)
        to_seen, to_touched = Distances(seen), Distances(touched)
        for label, shape, X in seen:
            for p in (X @ surface_points(shape, rng).T).T:
                assert min(to_touched.at(p).values()) <= tolerance, (label, p)
        for label, shape, X in touched:
            for p in (X @ surface_points(shape, rng).T).T:
                others = to_touched.at(p)
                del others[label]
                if min(others.values(), default=1) < 0:
                    continue  # inside another piece: nothing can touch it there
                distances = np.abs(list(to_seen.at(p).values()))
                assert distances.min() <= tolerance, (label, p)


@pytest.mark.parametrize("name", MODELS)
def test_touched_shapes_are_convex_or_primitive(name):
    built = build(name)
    for body in built.bodies():
        shapes = built.shapes(body, Role.kProximity)
        assert bool(shapes) == (name not in ("marker", "gantry"))
        for label, shape, _ in shapes:
            assert isinstance(shape, Box | Cylinder | Convex), label


# ---- the gripper


def test_srg_joints_and_actuators_are_declared_in_the_contracts_order():
    plant = build("srg").plant
    joints = [
        plant.get_joint(j).name()
        for j in plant.GetJointIndices()
        if plant.get_joint(j).num_positions() == 1
    ]
    actuators = [
        plant.get_joint_actuator(a).name() for a in plant.GetJointActuatorIndices()
    ]
    assert tuple(joints) == SRG_JOINTS
    assert tuple(actuators) == SRG_JOINTS


@pytest.mark.parametrize("name", SRG_JOINTS)
def test_srg_joint_limits(name):
    plant = build("srg").plant
    joint = plant.GetJointByName(name)
    actuator = plant.GetJointActuatorByName(name)
    assert joint.position_lower_limits() == pytest.approx([0])
    assert joint.position_upper_limits() == pytest.approx([1.94])
    assert joint.velocity_upper_limits() == pytest.approx([3.67])
    # Two wires share 4.69 N m on a spool of 7.6 mm; arms of 6.5 and 4.63 mm.
    effort = 2.006 if "base" in name else 1.428
    assert actuator.effort_limit() == pytest.approx(effort, rel=1e-3)
    ratio = actuator.default_gear_ratio()
    arm = effort / (800 / 1023 * 6.0 / 0.0076 / 2)
    assert ratio == pytest.approx(200 * arm / 0.0076, rel=1e-3)


@pytest.mark.parametrize(
    ("degrees", "gap"), [(0, 0.182), (45, 0.133), (90, 0.0416), (100.7, 0.0009)]
)
def test_pad_gap_by_base_angle(degrees, gap):
    built = build("srg")
    built.set_joints(**dict.fromkeys(SRG_JOINTS, 0.0))
    angle = np.radians(degrees)
    built.set_joints(left_base_joint=angle, right_base_joint=angle)
    left, right = (pad_corners(built, side) for side in ("left", "right"))
    assert left[:, 1].min() - right[:, 1].max() == pytest.approx(gap, abs=5e-4)
    np.testing.assert_allclose(
        sorted(map(tuple, np.round(left, 9))),
        sorted(map(tuple, np.round(right * (1, -1, 1), 9))),
        atol=1e-8,
    )


def pad_corners(built: Built, side: str) -> np.ndarray:
    body = built.plant.GetBodyByName(f"{side}_tip_link")
    shapes = built.shapes(body, Role.kProximity)
    ((shape, X_BG),) = [(s, X) for name, s, X in shapes if name.endswith(f"{side}_pad")]
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    X_WB = built.plant.EvalBodyPoseInWorld(built.plant_context, body)
    return ((X_WB @ X_BG) @ (signs * shape.size() / 2).T).T


def test_srg_frames():
    built = build("srg")
    built.set_joints(**dict.fromkeys(SRG_JOINTS, 0.0))
    built.set_joints(left_base_joint=np.pi / 2, right_base_joint=np.pi / 2)
    pads = np.vstack([pad_corners(built, side) for side in ("left", "right")])
    frames = {
        name: built.plant.GetFrameByName(name).CalcPoseInWorld(built.plant_context)
        for name in ("mount", "grasp_center")
    }
    assert frames["mount"].IsExactlyIdentity()
    x, y, z = frames["grasp_center"].translation()
    assert (y, z) == (0, 0)
    assert pads[:, 0].min() + 0.01 < x < pads[:, 0].max() - 0.01
    assert frames["grasp_center"].rotation().IsExactlyIdentity()


def sweep(count: int) -> Iterator[tuple[float, float]]:
    for base in np.linspace(0, 1.94, count):
        for tip in np.linspace(0, 1.94, count):
            yield base, tip


def test_only_opposite_fingers_touch():
    built = Built("srg")
    for base, tip in sweep(13):
        built.set_joints(left_base_joint=base, right_base_joint=base)
        built.set_joints(left_tip_joint=tip, right_tip_joint=tip)
        for one, other in built.touching():
            assert {one[:4], other[:4]} == {"left", "righ"}, (base, tip)


def test_opposite_pads_touch():
    built = Built("srg")
    built.set_joints(left_base_joint=1.8, right_base_joint=1.8)
    assert ("left_tip_link", "right_tip_link") in built.touching()


@pytest.mark.parametrize("side", ("left", "right"))
def test_one_finger_turns_freely_though_nothing_is_filtered(side):
    built = Built("srg")
    names = ["palm", f"{side}_base_link", f"{side}_tip_link"]
    frames = [
        built.plant.GetBodyFrameIdOrThrow(built.plant.GetBodyByName(n).index())
        for n in names
    ]
    manager = built.scene_graph.collision_filter_manager(
        built.scene_graph.GetMyMutableContextFromRoot(built.context)
    )
    manager.Apply(CollisionFilterDeclaration().AllowWithin(GeometrySet(frames)))
    for base, tip in sweep(21):
        built.set_joints(**{f"{side}_base_joint": base, f"{side}_tip_joint": tip})
        own = {pair for pair in built.touching() if set(pair) <= set(names)}
        assert not own, (base, tip)


def test_gripper_closes_until_its_pads_meet():
    built = Built("srg")
    port = built.plant.get_actuation_input_port()
    # A fraction of full effort; the moment arms' own ratio.
    port.FixValue(built.plant_context, [0.2, 0.2, 0.02, 0.02])
    simulator = Simulator(built.diagram, built.context)
    simulator.AdvanceTo(1.5)
    q = built.plant.GetPositions(built.plant_context)
    v = built.plant.GetVelocities(built.plant_context)
    assert np.all(np.abs(v) < 0.05)
    assert np.all(q > -0.01) and np.all(q < 1.95)
    assert ("left_tip_link", "right_tip_link") in built.touching()
    left, right = (pad_corners(built, side) for side in ("left", "right"))
    # Compliant pads press into each other, by less than a millimetre.
    assert -1e-3 < left[:, 1].min() - right[:, 1].max() < 1e-4


def test_only_the_pads_are_soft():
    built = build("srg")
    for body in built.bodies():
        frame = built.plant.GetBodyFrameIdOrThrow(body.index())
        for g in built.inspector.GetGeometries(frame, Role.kProximity):
            name = built.inspector.GetName(g)
            properties = built.inspector.GetProximityProperties(g)
            modulus = properties.GetPropertyOrDefault(
                "hydroelastic", "hydroelastic_modulus", np.inf
            )
            assert modulus == (2e6 if name.endswith("_pad") else np.inf), name


def test_srg_fast_is_touched_where_srg_holds_an_object():
    """From inside, at the base link's face, the palm's face and the noses."""
    built, fast = build("srg"), build("srg_fast")
    for name, points in {
        "left_base_link": [(x, 0.0092, z) for x in (0.007, 0.037) for z in (0, 0.014)],
        "palm": [(0.072, y, z) for y in (0.0, 0.018) for z in (0, 0.015)],
        "left_tip_link": [(0.0, 0.0086, z) for z in (-0.008, 0.0, 0.008)],
    }.items():
        for model in (built, fast):
            body = model.plant.GetBodyByName(name)
            distances = Distances(model.shapes(body, Role.kProximity))
            for p in points:
                distance = min(distances.at(np.array(p)).values())
                assert abs(distance) < 4e-4, (name, p)


def test_srg_fast_differs_from_srg_in_what_is_touched_alone():
    built, fast = build("srg"), build("srg_fast")
    for body in built.bodies():
        other = fast.plant.GetBodyByName(body.name())
        one, two = (
            b.CalcSpatialInertiaInBodyFrame(m.plant_context).CopyToFullMatrix6()
            for m, b in ((built, body), (fast, other))
        )
        np.testing.assert_array_equal(one, two)
        seen = [
            [path_of(shape).name for _, shape, _ in m.shapes(b, Role.kIllustration)]
            for m, b in ((built, body), (fast, other))
        ]
        assert seen[0] == seen[1]


# ---- the arm


def flange_by_dh(q: np.ndarray) -> RigidTransform:
    """The maker's Denavit-Hartenberg parameters, which the model does not use."""
    h = np.pi / 2
    X = RigidTransform()
    for angle, alpha, d in zip(
        q,
        (-h, h, h, -h, -h, h, 0),
        (0.36, 0, 0.42, 0, 0.40, 0, 0.126),
        strict=True,
    ):
        X = (
            X
            @ RigidTransform(RotationMatrix.MakeZRotation(angle), [0, 0, d])
            @ RigidTransform(RotationMatrix.MakeXRotation(alpha), [0, 0, 0])
        )
    return X


@pytest.mark.parametrize(
    "q",
    [
        np.zeros(7),
        np.array([0, 0.6, 0, -1.5, 0, 1.0, 0]),
        np.array([0.4, -0.7, 1.1, 1.3, -0.9, 0.5, 2.0]),
    ],
)
def test_flange_pose_agrees_with_the_dh_parameters(q):
    built = build("iiwa14")
    built.plant.SetPositions(built.plant_context, q)
    flange = built.plant.GetFrameByName("flange")
    X_WF = flange.CalcPoseInWorld(built.plant_context)
    assert X_WF.IsNearlyEqualTo(flange_by_dh(q), 1e-6)


def test_upright_arm_is_1306_mm_tall():
    built = build("iiwa14")
    built.plant.SetPositions(built.plant_context, np.zeros(7))
    X_WF = built.plant.GetFrameByName("flange").CalcPoseInWorld(built.plant_context)
    np.testing.assert_allclose(X_WF.translation(), [0, 0, 1.306], atol=1e-6)


def test_arm_limits():
    plant = build("iiwa14").plant
    names = [
        plant.get_joint_actuator(a).name() for a in plant.GetJointActuatorIndices()
    ]
    assert names == [f"joint_{i}" for i in range(1, 8)]
    upper = np.radians([170, 120, 170, 120, 170, 120, 175])
    np.testing.assert_allclose(plant.GetPositionUpperLimits(), upper, atol=1e-6)
    np.testing.assert_allclose(plant.GetPositionLowerLimits(), -upper, atol=1e-6)
    speed = np.radians([85, 85, 100, 75, 130, 135, 135])
    np.testing.assert_allclose(plant.GetVelocityUpperLimits(), speed, atol=1e-6)
    np.testing.assert_allclose(
        plant.GetAccelerationUpperLimits(),
        [8.57, 8.57, 8.74, 11.36, 12.23, 15.72, 15.72],
    )
    np.testing.assert_allclose(
        plant.GetEffortUpperLimits(), [320, 320, 176, 176, 110, 40, 40]
    )


def test_arm_does_not_touch_itself_in_working_poses():
    built = Built("iiwa14")
    rng = np.random.default_rng(SEED)
    upper = built.plant.GetPositionUpperLimits()
    # Folded further, the wrist may meet the foot; that is real.
    reach = np.array([1, 0.75, 1, 0.9, 1, 1, 1])
    for _ in range(200):
        q = rng.uniform(-upper, upper) * reach
        built.plant.SetPositions(built.plant_context, q)
        assert not built.touching(), q


# ---- the gantry


def test_gantry_moves_its_flange_along_the_axes():
    built = build("gantry")
    flange = built.plant.GetFrameByName("flange")
    for q in ([0.0, 0.0, 0.0], [0.4, -0.3, 0.8]):
        built.plant.SetPositions(built.plant_context, q)
        X_WF = flange.CalcPoseInWorld(built.plant_context)
        assert X_WF.IsNearlyEqualTo(RigidTransform(q), 1e-12)
    assert [
        built.plant.get_joint_actuator(a).name()
        for a in built.plant.GetJointActuatorIndices()
    ] == ["gantry_x", "gantry_y", "gantry_z"]


def test_gantry_can_shake_5_kg_at_1_g():
    plant = build("gantry").plant
    amplitude = 9.81 / (2 * np.pi * 2.0) ** 2  # m, at 2 Hz
    assert np.all(plant.GetPositionUpperLimits() > amplitude)
    assert np.all(plant.GetVelocityUpperLimits() > 2 * np.pi * 2.0 * amplitude)
    assert np.all(plant.GetAccelerationUpperLimits() > 9.81)
    stand = plant.GetBodyByName("stand").default_mass()
    total = plant.CalcTotalMass(plant.CreateDefaultContext())
    moved = total - stand + 0.4 + 5.0  # with gripper and payload
    assert np.all(plant.GetEffortUpperLimits() > moved * 2 * 9.81)


# Around a hand at the flange [m]: the fingers sweep 0.15 to each side, reach 0.19.
@pytest.mark.parametrize(
    ("low", "high"),
    [
        ((-0.1, -0.3, -0.5), (0.3, 0.3, -0.03)),  # points down
        ((0.05, -0.3, -0.3), (0.3, 0.3, 0.3)),  # to the front
        ((-0.1, -0.3, 0.03), (0.3, 0.3, 0.3)),  # up
        ((-0.14, 0.05, -0.3), (0.3, 0.3, 0.3)),  # to the side
    ],
)
def test_gantry_keeps_out_of_the_hands_way(low, high):
    built = Built("gantry")
    for q in ([0, 0, 0.3], [-0.4, 0.4, 0.6], [0.4, -0.4, 0.6]):
        built.plant.SetPositions(built.plant_context, q)
        for body in built.bodies():
            X_WB = built.plant.EvalBodyPoseInWorld(built.plant_context, body)
            for label, shape, X_BG in built.shapes(body, Role.kIllustration):
                p = ((X_WB @ X_BG) @ mesh_points(shape).T).T - q
                inside = np.all((p > low) & (p < high), axis=1)
                assert not np.any(inside), (label, q)


# ---- the props


def test_tables_top_is_at_zero():
    built = build("table")
    ((_, shape, X),) = [
        g
        for g in built.shapes(built.bodies()[0], Role.kProximity)
        if g[0].endswith("table_top")
    ]
    centre = X.translation()
    np.testing.assert_allclose(centre + shape.size() / 2, [1.3, 0.8, 0], atol=1e-12)
    np.testing.assert_allclose(
        centre - shape.size() / 2, [-0.4, -0.8, -0.04], atol=1e-12
    )
    frame = built.plant.GetFrameByName("table_top")
    assert frame.CalcPoseInWorld(built.plant_context).IsExactlyIdentity()


def test_can_is_one_cylinder():
    built = build(CAN)
    ((_, shape, X),) = built.shapes(built.plant.GetBodyByName("can"), Role.kProximity)
    assert isinstance(shape, Cylinder)
    assert (shape.radius(), shape.length()) == (0.0339, 0.1018)
    assert X.IsExactlyIdentity()


def test_lid_covers_a_can():
    built = build("lid")
    distances = Distances(built.shapes(built.bodies()[0], Role.kProximity))
    for angle in np.linspace(0, 2 * np.pi, 50):
        p = np.array([0.0339 * np.cos(angle), 0.0339 * np.sin(angle), 0.1018])
        assert min(distances.at(p).values()) > 0.02


@pytest.mark.parametrize("name", NOT_CONVEX)
def test_household_models_are_not_convex(name):
    """Somewhere between two points that are touched there is nothing."""
    built = build(name)
    (body,) = built.bodies()
    shapes = built.shapes(body, Role.kProximity)
    assert len(shapes) > 1
    distances = Distances(shapes)
    corners = np.vstack([(X @ mesh_points(shape).T).T for _, shape, X in shapes])
    rng = np.random.default_rng(SEED)
    middles = 0.5 * (rng.permutation(corners)[:200] + rng.permutation(corners)[:200])
    assert max(min(distances.at(p).values()) for p in middles) > 2e-3


@pytest.mark.parametrize("name", NOT_CONVEX)
def test_household_models_rest_on_their_origins_plane(name):
    built = build(name)
    (body,) = built.bodies()
    low, high = extent(built, body)
    assert low[2] == pytest.approx(0.0, abs=1e-6)
    assert np.all(high - low < 0.21)
    mass = built.plant.CalcTotalMass(built.plant_context, [built.model])
    assert 0.15 < mass < 0.65  # of ordinary weight


# ---- the files


def test_checked_in_models_are_what_the_script_builds():
    pytest.importorskip("manifold3d")
    script = Path(__file__).parents[2] / "tools" / "build_models.py"
    run = subprocess.run(
        [sys.executable, str(script), "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr


def test_meshes_are_small():
    for path in (models_path() / "meshes").iterdir():
        assert path.stat().st_size < 300_000, path.name
