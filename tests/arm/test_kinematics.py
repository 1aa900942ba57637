from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.arm.kinematics import (
    ASSISTIVE_ARM_HOME,
    ASSISTIVE_ARM_HOME_PRINTED,
    ASSISTIVE_ARM_SCREWS,
    ASSISTIVE_ARM_SCREWS_PRINTED,
    EulerAngles,
    ForwardKinematics,
    ScrewExponential,
)
from drake_srg.parsing import configure_parser

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


def test_the_thesis_checks_its_forward_kinematics_so():
    q = np.radians([10, 20, 30, 40, 50])
    X = ForwardKinematics(ASSISTIVE_ARM_SCREWS_PRINTED, ASSISTIVE_ARM_HOME_PRINTED, q)
    angles = np.degrees(EulerAngles(X[:3, :3]))
    np.testing.assert_allclose(angles, [-136.3074, -68.1808, -108.777], atol=1e-4)


def test_plant_agrees_with_the_product_of_exponentials(arm):
    context = arm.CreateDefaultContext()
    tip = arm.GetFrameByName("tip")
    rng = np.random.default_rng(SEED)
    for q in rng.uniform(-np.pi, np.pi, (1000, 5)):
        arm.SetPositions(context, q)
        X_BT = tip.CalcPoseInWorld(context).GetAsMatrix4()
        expected = ForwardKinematics(ASSISTIVE_ARM_SCREWS, ASSISTIVE_ARM_HOME, q)
        np.testing.assert_allclose(X_BT, expected, rtol=0, atol=1e-9)


def test_joint_4_as_printed_is_elsewhere():
    q = np.array([0, 0, 0, 0.5, 0])
    printed, corrected = (
        ForwardKinematics(screws, ASSISTIVE_ARM_HOME, q)
        for screws in (ASSISTIVE_ARM_SCREWS_PRINTED, ASSISTIVE_ARM_SCREWS)
    )
    np.testing.assert_array_equal(printed[:3, :3], corrected[:3, :3])
    assert np.linalg.norm(printed[:3, 3] - corrected[:3, 3]) > 0.05


def test_home_is_the_printed_one_up_to_rounding_and_place():
    difference = ASSISTIVE_ARM_HOME - ASSISTIVE_ARM_HOME_PRINTED
    difference[1, 3] = 0.0
    assert np.max(np.abs(difference)) < 5e-5  # the print's last digit
    R = ASSISTIVE_ARM_HOME[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)


@given(direction, point, angle)
def test_exponential_of_a_screw(w, p, theta):
    expm = pytest.importorskip("scipy.linalg").expm
    v = -np.cross(w, p)
    W = np.zeros((4, 4))
    W[:3, :3] = np.cross(np.eye(3), w)
    W[:3, 3] = v
    T = ScrewExponential([*w, *v], theta)
    np.testing.assert_allclose(T, expm(W * theta), atol=1e-12)
    # Points of the axis stay.
    np.testing.assert_allclose(T @ [*p, 1], [*p, 1], atol=1e-12)


@given(direction, coordinate)
def test_prismatic_joints_move_along_their_direction(v, distance):
    T = ScrewExponential([0, 0, 0, *v], distance)
    np.testing.assert_array_equal(T[:3, :3], np.eye(3))
    np.testing.assert_allclose(T[:3, 3], distance * v, atol=1e-15)


@pytest.mark.parametrize("screw", ([0, 0, 2, 0, 0, 0], [0] * 6, [0, 0, 0, 0, 0.5, 0]))
def test_screws_have_a_unit_direction(screw):
    with pytest.raises(ValueError, match="unit length"):
        ScrewExponential(screw, 1.0)


def test_positions_are_as_many_as_axes():
    with pytest.raises(ValueError, match="shorter"):
        ForwardKinematics(ASSISTIVE_ARM_SCREWS, ASSISTIVE_ARM_HOME, np.zeros(4))


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_euler_angles_round_trip(x, y, z):
    R = (
        RotationMatrix.MakeXRotation(x)
        @ RotationMatrix.MakeYRotation(y)
        @ RotationMatrix.MakeZRotation(z)
    )
    np.testing.assert_allclose(EulerAngles(R.matrix()), [x, y, z], atol=1e-9)
