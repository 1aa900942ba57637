from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from scipy.linalg import expm

from drake_srg.parsing import configure_parser
from drake_srg.theses.arm_kinematics import (
    ASSISTIVE_ARM_HOME,
    ASSISTIVE_ARM_HOME_PRINTED,
    ASSISTIVE_ARM_HOME_SECTION_4_4_3,
    ASSISTIVE_ARM_SCREWS,
    ASSISTIVE_ARM_SCREWS_PRINTED,
    euler_angles,
    euler_rotation,
    forward_kinematics,
    screw_exponential,
)

SEED = 20240607
angle = st.floats(-4, 4)
coordinate = st.floats(-1, 1)
# Unit vectors from spherical coordinates.
direction = st.tuples(angle, st.floats(-1.5, 1.5)).map(
    lambda a: np.array(
        [np.cos(a[0]) * np.cos(a[1]), np.sin(a[0]) * np.cos(a[1]), np.sin(a[1])]
    )
)
point = st.tuples(coordinate, coordinate, coordinate).map(np.array)


@pytest.fixture(scope="module")
def arm():
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    configure_parser(parser)
    parser.AddModelsFromUrl("package://drake_srg/sdf/assistive_arm.sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant


def test_forward_kinematics_match_the_example_of_the_thesis():
    q = np.radians([10, 20, 30, 40, 50])
    X = forward_kinematics(ASSISTIVE_ARM_SCREWS_PRINTED, ASSISTIVE_ARM_HOME_PRINTED, q)
    angles = np.degrees(euler_angles(X[:3, :3]))
    np.testing.assert_allclose(angles, [-136.3074, -68.1808, -108.777], atol=1e-4)


def test_the_thesis_used_the_home_pose_of_its_appendix():
    home = ASSISTIVE_ARM_HOME_SECTION_4_4_3
    q = np.radians([10, 20, 30, 40, 50])
    X = forward_kinematics(ASSISTIVE_ARM_SCREWS_PRINTED, home, q)
    angles = np.degrees(euler_angles(X[:3, :3]))
    np.testing.assert_allclose(angles, [-136.570, -68.147, -109.021], atol=1e-3)


@given(st.tuples(angle, angle, angle))
def test_euler_rotations_are_products_of_turns_about_x_y_and_z(angles):
    x, y, z = angles
    R = (
        RotationMatrix.MakeXRotation(x)
        @ RotationMatrix.MakeYRotation(y)
        @ RotationMatrix.MakeZRotation(z)
    )
    np.testing.assert_allclose(euler_rotation(angles), R.matrix(), atol=1e-14)


def test_the_plant_agrees_with_the_product_of_exponentials(arm):
    context = arm.CreateDefaultContext()
    tip = arm.GetFrameByName("tip")
    rng = np.random.default_rng(SEED)
    for q in rng.uniform(-np.pi, np.pi, (1000, 5)):
        arm.SetPositions(context, q)
        X_BT = tip.CalcPoseInWorld(context).GetAsMatrix4()
        expected = forward_kinematics(ASSISTIVE_ARM_SCREWS, ASSISTIVE_ARM_HOME, q)
        np.testing.assert_allclose(X_BT, expected, rtol=0, atol=1e-9)


def test_joint_4_as_printed_is_in_another_place():
    q = np.array([0, 0, 0, 0.5, 0])
    printed, corrected = (
        forward_kinematics(screws, ASSISTIVE_ARM_HOME, q)
        for screws in (ASSISTIVE_ARM_SCREWS_PRINTED, ASSISTIVE_ARM_SCREWS)
    )
    np.testing.assert_array_equal(printed[:3, :3], corrected[:3, :3])
    assert np.linalg.norm(printed[:3, 3] - corrected[:3, 3]) > 0.05


def test_the_home_pose_is_the_printed_one_up_to_rounding_and_the_plane_of_the_arm():
    difference = ASSISTIVE_ARM_HOME - ASSISTIVE_ARM_HOME_PRINTED
    difference[1, 3] = 0.0
    assert np.max(np.abs(difference)) < 5e-5  # the print's last digit
    R = ASSISTIVE_ARM_HOME[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)


@pytest.mark.slow
@given(direction, point, angle)
def test_the_exponential_of_a_screw_is_that_of_its_matrix(w, p, theta):
    v = -np.cross(w, p)
    W = np.zeros((4, 4))
    W[:3, :3] = np.cross(np.eye(3), w)
    W[:3, 3] = v
    T = screw_exponential([*w, *v], theta)
    np.testing.assert_allclose(T, expm(W * theta), atol=1e-12)
    # Points on the axis do not move.
    np.testing.assert_allclose(T @ [*p, 1], [*p, 1], atol=1e-12)


@given(direction, coordinate)
def test_prismatic_joints_move_along_their_direction(v, distance):
    T = screw_exponential([0, 0, 0, *v], distance)
    np.testing.assert_array_equal(T[:3, :3], np.eye(3))
    np.testing.assert_allclose(T[:3, 3], distance * v, atol=1e-15)


@pytest.mark.parametrize("screw", ([0, 0, 2, 0, 0, 0], [0] * 6, [0, 0, 0, 0, 0.5, 0]))
def test_a_screw_needs_a_direction_of_unit_length(screw):
    with pytest.raises(ValueError, match="unit length"):
        screw_exponential(screw, 1.0)


def test_each_axis_needs_a_position():
    with pytest.raises(ValueError, match="shorter"):
        forward_kinematics(ASSISTIVE_ARM_SCREWS, ASSISTIVE_ARM_HOME, np.zeros(4))


def rotation(x, y, z):
    R = (
        RotationMatrix.MakeXRotation(x)
        @ RotationMatrix.MakeYRotation(y)
        @ RotationMatrix.MakeZRotation(z)
    )
    return R.matrix()


def at_gimbal_lock(x, sign, z):
    """The rotation with y = sign * 90 degrees exactly, so that |R13| is 1."""
    R_y = np.array([[0.0, 0.0, sign], [0.0, 1.0, 0.0], [-sign, 0.0, 0.0]])
    return rotation(x, 0.0, 0.0) @ R_y @ rotation(0.0, 0.0, z)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_euler_angles_invert_the_product_of_rotations(x, y, z):
    R = rotation(x, y, z)
    np.testing.assert_allclose(euler_angles(R), [x, y, z], atol=1e-9)


@given(st.floats(-3.1, 3.1), st.sampled_from([-1, 1]), st.floats(-3.1, 3.1))
def test_euler_angles_reconstruct_the_rotation_at_gimbal_lock(x, sign, z):
    R = at_gimbal_lock(x, sign, z)
    np.testing.assert_allclose(rotation(*euler_angles(R)), R, atol=1e-12)


@given(
    st.floats(-3.1, 3.1),
    st.sampled_from([-1, 1]),
    st.sampled_from([0.0, 1e-16, 1e-12, 1e-9, 1e-8, 1e-7, 1e-5, 1e-3]),
    st.floats(-3.1, 3.1),
)
def test_euler_angles_reconstruct_the_rotation_near_gimbal_lock(x, sign, off, z):
    R = rotation(x, sign * (np.pi / 2 - off), z)
    # An arcsine near 1 resolves 1.5e-8 rad.
    np.testing.assert_allclose(rotation(*euler_angles(R)), R, atol=3e-8)


def test_at_gimbal_lock_x_is_zero_and_z_takes_the_whole_turn():
    for sign in (-1, 1):
        R = at_gimbal_lock(0.1, sign, 0.2)
        expected = [0.0, sign * np.pi / 2, 0.2 + sign * 0.1]
        np.testing.assert_allclose(euler_angles(R), expected, atol=1e-12)
