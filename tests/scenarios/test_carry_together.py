"""Two arms carry the crate level onto its mark, and report failures by name."""

import pytest

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate

pytestmark = pytest.mark.slow


def test_the_crate_stands_on_its_mark_and_was_level_all_the_way():
    """This heavy one jumped by 7 mm when the bases' sensors lost its edge."""
    metrics = Simulate(load_scenario("carry_together_varied", seed=5003)).metrics
    assert metrics.success, metrics.failure  # within 3 mm
    assert metrics.attempts == 1
    assert metrics.max_tilt_deg < 1.0
    assert 0.0 < metrics.internal_force_n < 20.0
    assert metrics.arm_contacts == 0


def test_without_friction_the_crate_stays_where_it_is():
    slippery = ["object.friction=0", "planner.max_attempts=1"]
    metrics = Simulate(load_scenario("carry_together", overrides=slippery)).metrics
    assert metrics.failure in ("no_grasp", "dropped")
    assert not metrics.success
