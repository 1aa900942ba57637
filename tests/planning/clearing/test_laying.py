"""The way of the hand that lays a long load down."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.clearing.destination import Spot
from drake_srg.planning.clearing.laying import laying_targets
from drake_srg.planning.clearing.load import Load
from drake_srg.planning.grasps.top_grasp import palm_pose

OVER = np.array([0.3, -0.5, 0.6])  # the palm over the bin
PALM = 0.18  # above the underside of a load
BELOW = 0.02  # the grasp, above it


def way(yaw, middle, sag, ground=0.02, aside=(0.0, 0.0, 0.0), high=0.5):
    """Return the hand's poses, and the load."""
    load = Load(
        p_GC=np.zeros(3),
        below=BELOW,
        sag=sag,
        long=True,
        middle_G=np.array([0.0, 0.0, middle]),
    )
    targets = laying_targets(
        palm_pose(OVER, yaw), load, PALM, Spot(np.array(aside), ground), high
    )
    return [RigidTransform(t.R_WG, t.p_WT) for t in targets], load


yaws = st.floats(-np.pi, np.pi)
middles = st.floats(0.02, 0.12) | st.floats(-0.12, -0.02)


@given(yaws, middles, st.floats(0.02, 0.22))
def test_a_load_that_hangs_turns_about_the_end_it_stands_on(yaw, middle, sag):
    """The hand stays as far from that end as it was when the load hung straight."""
    _, *arc = way(yaw, middle, sag)[0]
    # The pivot: straight below the hand when it begins to turn, at the height of the
    # hand when the load lies.
    p_W = np.array([*arc[0].translation()[:2], arc[-1].translation()[2]])
    for X_WG in arc:
        apart = np.linalg.norm(X_WG.translation() - p_W)
        assert apart == pytest.approx(sag, abs=1e-9)


@given(yaws, middles, st.floats(0.02, 0.22), st.floats(0.0, 0.2))
def test_the_middle_of_the_load_lies_in_the_middle_of_its_lane(
    yaw, middle, sag, ground
):
    aside = np.array([0.05, -0.08, 0.0])
    poses, load = way(yaw, middle, sag, ground, aside)
    p_W = poses[-1].translation() + poses[-1].rotation() @ load.middle_G
    np.testing.assert_allclose(p_W[:2], (OVER + aside)[:2], atol=1e-9)
    underside = poses[-1].translation()[2] - PALM
    assert ground < underside < ground + 0.03


@given(yaws, middles, st.floats(0.02, 0.22))
def test_it_begins_high_and_only_goes_down_without_turning(yaw, middle, sag):
    poses, _ = way(yaw, middle, sag)
    heights = [X_WG.translation()[2] for X_WG in poses]
    assert heights[0] == pytest.approx(max(0.5, heights[1]))
    assert all(np.diff(heights) <= 1e-9)
    for X_WG in poses:
        R_error: RotationMatrix = X_WG.rotation() @ poses[0].rotation().inverse()
        assert R_error.ToAngleAxis().angle() < 1e-6


def test_the_far_end_of_the_load_does_not_hit_the_far_wall_when_it_lies():
    """A level load goes down as far to the side as the hanging one has to turn."""
    poses, _ = way(0.0, 0.1, 0.2)
    outward = poses[0].rotation().col(2)
    shifts = [(X.translation() - poses[-1].translation()) @ outward for X in poses]
    assert shifts[1] == pytest.approx(0.2)
    assert all(np.diff(shifts) <= 1e-9)


@given(yaws, st.floats(-0.1, 0.1), st.floats(0.0, 0.2))
def test_what_does_not_turn_goes_straight_down(yaw, middle, ground):
    high, low = way(yaw, middle, 0.0, ground)[0]
    np.testing.assert_allclose(low.translation()[:2], high.translation()[:2])
    assert low.translation()[2] == pytest.approx(ground + PALM + 0.02)
    assert high.translation()[2] >= low.translation()[2]
