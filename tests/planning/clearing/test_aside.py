"""Where the arm looks from for what it has dropped."""

import numpy as np
import pytest

from drake_srg.cell.clearing import MakeClearingPlanner
from drake_srg.cell.height_maps import clearing_destinations
from drake_srg.scenario import load_scenario


@pytest.mark.parametrize("name", ["clear_table_fast", "sort_table", "row_table"])
def test_the_arm_aside_is_far_from_where_loads_go(name):
    scenario = load_scenario(name, seed=1)
    planner = MakeClearingPlanner(scenario).planner
    scene = planner.motions.scene
    scene.SetFingers({})
    p_WG = scene.X_WG(planner.q_aside).translation()
    p_over = scene.X_WG(planner.motions.q_over).translation()
    assert p_WG[2] == pytest.approx(p_over[2], abs=1e-6)
    assert scene.is_free(planner.q_aside)
    for place in clearing_destinations(scenario):
        assert np.linalg.norm(p_WG[:2] - place.middle) > 0.5
