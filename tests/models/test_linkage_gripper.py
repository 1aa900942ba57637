"""The gripper of two parallelograms: its loops, its reach, its pads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Role

from models.built_models import Built, Distances, build, mesh_points, moduli

RUBBER = ("linkage_gripper", "linkage_gripper_flat", "linkage_gripper_fast")
VARIANTS = (*RUBBER, "linkage_gripper_bare")
FINGERS = ("master", "slave")
JOINTS = tuple(
    f"{finger}_{name}_joint"
    for finger in FINGERS
    for name in ("crank", "rocker", "coupler", "pin")
)
CRANK, RADIUS, PALM_TO_TIP = 0.045, 0.0125, 0.095
OPEN_HALF_GAP = 0.030
# Angle [rad] of a crank that points straight ahead and holds the cylinder.
STRAIGHT = float(np.arcsin((OPEN_HALF_GAP - RADIUS) / CRANK))
SERVO_TORQUE, SERVO_SPEED = 0.52, 103 * 2 * np.pi / 60  # XL330-M288-T at 5 V
SERVO_INERTIA = 0.00199  # identified, kg m²


def half_gap(q: float) -> float:
    """Return the distance from the middle to a flat pad or a curved one's bottom."""
    return RADIUS + CRANK * float(np.sin(STRAIGHT - q))


def at(name: str, q: float) -> Built:
    """Return the model with all joints at `q`, where the loops are closed."""
    built = Built(name)
    built.set_joints(**dict.fromkeys(JOINTS, q))
    return built


def collision_corners(built: Built, word: str = "") -> np.ndarray:
    """Return the corners, in the palm's frame, of geometry with `word` in its name."""
    points = [np.empty((0, 3))]
    for body in built.bodies():
        X_GB = built.plant.EvalBodyPoseInWorld(built.plant_context, body)
        for name, shape, X_BS in built.shapes(body, Role.kProximity):
            if word in name:
                points.append(((X_GB @ X_BS) @ corners(shape).T).T)
    return np.vstack(points)


def corners(shape: Any) -> np.ndarray:
    if not hasattr(shape, "size"):
        return mesh_points(shape)
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return signs * shape.size() / 2


@pytest.mark.parametrize("name", VARIANTS)
def test_has_eight_revolute_joints_two_of_them_driven(name):
    plant = build(name).plant
    moving = [
        plant.get_joint(j)
        for j in plant.GetJointIndices()
        if plant.get_joint(j).num_positions() == 1
    ]
    assert tuple(joint.name() for joint in moving) == JOINTS
    assert {joint.type_name() for joint in moving} == {"revolute"}
    actuators = [plant.get_joint_actuator(a) for a in plant.GetJointActuatorIndices()]
    names = [actuator.name() for actuator in actuators]
    assert names == [f"{finger}_crank_joint" for finger in FINGERS]
    for actuator in actuators:
        assert actuator.effort_limit() == SERVO_TORQUE
        inertia = actuator.default_rotor_inertia() * actuator.default_gear_ratio() ** 2
        assert inertia == pytest.approx(SERVO_INERTIA, rel=1e-4)
        joint = actuator.joint()
        assert joint.velocity_upper_limits() == pytest.approx([SERVO_SPEED], rel=1e-3)
        # Back-EMF leaves no torque at full speed.
        assert joint.default_damping() == pytest.approx(
            SERVO_TORQUE / SERVO_SPEED, rel=1e-2
        )


def test_loops_are_closed_by_constraints():
    # Per finger: two balls, or three joints that mimic the crank's.
    assert build("linkage_gripper").plant.num_constraints() == 4
    assert build("linkage_gripper_flat").plant.num_constraints() == 4
    for mimic in ("linkage_gripper_fast", "linkage_gripper_bare"):
        assert build(mimic).plant.num_constraints() == 6


@pytest.mark.slow
@pytest.mark.parametrize("q", (0.0, STRAIGHT, 0.69))
@pytest.mark.parametrize("name", VARIANTS)
def test_the_halves_of_the_couplers_meet(name, q):
    built = at(name, q)
    for finger in FINGERS:
        X_GT, X_GC = (
            built.plant.GetBodyByName(f"{finger}_{link}").EvalPoseInWorld(
                built.plant_context
            )
            for link in ("tip", "coupler")
        )
        # The rocker's pin is 10 mm outside the crank's.
        np.testing.assert_allclose(X_GT @ [0, -0.010, 0], X_GC @ [0, 0, 0], atol=1e-9)
        np.testing.assert_allclose(X_GT @ [0, 0, 0], X_GC @ [0, 0.010, 0], atol=1e-9)
        # The parallelogram keeps the fingertip's x parallel to the palm's.
        x = X_GT.rotation().matrix()[:, 0]
        np.testing.assert_allclose(x, [1, 0, 0], atol=1e-9)


@pytest.mark.parametrize("q", (0.0, 0.2, STRAIGHT, 0.6, 0.68))
def test_gap_and_reach_by_the_cranks_angle(q):
    pads = collision_corners(at("linkage_gripper_flat", q), "_pad")
    left, right = pads[pads[:, 1] > 0], pads[pads[:, 1] < 0]
    assert left[:, 1].min() == pytest.approx(half_gap(q), abs=1e-6)
    assert right[:, 1].max() == pytest.approx(-half_gap(q), abs=1e-6)
    middle = (pads[:, 0].min() + pads[:, 0].max()) / 2
    reach = PALM_TO_TIP + CRANK * (np.cos(STRAIGHT - q) - 1.0)
    assert middle == pytest.approx(reach, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIANTS)
@pytest.mark.parametrize("q", (0.0, 0.2, STRAIGHT, 0.6))
def test_fits_into_its_workplace(name, q):
    built = at(name, q)
    points = collision_corners(built)
    # Height: the middle of a cylinder in the recess is 20 mm above the table.
    assert np.max(np.abs(points[:, 2])) <= 0.014 + 1e-9
    # Length: the middle of a lying cylinder is 12.5 mm above the table.
    assert np.max(points[:, 0]) <= PALM_TO_TIP + 0.0095


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIANTS)
def test_left_and_right_are_mirrored(name):
    for q in (0.0, 0.5):
        points = np.round(collision_corners(at(name, q)), 6) + 0.0
        mirrored = np.round(points * (1, -1, 1), 6) + 0.0
        assert set(map(tuple, points)) == set(map(tuple, mirrored))


def test_curved_pads_follow_the_cylinder():
    built = at("linkage_gripper", STRAIGHT)
    for finger in FINGERS:
        tip = built.plant.GetBodyByName(f"{finger}_tip")
        shapes = built.shapes(tip, Role.kProximity)
        pads = Distances([shape for shape in shapes if "_pad_" in shape[0]])
        X_TG = tip.EvalPoseInWorld(built.plant_context).inverse()
        side = 1.0 if finger == "master" else -1.0
        # The pads cover 40 degrees to each side of the middle. Chords of 80 / 3 degrees
        # are at most R (1 / cos(40 / 3 degrees) - 1) = 0.35 mm outside the circle.
        for angle in np.radians(np.linspace(-39, 39, 27)):
            direction = np.array([np.sin(angle), side * np.cos(angle), 0.0])
            p_G = np.array([PALM_TO_TIP, 0, 0]) + RADIUS * direction
            distance = min(pads.at(X_TG @ p_G).values())
            assert -1e-6 < distance < 3.5e-4, np.degrees(angle)


@pytest.mark.parametrize("name", VARIANTS)
def test_only_the_pads_are_soft_with_a_modulus_per_finger(name):
    soft = {"master_tip": 2.0e6, "slave_tip": 2.2e6} if name in RUBBER else {}
    for (body, geometry), modulus in moduli(build(name)).items():
        expected = soft.get(body, np.inf) if "_pad" in geometry else np.inf
        assert modulus == expected, geometry


def test_bare_pads_are_smoother_than_the_rest():
    built, friction = build("linkage_gripper_bare"), {}
    for body in built.bodies():
        frame = built.plant.GetBodyFrameIdOrThrow(body.index())
        for g in built.inspector.GetGeometries(frame, Role.kProximity):
            properties = built.inspector.GetProximityProperties(g)
            mu = properties.GetProperty("material", "coulomb_friction")
            is_pad = "_pad" in built.inspector.GetName(g)
            friction.setdefault(is_pad, set()).add(mu.static_friction())
    assert friction == {True: {0.2}, False: {0.4}}


@pytest.mark.slow
def test_only_the_fingertips_touch():
    for name, empty in (("linkage_gripper", 0.63), ("linkage_gripper_flat", 0.69)):
        for q in np.linspace(0.0, empty, 12):
            for pair in at(name, q).touching():
                assert set(pair) == {"master_tip", "slave_tip"}, q
        assert at(name, empty).touching()


@pytest.mark.parametrize("name", VARIANTS)
def test_mass(name):
    """Two servos of 18 g and light printed parts, which a hobby arm can carry."""
    built = build(name)
    mass = built.plant.CalcTotalMass(built.plant_context, [built.model])
    assert 2 * 0.018 < mass < 0.1


@pytest.mark.parametrize("name", VARIANTS)
def test_frames(name):
    built = build(name)
    for frame, p in (("mount", [0, 0, 0]), ("grasp_center", [PALM_TO_TIP, 0, 0])):
        X = built.plant.GetFrameByName(frame).CalcPoseInWorld(built.plant_context)
        assert X.rotation().IsExactlyIdentity()
        np.testing.assert_array_equal(X.translation(), p)
