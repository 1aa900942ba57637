from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.motion.follow import follow
from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget

unit = st.floats(-1.0, 1.0)


@settings(max_examples=40, deadline=None)
@given(st.lists(unit, min_size=6, max_size=6))
def test_it_meets_a_near_pose_exactly_and_stays_near(iiwa, shift):
    home = np.array([0.0, -0.1, 0.0, -1.9, 0.0, 1.3, 0.0])
    turn = RotationMatrix.MakeXRotation(0.1 * shift[3]).multiply(
        RotationMatrix.MakeYRotation(0.1 * shift[4])
    )
    near = RigidTransform(turn, 0.02 * np.array(shift[:3]))
    target = HandTarget.from_pose(iiwa.X_WG(home) @ near)
    q = follow(iiwa, target, home)
    assert target.distance(iiwa.X_WG(q)) < 2e-6
    assert target.angle_violation(iiwa.X_WG(q)) == 0.0
    assert np.max(np.abs(q - home)) < 0.4


def test_it_stops_a_joint_at_its_limit_and_goes_on_with_the_others(iiwa, home):
    q = home.copy()
    q[6] = iiwa.upper[6] - 0.03
    target = HandTarget.from_pose(
        iiwa.X_WG(q) @ RigidTransform(RotationMatrix.MakeXRotation(0.03), np.zeros(3))
    )
    found = follow(iiwa, target, q)
    # Without the limit, joint 7 does nearly all of the turn about its own axis.
    assert iiwa.upper[6] - 0.021 < found[6] <= iiwa.upper[6] - 0.02 + 1e-9
    assert target.distance(iiwa.X_WG(found)) < 2e-6


def test_it_returns_none_out_of_reach(iiwa, home):
    assert follow(iiwa, HandTarget(np.array([2.0, 0.0, 0.0])), home) is None


def test_it_turns_an_axis_only_as_far_as_its_angle(iiwa, home):
    X_WG = iiwa.X_WG(home)
    tilted = X_WG.rotation().matrix()[:, 0] + np.array([0.3, 0.0, 0.0])
    axis = AxisTarget(np.array([1.0, 0.0, 0.0]), tilted / np.linalg.norm(tilted), 0.1)
    target = HandTarget(iiwa.X_WG(home).translation(), axes=(axis,))
    q = follow(iiwa, target, home)
    X_WG = iiwa.X_WG(q)
    assert target.distance(X_WG) < 2e-6
    angle = np.arccos(X_WG.rotation().matrix()[:, 0] @ axis.direction_W)
    assert angle == pytest.approx(0.1, abs=1e-4)
