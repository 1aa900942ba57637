"""Where things are set down in a row, with the scenario's own arm."""

import numpy as np
import pytest

from drake_srg.cell.choosing import row_places
from drake_srg.cell.clearing import MakeClearingPlanner
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.scenario import load_scenario
from drake_srg.types import Mode
from planning.clearing.fake_table import SIDE, grasp_at, moved, table

PLACE = (0.55, 0.05)


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("row_table")


@pytest.fixture(scope="module")
def planner(scenario):
    return MakeClearingPlanner(scenario).planner


@pytest.mark.parametrize("slot", [0, 3])
def test_a_thing_is_set_down_as_it_stood_at_its_own_place(scenario, planner, slot):
    motions = planner._by_label[slot]
    planned = motions.plan(motions.q_home, grasp_at(PLACE), moved(table()))
    assert not isinstance(planned, PlanningFailure), planned.message
    at_grasp, at_place = (
        motions.scene.X_WG(planned[mode].value(1e9)[:, 0])
        for mode in (Mode.GRASP, Mode.PLACE)
    )
    X_OO = at_place @ at_grasp.inverse()  # of what was taken
    p_WO = X_OO @ np.array([*PLACE, 0.0])
    name = scenario.task.clear.objects[slot]
    np.testing.assert_allclose(p_WO[:2], row_places(scenario)[name][:2], atol=0.003)
    assert 0.0 < p_WO[2] < 0.003
    assert X_OO.rotation().matrix()[2, 2] == pytest.approx(1.0, abs=1e-4)
    # The fingers close across the row, and do not touch what stands beside.
    assert abs(at_place.rotation().matrix()[1, 1]) > 0.99
    assert scenario.task.place.row.spacing > 2 * SIDE
