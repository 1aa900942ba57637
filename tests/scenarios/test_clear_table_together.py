"""Two arms clear one table at the same time, without meeting."""

import pytest

from drake_srg.common.log_format import MODES
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate

pytestmark = pytest.mark.slow


def test_both_arms_clear_the_table_and_stay_apart():
    scenario = load_scenario("clear_table_together", overrides=["clutter.count=5"])
    result = Simulate(scenario)
    metrics = result.metrics
    assert metrics.success, metrics.failure
    assert metrics.objects_cleared == metrics.objects_total == 5
    assert metrics.arm_contacts == 0
    assert metrics.min_arm_distance_m > 0.0
    for name in ("left", "right"):  # each takes some
        assert "release" in {mode.value for mode in modes(result.log, name)}


def modes(log, name):
    return {MODES[int(i)] for i in log[f"{name}.mode"]}
