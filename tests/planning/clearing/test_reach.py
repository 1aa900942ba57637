"""The ring in which an iiwa's hand can point down."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.cell.planners import own_scene
from drake_srg.planning.clearing.reach import reach_with_hand_down, turned_to
from drake_srg.scenario import load_scenario


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("clear_table", overrides=["clutter.count=1"])


def test_an_iiwa_reaches_the_middle_of_the_table_but_not_its_own_foot(scenario):
    home = np.array(scenario.arm.home)
    reach = reach_with_hand_down(own_scene(scenario), home, np.array([0.6, 0.0, 0.2]))
    assert reach.center == pytest.approx((0.0, 0.0))
    assert 0.3 < reach.least < 0.5
    assert 0.75 < reach.most < 0.9
    assert reach.contains(np.array([[0.6, 0.0], [0.1, 0.0], [0.9, 0.3]])).tolist() == [
        True,
        False,
        False,
    ]


def test_what_is_out_of_reach_itself_has_no_ring(scenario):
    home = np.array(scenario.arm.home)
    far = np.array([1.5, 0.0, 0.2])
    assert reach_with_hand_down(own_scene(scenario), home, far) is None


@settings(max_examples=20, deadline=None)
@given(azimuth=st.floats(-2.0, 2.0), radius=st.floats(0.4, 0.8))
def test_an_arm_that_is_turned_to_a_place_has_its_hand_before_it(
    scenario, azimuth, radius
):
    scene, home = own_scene(scenario), np.array(scenario.arm.home)
    place = scene.p_WA[:2] + radius * np.array([np.cos(azimuth), np.sin(azimuth)])
    turned = turned_to(scene, home, place)
    hand = scene.X_WG(turned).translation() - scene.p_WA
    assert np.arctan2(hand[1], hand[0]) == pytest.approx(azimuth, abs=1e-6)
    np.testing.assert_array_equal(turned[1:], home[1:])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_arm_at_its_limit_turns_the_other_way_round(scenario, side):
    scene, home = own_scene(scenario), np.array(scenario.arm.home)
    behind = side * np.radians(145.0)
    place = scene.p_WA[:2] + 0.6 * np.array([np.cos(behind), -np.sin(behind)])
    turned = turned_to(scene, np.array([behind, *home[1:]]), place)
    hand = scene.X_WG(turned).translation() - scene.p_WA
    assert np.arctan2(hand[1], hand[0]) == pytest.approx(-behind, abs=1e-6)
    assert scene.lower[0] <= turned[0] <= scene.upper[0]
