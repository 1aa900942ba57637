"""A task with a single object, on the table that brings things to rest."""

import numpy as np
import pytest

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate

pytestmark = pytest.mark.slow

ON_THE_MAT = (
    "plant_config.time_step=0.005",
    "arm.period=0.005",
    "directives.table.add_model.file=package://drake_srg/sdf/table_mat.sdf",
    "sleeping={}",
)


def test_the_kitchen_s_can_rests_on_the_mat_and_is_placed():
    result = Simulate(load_scenario("kitchen", seed=1, overrides=ON_THE_MAT))
    assert result.metrics.success
    time, poses = result.log["time"], result.log["object_pose.soup_can"]
    # It falls asleep after half a second at rest, while the arm is on its way.
    rows = np.flatnonzero((time > 0.7) & (time < 1.2))
    assert np.ptp(poses[rows], axis=0).max() == 0.0
