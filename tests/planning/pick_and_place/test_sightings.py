import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.common.geometry import ConvexPieces
from drake_srg.planning.pick_and_place.sightings import (
    PickTask,
    Sightings,
    View,
    distance,
    lean,
    set_down_at,
    standing_at,
)
from drake_srg.types import BlobFlag, Box, Obstacle, Sphere
from planning.planning_world import CAN, CUP, blob

UP = np.array([0.0, 0.0, 1.0])
angles = st.floats(-np.pi, np.pi)


def leaning(degrees):
    angle = np.deg2rad(degrees)
    return np.array([np.sin(angle), 0.0, np.cos(angle)])


def sightings(shape=CAN, within=5.0):
    task = PickTask("can", shape, RigidTransform(), obstacles={"cup": CUP})
    return Sightings(task, np.deg2rad(within))


def test_the_best_blob_is_one_without_flags():
    doubtful = dc.replace(
        blob([0, 0, 0], quality=1.0), flags=frozenset({BlobFlag.OCCLUDED})
    )
    plain = blob([1, 0, 0], quality=0.5)
    assert sightings().best(View([doubtful, plain])) is plain
    assert sightings().best(View([doubtful])) is doubtful
    assert sightings().best(View([blob([0, 0, 0], name="cup")])) is None


def test_a_partly_hidden_blob_is_better_than_an_uncertain_one():
    hidden, uncertain = (
        dc.replace(blob([0, 0, 0], quality=quality), flags=frozenset({flag}))
        for quality, flag in ((0.4, BlobFlag.OCCLUDED), (0.9, BlobFlag.UNCERTAIN))
    )
    assert sightings().best(View([uncertain, hidden])) is hidden


def test_a_blob_that_fits_the_shape_is_better_than_one_in_full_view():
    hidden = dc.replace(
        blob([0, 0, 0], quality=0.5), flags=frozenset({BlobFlag.OCCLUDED}), misfit=0.01
    )
    whole = dc.replace(blob([1, 0, 0], quality=0.9), misfit=0.05)
    assert sightings().best(View([whole, hidden])) is hidden


def test_the_nearest_blob_is_chosen_however_bad_it_looks():
    uncertain = frozenset({BlobFlag.UNCERTAIN})
    here = dc.replace(blob([0.01, 0, 0], quality=0.2), flags=uncertain, misfit=0.6)
    twin = blob([0.2, 0, 0], quality=1.0)
    cup = blob([0, 0, 0], name="cup")
    assert sightings().nearest(View([twin, cup, here]), np.zeros(3)) is here
    assert sightings().best(View([twin, cup, here])) is twin
    assert sightings().nearest(View([cup]), np.zeros(3)) is None


@pytest.mark.parametrize(
    ("degrees", "stands"), [(0.0, True), (4.0, True), (6.0, False)]
)
def test_an_object_that_hardly_leans_stands_upright(degrees, stands):
    X_WO = sightings().pose(blob([0.1, 0.2, 0.3], axis=leaning(degrees)))
    np.testing.assert_array_equal(X_WO.translation(), [0.1, 0.2, 0.3])
    axis = X_WO.rotation().col(2)
    np.testing.assert_allclose(axis, UP if stands else leaning(degrees), atol=1e-12)


def test_a_ball_is_upright_whatever_its_axis():
    X_WO = sightings(Sphere(0.03)).pose(blob([0, 0, 0], axis=leaning(70.0)))
    np.testing.assert_allclose(X_WO.rotation().col(2), UP)


def test_obstacles_are_other_objects_and_unknown_boxes():
    seen = [blob([0, 0, 0]), blob([1, 0, 0], name="cup"), blob([2, 0, 0], name="fork")]
    unknown = Obstacle(Box(), RigidTransform([3, 0, 0]))
    (cup, X_WO), box = sightings().obstacles(View(seen, [unknown]))
    assert cup is CUP
    np.testing.assert_array_equal(X_WO.translation(), [1, 0, 0])
    assert box == (unknown.shape, unknown.X_WO)


def test_a_line_has_no_sign():
    assert lean(UP, -leaning(30.0)) == pytest.approx(np.deg2rad(30.0))
    assert lean(UP, -UP) == 0.0


@given(
    st.sampled_from([(0, 0), (1, 0), (2, 0), (3, 0), (0, 1), (0, 3)]),
    st.floats(-np.pi, np.pi),
    st.floats(-0.06, 0.06),
    st.floats(-0.06, 0.06),
)
def test_the_nearly_level_face_of_a_box_is_level_and_its_yaw_stays(
    quarters, yaw, roll, pitch
):
    roll_0, pitch_0 = 0.5 * np.pi * np.array(quarters)
    level = RotationMatrix.MakeZRotation(yaw) @ RotationMatrix(
        RollPitchYaw(roll_0, pitch_0, 0.0)
    )
    tilt = RotationMatrix(RollPitchYaw(roll, pitch, 0.0))
    seen = dc.replace(blob([0.5, 0, 0]), X_WO=RigidTransform(tilt @ level, [0.5, 0, 0]))
    X_WO = sightings(Box([0.05, 0.06, 0.1])).pose(seen)
    assert np.abs(X_WO.rotation().matrix()[2]).max() == pytest.approx(1.0, abs=1e-12)
    error = (level.inverse() @ X_WO.rotation()).ToAngleAxis().angle()
    assert error < 0.06**2  # of the order of the product of the tilts
    np.testing.assert_array_equal(X_WO.translation(), [0.5, 0.0, 0.0])


def test_a_box_that_leans_on_something_leans():
    R_WO = RotationMatrix(RollPitchYaw(0.2, 0.0, 0.3))
    seen = dc.replace(blob([0.5, 0, 0]), X_WO=RigidTransform(R_WO, [0.5, 0, 0]))
    pose = sightings(Box([0.05, 0.06, 0.1])).pose(seen)
    assert pose.IsNearlyEqualTo(seen.X_WO, 1e-12)


# Solids, such as a box with a knob at its side.

CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)])
BOX = CUBE * [0.06, 0.04, 0.1]
KNOB = CUBE * [0.02, 0.02, 0.02] + [0.04, 0.0, 0.05]
THING = ConvexPieces((BOX, KNOB))  # its origin is underneath it
GOAL = RigidTransform([0.5, -0.4, 0.2])


def pose_of(X_WO):
    return sightings(THING).pose(dc.replace(blob([0, 0, 0]), X_WO=X_WO))


@given(st.sampled_from(THING.resting), angles, st.floats(-0.06, 0.06), angles)
def test_a_solid_that_nearly_rests_on_a_face_does(down, yaw, lean, way):
    level = RotationMatrix.MakeFromOneVector(-down, 2).inverse()
    axis = np.array([np.cos(way), np.sin(way), 0.0])
    leaning = RotationMatrix(RollPitchYaw(lean * axis)) @ level
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(yaw) @ leaning, [0.5, 0.1, 0.2])
    pose = pose_of(X_WO)
    np.testing.assert_allclose(pose.translation(), X_WO.translation())
    np.testing.assert_allclose(pose.rotation() @ down, -UP, atol=1e-6)


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
    # Its lowest point is at the height of the goal.
    lowest = (goal @ THING.corners.T)[2].min()
    assert lowest == pytest.approx(GOAL.translation()[2])
    # With its own upright pose as the goal, it stays where it is.
    assert set_down_at(standing_at(X_WO, THING), X_WO, THING).IsNearlyEqualTo(
        X_WO, 1e-9
    )


def test_simple_shapes_are_set_upright():
    lying = RigidTransform(RollPitchYaw(1.5, 0.0, 0.0), [0.5, 0.1, 0.2])
    assert set_down_at(GOAL, lying, CAN) is GOAL


def test_poses_in_which_a_solid_looks_alike_are_near():
    there = RigidTransform([0.5, 0.1, 0.2])
    turned = RigidTransform(RollPitchYaw(0.0, 0.0, 2.0), [0.5, 0.1, 0.2])
    assert distance(there, turned, THING) == 0.0
    # Upside down, about its middle.
    about = RigidTransform(THING.middle)
    flip = RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), np.zeros(3))
    flipped = there @ about @ flip @ about.inverse()
    assert distance(there, flipped, THING) == pytest.approx(0.0, abs=1e-12)
    assert distance(there, flipped, CAN) == pytest.approx(0.1)
