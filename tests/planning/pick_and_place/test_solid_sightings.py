"""The planner's reading of sightings of solids, such as a box with a knob at its
side."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.common.geometry import ConvexPieces
from drake_srg.planning.pick_and_place.sightings import (
    PickTask,
    Sightings,
    distance,
    set_down_at,
    standing_at,
)
from drake_srg.types import Blob, Cylinder

CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)])
BOX = CUBE * [0.06, 0.04, 0.1]
KNOB = CUBE * [0.02, 0.02, 0.02] + [0.04, 0.0, 0.05]
THING = ConvexPieces((BOX, KNOB))  # its origin is underneath it
GOAL = RigidTransform([0.5, -0.4, 0.2])
GRAVITY = np.array([0.0, 0.0, -1.0])

angles = st.floats(-np.pi, np.pi)


def pose_of(X_WO):
    sightings = Sightings(PickTask("thing", THING, GOAL), 0.1)
    return sightings.pose(Blob("thing", "ceiling", (0.0, 0.0), X_WO, 1.0))


@given(st.sampled_from(THING.resting), angles, st.floats(-0.06, 0.06), angles)
def test_a_solid_that_nearly_rests_on_a_face_does(down, yaw, lean, way):
    level = RotationMatrix.MakeFromOneVector(-down, 2).inverse()
    axis = np.array([np.cos(way), np.sin(way), 0.0])
    leaning = RotationMatrix(RollPitchYaw(lean * axis)) @ level
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(yaw) @ leaning, [0.5, 0.1, 0.2])
    pose = pose_of(X_WO)
    np.testing.assert_allclose(pose.translation(), X_WO.translation())
    np.testing.assert_allclose(pose.rotation() @ down, GRAVITY, atol=1e-6)


def test_a_solid_that_leans_against_something_is_where_it_is_seen():
    X_WO = RigidTransform(RollPitchYaw(0.5, 0.0, 0.2), [0.5, 0.1, 0.2])
    assert pose_of(X_WO).IsExactlyEqualTo(X_WO)


@given(st.sampled_from(THING.resting), angles)
def test_a_solid_is_set_down_on_the_side_on_which_it_lies(down, yaw):
    R_WO = RotationMatrix.MakeFromOneVector(-down, 2).inverse()
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(yaw) @ R_WO, [0.5, 0.1, 3.0])
    goal = set_down_at(GOAL, X_WO, THING)
    np.testing.assert_array_equal(goal.rotation().matrix(), X_WO.rotation().matrix())
    np.testing.assert_allclose(goal.translation()[:2], GOAL.translation()[:2])
    # What the upright one stands on is as high.
    lowest = (goal @ THING.corners.T)[2].min()
    assert lowest == pytest.approx(GOAL.translation()[2])
    # Its goal upright is as high as what it is on now.
    assert set_down_at(standing_at(X_WO, THING), X_WO, THING).IsNearlyEqualTo(
        X_WO, 1e-9
    )


def test_simple_shapes_are_set_upright():
    lying = RigidTransform(RollPitchYaw(1.5, 0.0, 0.0), [0.5, 0.1, 0.2])
    assert set_down_at(GOAL, lying, Cylinder(0.03, 0.1)) is GOAL


def test_poses_in_which_a_solid_looks_alike_are_near():
    there = RigidTransform([0.5, 0.1, 0.2])
    turned = RigidTransform(RollPitchYaw(0.0, 0.0, 2.0), [0.5, 0.1, 0.2])
    assert distance(there, turned, THING) == 0.0
    # Upside down, about its middle.
    about = RigidTransform(THING.middle)
    flip = RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), np.zeros(3))
    flipped = there @ about @ flip @ about.inverse()
    assert distance(there, flipped, THING) == pytest.approx(0.0, abs=1e-12)
    upright = Cylinder(0.03, 0.1)
    assert distance(there, flipped, upright) == pytest.approx(0.1)
