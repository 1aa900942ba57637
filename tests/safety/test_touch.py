import math

import numpy as np
import pytest

from drake_srg.common.safety_states import StopReason
from drake_srg.safety.config import BodyRegionLimits, ForceLimitConfig, SafetyConfig
from drake_srg.safety.touch import TouchLimits

PROFILE = {
    "hand": BodyRegionLimits(transient=100.0, quasi_static=40.0),
    "arm": BodyRegionLimits(transient=80.0, quasi_static=60.0),
}


class Scale:
    """A tool whose force is the first joint's torque."""

    def force(self, q, torque):
        return abs(torque[0])


def limits(*regions):
    force = ForceLimitConfig(profile=PROFILE, regions=list(regions), transient_time=0.5)
    return TouchLimits.of(SafetyConfig(force=force), 2, Scale())


def test_without_limits_there_is_nothing_to_feel():
    assert TouchLimits.of(SafetyConfig(), 2, None) is None


def test_the_least_limits_of_the_regions_in_reach_hold():
    both = limits("hand", "arm")
    assert (both.transient, both.quasi_static) == (80.0, 40.0)
    assert limits("arm").quasi_static == 60.0


@pytest.mark.parametrize("regions", [[], ["head"], ["hand", "head"]])
def test_unknown_regions_are_refused(regions):
    with pytest.raises(ValueError, match=r"safety.force.regions.*allowed: hand, arm"):
        limits(*regions)


@pytest.mark.parametrize("torque", [[], [1.0] * 3])
def test_torques_must_fit_the_joints(torque):
    with pytest.raises(ValueError, match=r"safety.external_torque: needs 1 entry"):
        TouchLimits.of(SafetyConfig(external_torque=torque), 2, None)


def test_an_impact_counts_at_once_and_a_press_once_it_lasts():
    touch, q = limits("hand"), np.zeros(2)
    assert touch.fault(q, np.array([101.0, 0.0]), math.inf, 0.0)[0] is StopReason.FORCE
    reason, since = touch.fault(q, np.array([50.0, 0.0]), math.inf, 1.0)
    assert (reason, since) == (StopReason.NONE, 1.0)
    assert touch.fault(q, np.array([50.0, 0.0]), since, 1.4)[0] is StopReason.NONE
    assert touch.fault(q, np.array([50.0, 0.0]), since, 1.6)[0] is StopReason.FORCE
    assert touch.fault(q, np.array([30.0, 0.0]), since, 1.6) == (
        StopReason.NONE,
        math.inf,
    )


def test_torques_count_in_both_directions():
    config = SafetyConfig(external_torque=[2.0])
    touch = TouchLimits.of(config, 2, None)
    for torque, reason in (
        ([1.9, -1.9], StopReason.NONE),
        ([0.0, -2.1], StopReason.EXTERNAL_TORQUE),
        ([np.nan, 0.0], StopReason.MEASURED_NOT_FINITE),
    ):
        assert touch.fault(np.zeros(2), np.array(torque), math.inf, 0.0)[0] is reason
