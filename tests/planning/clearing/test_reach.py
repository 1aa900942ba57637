"""The ring in which an iiwa's hand can point down."""

import numpy as np
import pytest

from drake_srg.cell.planners import own_scene
from drake_srg.planning.clearing.reach import reach_with_hand_down
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
