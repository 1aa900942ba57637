import numpy as np
import pytest

from drake_srg.experiments.plant_servo import (
    Closing,
    borderline_action,
    closing_rows,
    grasp_rows,
)
from drake_srg.learning.envs.tasks import GraspOneShotEnv

TIME = np.array([0.0, 1.0])


def closings(plant):
    rises = {"plant": plant, "position": 0.6, "tendon": 1.5}
    return {name: Closing(TIME, TIME, rise, 20.0) for name, rise in rises.items()}


@pytest.mark.parametrize(("rise", "passed"), [(0.4, True), (0.7, False)])
def test_the_plants_servos_must_not_be_slower(rise, passed):
    assert all(row.passed for row in closing_rows(closings(rise))) is passed


@pytest.mark.parametrize(("others", "passed"), [(1, True), (3, False)])
def test_outcomes_must_agree(others, passed):
    fine = np.tile([0.0, 1.0], 6)
    coarse = fine.copy()
    coarse[:others] = 1.0 - coarse[:others]
    rows = grasp_rows(np.array([coarse, fine]))
    assert all(row.passed for row in rows) is passed


def test_borderline_grasps_are_drawn_from_the_seed():
    env = GraspOneShotEnv(noise=0.0)
    env.reset(seed=1)
    first, again, other = (borderline_action(seed, env) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
