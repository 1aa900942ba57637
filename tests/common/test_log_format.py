import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.common.log_format import (
    MODES,
    is_pose,
    logged_modes,
    mode_columns,
    pose_key,
    pose_to_row,
    row_to_pose,
)
from drake_srg.types import Mode


def test_poses_are_told_from_other_signals():
    assert pose_key("can") == "object_pose.can"
    assert is_pose(pose_key("can"))
    assert not is_pose("object_speed.can")


numbers = st.floats(-3.0, 3.0)


@given(st.tuples(numbers, numbers, numbers), st.tuples(numbers, numbers, numbers))
def test_a_row_holds_a_pose(rpy, p):
    X = RigidTransform(RollPitchYaw(rpy), p)
    row = pose_to_row(X)
    np.testing.assert_array_equal(row[:3], p)
    assert row_to_pose(row).IsNearlyEqualTo(X, 1e-12)
    # Resampled or rounded quaternions are not of unit length.
    scaled = row * [1, 1, 1, 1.01, 1.01, 1.01, 1.01]
    assert row_to_pose(scaled).IsNearlyEqualTo(X, 1e-12)


def test_the_quaternion_starts_with_w():
    half_turn = RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(
        np.abs(pose_to_row(half_turn)), [1, 2, 3, 0, 1, 0, 0], atol=1e-12
    )


def test_modes_have_the_order_of_a_cycle():
    assert list(Mode) == MODES


def test_a_log_of_our_modes_holds_only_their_index():
    columns = mode_columns([Mode.IDLE, Mode.LIFT])
    assert list(columns) == ["mode"]
    assert columns["mode"].tolist() == [0.0, float(MODES.index(Mode.LIFT))]
    assert logged_modes(columns) == ["idle", "lift"]


def test_own_modes_are_numbered_on_and_named():
    columns = mode_columns([Mode.IDLE, "shake", "lift", "wait", "shake"])
    first, lift = len(MODES), MODES.index(Mode.LIFT)
    assert columns["mode"].tolist() == [0, first, lift, first + 1, first]
    assert logged_modes(columns) == ["idle", "shake", "lift", "wait", "shake"]
