"""The five-axis arm: kinematics, limits, strength, self-contact."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import JacobianWrtVariable

from models.built_models import Built

SEED = 20240607
G = 9.81


@pytest.fixture
def arm() -> Built:
    built = Built("assistive_arm")
    built.plant.SetPositions(built.plant_context, np.zeros(5))
    return built


def level_hand(built: Built, rng: np.random.Generator) -> np.ndarray:
    """Set and return random positions with a level hand over the tables."""
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


def test_home_pose(arm):
    tip = arm.plant.GetFrameByName("tip").CalcPoseInWorld(arm.plant_context)
    home = RigidTransform(
        RotationMatrix.MakeYRotation(0.0018), [-0.25308, 0.0, 0.19001]
    )
    assert tip.IsNearlyEqualTo(home, 1e-11)


def test_palm_is_behind_the_tip_and_faces_it(arm):
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


def test_limits_are_within_the_servos_data_sheets(arm):
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
    """A servo with horn, screws and wire weighs 65 g; printed parts weigh no more."""
    for name, servos in {"link_1": 2, "link_2": 1, "link_3": 1, "link_4": 1}.items():
        mass = arm.plant.GetBodyByName(name).default_mass()
        assert 0.065 * servos < mass < 0.13 * servos + 0.01, name


def load(arm: Built) -> tuple[np.ndarray, np.ndarray]:
    """Return mass matrix and gravity torques; 0.1 kg of gripper holds 0.1 kg."""
    plant, context, world = arm.plant, arm.plant_context, arm.plant.world_frame()
    mass = plant.CalcMassMatrix(context)
    torque = -plant.CalcGravityGeneralizedForces(context)
    flange = plant.GetFrameByName("flange")
    for x in (0.05, 0.095):  # m, the gripper's middle and the load's
        J = plant.CalcJacobianTranslationalVelocity(
            context, JacobianWrtVariable.kV, flange, [x, 0, 0], world, world
        )
        mass += 0.1 * J.T @ J
        torque += 0.1 * G * J[2]
    return mass, torque


def test_holds_its_gripper_and_100_g_in_any_position(arm):
    """At least a quarter of the effort, half the servos' stall torque, is left."""
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
