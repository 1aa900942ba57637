import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget

Z = np.array([0.0, 0.0, 1.0])
angles = st.floats(0.0, 3.0)
unit = st.floats(-1.0, 1.0)
vectors = st.tuples(unit, unit, unit).map(np.array)
poses = st.builds(
    lambda rpy, p: RigidTransform(RollPitchYaw(*rpy), p), vectors, vectors
)


@given(poses)
def test_a_pose_meets_its_own_target(X_WG):
    target = HandTarget.from_pose(X_WG)
    assert target.distance(X_WG) == 0.0
    assert target.angle_violation(X_WG) == 0.0


@given(poses, vectors, vectors)
def test_a_shifted_target_is_as_far_away_as_it_was_shifted(X_WG, p_GT, shift):
    target = HandTarget(X_WG @ p_GT, p_GT=p_GT).shifted(shift)
    assert target.distance(X_WG) == pytest.approx(np.linalg.norm(shift), abs=1e-12)


@given(angles)
def test_an_orientation_is_violated_beyond_its_tolerance(angle):
    target = HandTarget(np.zeros(3), RotationMatrix(), angle_tolerance=0.1)
    X_WG = RigidTransform(RotationMatrix.MakeXRotation(angle), np.zeros(3))
    expected = max(0.0, angle - 0.1)
    assert target.angle_violation(X_WG) == pytest.approx(expected, abs=1e-9)


@given(angles, st.floats(-3.0, 3.0))
def test_an_axis_is_violated_beyond_its_angle_whatever_the_turn_about_it(lean, turn):
    target = HandTarget(np.zeros(3), axes=(AxisTarget(Z, Z, 0.2),))
    R_WG = RotationMatrix.MakeXRotation(lean) @ RotationMatrix.MakeZRotation(turn)
    X_WG = RigidTransform(R_WG, np.zeros(3))
    expected = max(0.0, lean - 0.2)
    assert target.angle_violation(X_WG) == pytest.approx(expected, abs=1e-9)


def test_the_worst_of_several_axes_counts():
    axes = (AxisTarget(Z, Z, 0.2), AxisTarget(Z, np.array([1.0, 0.0, 0.0]), 0.5))
    target = HandTarget(np.zeros(3), axes=axes)
    assert target.angle_violation(RigidTransform()) == pytest.approx(np.pi / 2 - 0.5)


def test_a_point_alone_leaves_the_orientation_free():
    X_WG = RigidTransform(RotationMatrix.MakeYRotation(2.0), [1.0, 2.0, 3.0])
    assert HandTarget(X_WG.translation()).angle_violation(X_WG) == 0.0
