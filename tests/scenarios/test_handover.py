"""The bottle changes hands, and failures are reported by name."""

import pytest

from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate

pytestmark = pytest.mark.slow


def test_the_bottle_stands_on_its_mark_and_the_arms_never_touch():
    """Regression: fingers opened on the approach and touched the giver's wrist."""
    metrics = Simulate(load_scenario("handover_varied", seed=6019)).metrics
    assert metrics.success, metrics.failure
    assert metrics.attempts == 1
    assert metrics.arm_contacts == 0
    # The planner keeps hands 10 mm apart; arms follow their paths within millimetres.
    assert metrics.min_arm_distance_m > 0.005


def test_without_friction_nothing_is_taken():
    slippery = ["object.friction=0", "planner.max_attempts=1"]
    metrics = Simulate(load_scenario("handover", overrides=slippery)).metrics
    # A wedged bottle may come up a little.
    assert metrics.failure in ("no_grasp", "dropped")


def test_a_receiver_too_weak_to_hold_the_bottle_drops_it():
    weak = ["arms.right.gripper.motor_strength=0.02", "planner.max_attempts=1"]
    metrics = Simulate(load_scenario("handover", overrides=weak)).metrics
    assert metrics.failure == "dropped"
    assert not metrics.success
