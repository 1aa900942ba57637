"""A table with a single brick, cleared by camera."""

import pytest

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate

pytestmark = pytest.mark.slow

BRICK = (
    "clutter.count=1",
    "clutter.kinds={}",
    "clutter.kinds.brick={model: package://drake_srg/sdf/061_foam_brick.sdf}",
)


def test_a_brick_ends_in_the_bin():
    scenario = load_scenario("clear_table_fast", seed=3, overrides=BRICK)
    metrics = Simulate(scenario).metrics
    assert metrics.success
    assert (metrics.objects_total, metrics.objects_cleared) == (1, 1)
    assert (metrics.picks, metrics.picks_held) == (1, 1)
    assert metrics.objects["clutter_1"]["outcome"] == "cleared"
    # At least the brick's weight, 0.028 kg, at most the motors' stall torque.
    assert 0.3 < metrics.peak_contact_force_n < 60.0
    assert "1 of 1 objects" in metrics.table()
