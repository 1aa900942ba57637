import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.common.srg_geometry import SRG
from drake_srg.planning.grasps.srg_hand import (
    EMPTY_BASE_ANGLE,
    Approach,
    SrgFingers,
    SrgHand,
    finger_joints,
    wrap_angles,
)
from drake_srg.types import Box, Cylinder, Sphere
from planning.grasps.held_object import link_distances

FINGERS = SrgFingers()
OFFSETS = 0.001 * np.arange(-150, 151.0)


def ends(base):
    """Return half the gap and the reach of straight fingers' inner edges [m]."""
    length, face = SRG.finger_length, SRG.face_offset
    gap = SRG.hinge_y + length * np.cos(base) - face * np.sin(base)
    return gap, SRG.hinge_x + length * np.sin(base) + face * np.cos(base)


def angles(state):
    """Return the joint angles in the order of the driver's."""
    links, sides = ("base", "tip"), ("left", "right")
    return np.array([state.joints[f"{s}_{x}_joint"] for x in links for s in sides])


def test_the_deepest_point_of_closing_fingers():
    reach = ends(np.linspace(0.3, EMPTY_BASE_ANGLE, 2000))[1]
    np.testing.assert_allclose(reach.max(), FINGERS.deepest, atol=1e-6)


@given(half_gap=st.floats(0.01, 0.1))
def test_the_silhouette_of_the_open_hand(half_gap):
    base = FINGERS.opened(half_gap).joints["left_base_joint"]
    gap, reach = ends(base)
    np.testing.assert_allclose(gap, half_gap, atol=1e-9)
    seen = FINGERS.silhouette(half_gap, OFFSETS)
    assert reach - 1e-3 < seen.max() <= FINGERS.deepest + 1e-9
    assert (seen[np.abs(OFFSETS) < half_gap - 0.002] < reach).all()
    assert seen[len(OFFSETS) // 2] >= FINGERS.palm_x


@given(width=st.floats(0.008, 0.13))
def test_held_things_are_told_from_none(width):
    closed, empty = FINGERS.closed(width), FINGERS.closed(0.0)
    assert FINGERS.detectable(width)
    assert FINGERS.holds(width, angles(closed), np.zeros(4))
    assert not FINGERS.holds(width, angles(empty), np.zeros(4))


@pytest.mark.parametrize(
    "empty",
    [(1.777, 1.76, 0.0, 0.0), (1.714, 1.744, 0.066, 0.098), (1.617, 1.62, 0.3, 0.31)],
)
def test_an_empty_hand_whose_tips_have_turned_holds_nothing(empty):
    """Regression: a hand that had lost a tin went on to set it down."""
    assert not FINGERS.holds(0.084, np.array(empty), np.zeros(4))
    assert FINGERS.holds(0.084, np.array(empty) - [0.03, 0.03, 0.0, 0.0], np.zeros(4))


def test_the_thinnest_things_cannot_be_told():
    assert not FINGERS.detectable(0.001)


@given(width=st.floats(0.13, 0.165))
def test_wraps_press_harder_than_pinches(width):
    base, tip = wrap_angles(0.5 * width, FINGERS.wrap.gap)
    assert base == 0.0
    assert 0.8 < tip <= 0.5 * np.pi
    wrapped = FINGERS.wrapped(width)
    assert wrapped.closure * SRG.full_scale > base + tip + FINGERS.squeeze
    assert FINGERS.holds(width, angles(wrapped), np.zeros(4))
    assert FINGERS.opened(FINGERS.wrap.half_gap).closure >= 0.0


@given(width=st.floats(0.0, 0.13), half_gap=st.floats(0.01, 0.1))
def test_the_closed_command_closes(width, half_gap):
    assert FINGERS.opened(half_gap).closure < FINGERS.closed(width).closure <= 1.0


def test_straight_fingers_are_told_from_bent_ones():
    assert FINGERS.straight(np.array([1.5, 1.4, 0.0, 0.02]))
    assert not FINGERS.straight(np.array([1.5, 1.4, 0.0, 0.2]))


CAN = Cylinder(0.0339, 0.1018)
SQUEEZE = 0.4


def grasps_of(shape, approaches, tilts, squeeze):
    return SrgHand(approaches, tilts, squeeze).grasps(shape, RigidTransform())


def above(shape):
    (grasp,) = grasps_of(shape, ["above"], [], SQUEEZE)
    return grasp


def side(shape, tilt):
    (grasp,) = grasps_of(shape, ["side"], [tilt], SQUEEZE)
    return grasp


def when_closed(grasp, shape):
    """Return signed distances from the held object to the links [m]."""
    joints = finger_joints(grasp.base_angle, grasp.tip_angle)
    return link_distances("srg", shape, grasp, joints)


def when_open(grasp, shape):
    """Return the signed distances with open fingers [m]."""
    joints = finger_joints(3.0 * grasp.closure_open, 0.0)
    return link_distances("srg", shape, grasp, joints)


def assert_pinched(grasp, shape):
    """Assert that the pads touch, the palm does not, and open fingers let it pass."""
    distances = when_closed(grasp, shape)
    for link in ("left_tip_link", "right_tip_link"):
        # The planner's pads agree with the model's within a few tenths of a millimetre.
        assert distances[link] == pytest.approx(0.0, abs=1e-3)
    assert distances["palm"] > 0.01
    assert min(when_open(grasp, shape).values()) > 0.002


SHAPES = [CAN, Cylinder(0.028, 0.15), Sphere(0.033)]


@pytest.mark.parametrize("shape", SHAPES)
def test_from_above_the_pads_lie_on_the_sides(shape):
    assert_pinched(above(shape), shape)


@pytest.mark.parametrize("tilt", [0.0, 0.0873, 0.1745])
@pytest.mark.parametrize("shape", [CAN, Cylinder(0.03, 0.15)])
def test_from_the_side_base_and_tip_touch(shape, tilt):
    grasp = side(shape, tilt)
    distances = when_closed(grasp, shape)
    for finger, link in itertools.product(("left", "right"), ("base", "tip")):
        # A tilt makes an ellipse of the circle, off by less than 1.5 % of the radius.
        # The finger is 15 mm high each way, which is at most 15 mm tan(10 degrees).
        most = 1e-3 + 0.015 * np.tan(tilt)
        assert distances[f"{finger}_{link}_link"] == pytest.approx(0.0, abs=most)
    assert distances["palm"] > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
def test_the_open_hand_lets_the_object_pass(shape):
    for grasp in grasps_of(shape, ["above", "side"], [0.0, 0.1745], SQUEEZE):
        assert min(when_open(grasp, shape).values()) > 0.002


@given(radius=st.floats(0.02, 0.04), length=st.floats(0.05, 0.2))
@settings(max_examples=30)
def test_the_command_asks_for_contact_and_a_squeeze(radius, length):
    for grasp in grasps_of(Cylinder(radius, length), ["above", "side"], [0.1], SQUEEZE):
        asked = 3.0 * grasp.closure_closed
        expected = grasp.base_angle + grasp.tip_angle + SQUEEZE
        assert asked == pytest.approx(min(3.0, expected))
        assert 0.0 <= grasp.closure_open < grasp.closure_closed <= 1.0


@given(
    radius=st.floats(0.02, 0.04),
    tilt=st.floats(0.0, 0.5),
    yaw=st.floats(-3.0, 3.0),
)
@settings(max_examples=50)
def test_a_reached_target_holds_the_object_upright(radius, tilt, yaw):
    grasp = side(Cylinder(radius, 0.1), tilt)
    p_WO = np.array([0.5, 0.1, 0.05])
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(yaw), p_WO)
    X_WG = X_WO @ grasp.X_GO.inverse()
    target = grasp.target(RigidTransform(p_WO))
    assert target.distance(X_WG) == pytest.approx(0.0, abs=1e-12)
    assert target.angle_violation(X_WG) == 0.0
    # The palm's x points down by the tilt, and its y is level.
    x, y = X_WG.rotation().col(0), X_WG.rotation().col(1)
    assert x[2] == pytest.approx(-np.sin(tilt), abs=1e-12)
    assert y[2] == pytest.approx(0.0, abs=1e-12)


def box_grasps(size, X_WO=None, clearance=0.005):
    hand = SrgHand(["above", "side"], [0.1], SQUEEZE, clearance=clearance)
    return hand.grasps(Box(list(size)), X_WO or RigidTransform())


@given(
    st.tuples(st.floats(0.02, 0.1), st.floats(0.02, 0.1), st.floats(0.02, 0.2)),
    st.floats(-np.pi, np.pi),
)
@settings(max_examples=50)
def test_the_fingers_close_on_opposite_faces_of_a_box(size, yaw):
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(yaw), [0.5, 0.1, size[2] / 2])
    grasps = box_grasps(size, X_WO)
    assert len(grasps) == 4  # each pair of faces, with either finger on either face
    for grasp in grasps:
        X_WG = X_WO @ grasp.X_GO.inverse()
        assert grasp.pick_target(X_WO).distance(X_WG) == pytest.approx(0.0, abs=1e-12)
        assert grasp.pick_target(X_WO).angle_violation(X_WG) == 0.0
        # A turned hand misses the target of the pick, but not that of the place.
        turned = X_WG @ RigidTransform(RotationMatrix.MakeXRotation(0.1), np.zeros(3))
        assert grasp.pick_target(X_WO).angle_violation(turned) > 0.0
        assert grasp.target(X_WO).angle_violation(turned) == 0.0
    across = {tuple(np.round(g.X_GO.rotation().inverse().col(1), 6)) for g in grasps}
    assert len(across) == 4


@pytest.mark.slow
@pytest.mark.parametrize("size", [(0.05, 0.07, 0.1), (0.1, 0.03, 0.06)])
def test_the_pads_lie_on_the_faces_of_a_box(size):
    for grasp in box_grasps(size):
        assert_pinched(grasp, Box(list(size)))


def test_a_box_wider_than_the_hand_is_taken_by_its_narrow_side():
    assert {g.name for g in box_grasps([0.3, 0.06, 0.1])} == {
        "from above, across its y"
    }
    assert box_grasps([0.3, 0.3, 0.1]) == []


LYING = [Box([0.05, 0.06, 0.1]), Box([0.03, 0.05, 0.16]), CAN, Cylinder(0.02, 0.12)]


def lying(shape, roll, yaw):
    """Return a pose on the table with the z axis level."""
    R_WO = RotationMatrix(RollPitchYaw(roll, 0.5 * np.pi, yaw))
    height = shape.half_extent(R_WO.inverse() @ np.array([0.0, 0.0, 1.0]))
    return RigidTransform(R_WO, [0.5, 0.1, height])


@pytest.mark.slow
@pytest.mark.parametrize("shape", LYING)
@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_what_lies_is_taken_from_above_across_its_axis(shape, turns):
    X_WO = lying(shape, turns * 0.5 * np.pi, 0.4)
    grasps = SrgHand(["above"], [], SQUEEZE).grasps(shape, X_WO)
    assert grasps
    for grasp in grasps:
        # Pose of a hand that meets the target.
        down, axis = grasp.down_G, grasp.axis_G
        R_GT = np.column_stack([down, np.cross(axis, down), axis])
        z_W = X_WO.rotation().col(2)
        down_W = np.array([0.0, 0.0, -1.0])
        R_WT = np.column_stack([down_W, np.cross(z_W, down_W), z_W])
        R_WG = RotationMatrix(R_WT @ R_GT.T)
        X_WG = RigidTransform(R_WG, X_WO.translation() - R_WG @ grasp.p_GO)
        assert grasp.pick_target(X_WO).angle_violation(X_WG) < 1e-9
        if isinstance(shape, Box):  # the grasp knows how the box is turned
            assert (X_WG.inverse() @ X_WO).IsNearlyEqualTo(grasp.X_GO, 1e-9)
        # The fingers' ends keep clear of the table.
        assert_pinched(grasp, shape)
        ahead, edge = SRG.hinge_x + SRG.finger_length, 0.5 * SRG.pad_width
        corners = [X_WG @ np.array([ahead, 0.0, z]) for z in (-edge, edge)]
        assert min(corner[2] for corner in corners) > 0.005


def test_what_leans_is_not_taken():
    R_WO = RotationMatrix(RollPitchYaw(0.25 * np.pi, 0.0, 0.0))
    leaning = RigidTransform(R_WO, [0.5, 0.1, 0.07])
    assert SrgHand(["above"], [], SQUEEZE).grasps(CAN, leaning) == []


@given(st.floats(-np.pi, np.pi))
def test_a_box_stands_on_its_goal_turned_as_in_the_hand(yaw):
    grasp = box_grasps([0.05, 0.06, 0.1])[1]
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(yaw), [0.5, 0.1, 0.05])
    goal = RigidTransform([0.5, 0.1, 0.05])
    set_down = grasp.set_down(X_WO @ grasp.X_GO.inverse(), goal)
    assert set_down.IsNearlyEqualTo(X_WO, 1e-12)
    # A can's rotation about its axis is ignored.
    assert above(CAN).set_down(X_WO, goal) is goal


def test_a_tilted_object_violates_the_target():
    grasp = above(CAN)
    X_WO = RigidTransform(RotationMatrix.MakeXRotation(0.1), [0.5, 0.1, 0.05])
    violation = grasp.target(RigidTransform(X_WO.translation())).angle_violation(
        X_WO @ grasp.X_GO.inverse()
    )
    assert violation == pytest.approx(0.1 - 0.002, abs=1e-6)


def test_low_objects_are_taken_clear_of_the_table():
    grasp = above(Sphere(0.02))
    (bottom,) = grasp.X_GO.translation()[:1] + 0.02
    # Fingers straight ahead end 58.8 mm beyond the tip's hinge.
    assert bottom - (SRG.hinge_x + SRG.finger_length) >= 0.005 - 1e-9


def test_grasps_have_the_approaches_and_tilts_that_are_asked_for():
    both = grasps_of(CAN, ["above", "side"], [0.1, 0.2], SQUEEZE)
    assert [(g.approach, g.tilt) for g in both] == [
        (Approach.ABOVE, pytest.approx(np.pi / 2)),
        (Approach.SIDE, 0.1),
        (Approach.SIDE, 0.2),
    ]
    assert grasps_of(CAN, [], [0.1], SQUEEZE) == []
    assert [g.name for g in both] == [
        "from above",
        "from the side, 6 degrees down",
        "from the side, 11 degrees down",
    ]


@pytest.mark.parametrize("radius", [0.004, 0.0125, 0.02])
def test_thin_objects_are_pinched_by_straight_fingers(radius):
    shape = Cylinder(radius, 0.1)
    grasp = above(shape)
    assert grasp.tip_angle >= 0.0
    assert grasp.base_angle < EMPTY_BASE_ANGLE
    assert min(when_closed(grasp, shape).values()) == pytest.approx(0.0, abs=1.5e-3)


def test_the_fingertips_of_an_empty_hand_meet_at_the_published_angle():
    # The gap of straight fingers is 0.9 mm at 100.7 degrees (SAKE's URDF).
    assert np.rad2deg(EMPTY_BASE_ANGLE) == pytest.approx(100.7, abs=0.3)


@pytest.mark.parametrize("radius", [0.001, 0.085, 0.3])
def test_an_object_that_does_not_fit_the_hand_has_no_grasp(radius):
    assert grasps_of(Cylinder(radius, 0.1), ["above", "side"], [0.0], SQUEEZE) == []


@pytest.mark.parametrize("full_scale", [2.5, 3.5])
def test_commands_scale_with_the_full_scale_of_the_driver(full_scale):
    hands = [SrgHand(["above", "side"], [0.0], SQUEEZE, s) for s in (3.0, full_scale)]
    nominal, scaled = (hand.grasps(CAN, RigidTransform()) for hand in hands)
    for grasp, other in zip(nominal, scaled, strict=True):
        assert other.fingers_open == grasp.fingers_open
        assert other.fingers_closed == grasp.fingers_closed
        # The same angles, as fractions of another full scale.
        asked = full_scale * other.closure_open
        assert asked == pytest.approx(3.0 * grasp.closure_open)
        asked = full_scale * other.closure_closed
        assert asked == pytest.approx(min(full_scale, 3.0 * grasp.closure_closed))


def test_a_turn_that_counts_is_a_part_of_the_goal():
    X_WO = RigidTransform(RollPitchYaw(0.0, 0.0, 0.4), [0.5, 0.0, 0.05])
    box, can = Box([0.024, 0.024, 0.1]), Cylinder(0.012, 0.1)
    for counts in (False, True):
        hand = SrgHand(["above"], [], 0.4, turn_counts=counts)
        for grasp in hand.grasps(box, X_WO):
            axes = grasp.target(X_WO).axes
            assert len(axes) == 1 + counts
            assert len(grasp.pick_target(X_WO).axes) == 2
            if counts:
                across_W = X_WO.rotation() @ grasp.across_O
                np.testing.assert_allclose(axes[1].direction_W, across_W)
        assert all(len(g.target(X_WO).axes) == 1 for g in hand.grasps(can, X_WO))
