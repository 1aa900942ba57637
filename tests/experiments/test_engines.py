"""Comparisons of Drake and MuJoCo, by procedures that are written once for both."""

import numpy as np
import pytest

from experiments.data import household_objects
from experiments.free_closing import deviations, vendors
from experiments.payload import CLOSE, HOLD, LIFT, judge_hold, largest
from experiments.stands.grasps import grasps, present
from experiments.stands.mujoco_grasps import MujocoBench


def test_drakes_friction_in_mujoco():
    thing = household_objects()["003_cracker_box"]  # 0.6
    scenario = present(thing, grasps()["003_cracker_box", "above"])
    bench = MujocoBench(scenario, {"harmonic": True})
    model = bench.model
    own = np.array(model.geom_bodyid) == bench.thing.id
    own &= np.array(model.geom_contype) > 0
    pad = model.geom("gripper_left_tip_link_left_pad").id
    assert max(model.geom_friction[pad, 0], model.geom_friction[own, 0].max()) == (
        pytest.approx(2 * 0.6 * 0.8 / 1.4)
    )


def test_the_vendors_own_table_does_not_deviate():
    force, angles = vendors()
    found = deviations("tip", force, angles["tip"])
    assert found["angle at equal force [%]"][0] == 0.0
    off = deviations("tip", force, angles["tip"] + np.deg2rad(1.0))
    assert off["angle at equal force [degrees]"][0] == pytest.approx(1.0)


TIME = np.linspace(0.0, CLOSE + LIFT + HOLD, 1651)


@pytest.mark.parametrize(("slip", "held"), [(0.0, HOLD), (0.006, 0.0)])
def test_a_pinch_counts_from_when_the_load_comes_on(slip, held):
    p_GO = np.zeros((len(TIME), 3))
    p_GO[TIME > CLOSE + 0.5, 2] = slip
    found = judge_hold("pinch", TIME, p_GO, np.zeros((len(TIME), 4)))
    assert found["held_for"] == pytest.approx(held)
    assert found["slip"] == pytest.approx(1e3 * slip)


def test_the_largest_mass_is_bracketed():
    found = largest(lambda m: {"held_for": HOLD if m < 3.3 else 0.0}, 5.0)
    assert 3.3 / 1.02 < found["largest"] < 3.3
