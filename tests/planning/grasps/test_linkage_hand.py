import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.grasps.grasps import pose_along
from drake_srg.planning.grasps.linkage_hand import (
    EMPTY_ANGLE,
    LinkageFingers,
    LinkageHand,
    crank_angle,
)
from drake_srg.types import Box, Cylinder, Sphere
from planning.grasps.held_object import link_distances

UP = np.array([0.0, 0.0, 1.0])
UPRIGHT = RigidTransform()
HAND = LinkageHand(p_GT=np.array([0.095, 0.0, 0.0]))
CYLINDER = Cylinder(0.0125, 0.05)
FINGERS = LinkageFingers()
OFFSETS = 0.001 * np.arange(-70, 71.0)


@pytest.mark.parametrize("model", ["linkage_gripper", "linkage_gripper_flat"])
def test_only_the_pads_touch_the_cylinder_on_both_sides(model):
    (grasp,) = HAND.grasps(CYLINDER, UPRIGHT)
    distances = link_distances(model, CYLINDER, grasp, grasp.fingers_closed)
    tips = {name: d for name, d in distances.items() if "tip" in name}
    assert len(tips) == 2
    for name, distance in distances.items():
        if name in tips:
            # Boxes approximate the arc of a curved pad within 0.2 mm.
            assert distance == pytest.approx(0.0, abs=3e-4)
        else:
            assert distance > 0.002


@pytest.mark.parametrize("model", ["linkage_gripper", "linkage_gripper_flat"])
@pytest.mark.parametrize("radius", [0.006, 0.0125, 0.02])
def test_the_open_hand_goes_around_the_object(model, radius):
    shape = Cylinder(radius, 0.05)
    (grasp,) = HAND.grasps(shape, UPRIGHT)
    distances = link_distances(model, shape, grasp, grasp.fingers_open)
    assert min(distances.values()) > 0.007


@given(st.floats(-np.pi, np.pi), st.floats(-0.25, 0.25))
def test_a_lying_cylinder_is_taken_from_above_though_turned(azimuth, across):
    axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    X_WO = pose_along([0.3, 0.1, 0.1125], axis)
    (grasp,) = HAND.grasps(CYLINDER, X_WO)
    assert grasp.closure_open == 0.0
    # The palm is above it and looks down; its z is turned from the axis.
    z = np.array([np.cos(azimuth + across), np.sin(azimuth + across), 0.0])
    R_WG = RotationMatrix(np.column_stack([-UP, np.cross(z, -UP), z]))
    X_WG = RigidTransform(R_WG, X_WO.translation() - R_WG @ grasp.p_GO)
    target = grasp.pick_target(X_WO)
    assert target.distance(X_WG) == pytest.approx(0.0, abs=1e-12)
    assert target.angle_violation(X_WG) == 0.0
    leaning = X_WG @ RigidTransform(RotationMatrix.MakeYRotation(0.01), np.zeros(3))
    assert target.angle_violation(leaning) > 0.0
    # It is set down as it is held, along the pads.
    if abs(across) > 0.002:
        assert grasp.target(X_WO).angle_violation(X_WG) > 0.0


def test_a_turned_cylinder_fits_between_the_open_pads():
    X_WO = pose_along(np.zeros(3), [1.0, 0.0, 0.0])
    for radius in (0.006, 0.0125, 0.018, 0.026):
        (grasp,) = HAND.grasps(Cylinder(radius, 0.05), X_WO)
        # At the ends of the pads, which are 24 mm long, half the gap is 30 mm.
        half = radius / np.cos(grasp.pick_angle) + 0.012 * np.tan(grasp.pick_angle)
        assert half < 0.03


@given(radius=st.floats(0.005, 0.026))
def test_the_crank_angle_tells_an_object_from_an_empty_hand(radius):
    (grasp,) = HAND.grasps(Cylinder(radius, 0.05), UPRIGHT)
    proximity = np.zeros(2)
    assert grasp.holds(np.full(2, crank_angle(radius)), proximity)
    assert not grasp.holds(np.full(2, EMPTY_ANGLE), proximity)
    assert 0.0 <= grasp.closure_open < grasp.closure_closed == 1.0


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 1))
def test_a_reached_target_holds_the_object_along_its_axis(x, y, z):
    (grasp,) = HAND.grasps(CYLINDER, UPRIGHT)
    axis = np.array([x, y, z]) / np.linalg.norm([x, y, z])

    X_WO = pose_along([0.3, 0.1, 0.125], axis)
    X_WG = X_WO @ grasp.X_GO.inverse()
    target = grasp.target(X_WO)
    assert target.distance(X_WG) == pytest.approx(0.0, abs=1e-12)
    assert target.angle_violation(X_WG) == 0.0


@pytest.mark.parametrize(
    "shape",
    [Cylinder(0.001, 0.05), Cylinder(0.04, 0.05), Sphere(0.0125), Box([0.02] * 3)],
)
def test_an_object_that_does_not_fit_the_hand_has_no_grasp(shape):
    assert HAND.grasps(shape, UPRIGHT) == []


@given(half_gap=st.floats(0.005, 0.03))
def test_the_silhouette_of_the_open_hand(half_gap):
    reach = FINGERS.silhouette(half_gap, OFFSETS)
    assert reach.max() <= FINGERS.deepest + 1e-9
    between = np.abs(OFFSETS) < half_gap - 0.002
    np.testing.assert_allclose(reach[between], FINGERS.palm_x)
    assert reach[np.abs(OFFSETS) > half_gap + 0.022].max() <= FINGERS.palm_x


@given(width=st.floats(0.01, 0.05))
def test_wider_things_need_more_open_fingers(width):
    assert FINGERS.detectable(width)
    opened, closed = FINGERS.opened(0.5 * width + 0.003), FINGERS.closed(width)
    assert 0.0 <= opened.closure < closed.closure <= 1.0
    assert all(opened.joints[name] < closed.joints[name] for name in closed.joints)
    held = np.array(list(closed.joints.values()))[:2]
    assert FINGERS.holds(width, held, np.zeros(2))
    empty = FINGERS.closed(0.0).joints.values()
    assert not FINGERS.holds(width, np.array(list(empty))[:2], np.zeros(2))


def test_it_opens_to_its_stop_at_most():
    assert FINGERS.opened(0.1).closure == pytest.approx(0.0)
