import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.srg_geometry import SRG
from drake_srg.planning.grasps.srg_angles import EMPTY_BASE_ANGLE, wrap_angles
from drake_srg.planning.grasps.srg_fingers import SrgFingers

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
    assert FINGERS.tellable(width)
    assert FINGERS.holds(width, angles(closed), np.zeros(4))
    assert not FINGERS.holds(width, angles(empty), np.zeros(4))


@pytest.mark.parametrize(
    "empty",
    [(1.777, 1.76, 0.0, 0.0), (1.714, 1.744, 0.066, 0.098), (1.617, 1.62, 0.3, 0.31)],
)
def test_an_empty_hand_whose_tips_have_turned_holds_nothing(empty):
    """A hand that had lost a tin went on to set it down in the bin."""
    assert not FINGERS.holds(0.084, np.array(empty), np.zeros(4))
    assert FINGERS.holds(0.084, np.array(empty) - [0.03, 0.03, 0.0, 0.0], np.zeros(4))


def test_the_thinnest_things_cannot_be_told():
    assert not FINGERS.tellable(0.001)


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
