"""Motions of two arms as one: their timing, and collisions between them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.planning.handover.config import HandoverMode
from drake_srg.planning.motion.arm_pair import (
    minimum_jerk_motion,
    stretched,
    together,
)
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.planning_scene import NoPathError
from drake_srg.scenario import load_scenario
from drake_srg.station.planners import MakeHandoverPlanner
from drake_srg.types import Failure

LIMITS = MotionLimits(np.full(2, 1.5), np.full(2, 6.0), np.full(2, 100.0))


def line(duration, end):
    return PiecewisePolynomial.FirstOrderHold(
        [0.0, duration], np.array([[0.0, end], [0.0, -end]])
    )


@given(st.floats(0.1, 3.0), st.floats(0.1, 3.0))
def test_the_faster_arm_waits_for_the_slower_one(first, second):
    both = together([line(first, 1.0), line(second, 2.0)])
    assert both.end_time() == pytest.approx(max(first, second))
    middle = both.value(0.5 * both.end_time())[:, 0]
    np.testing.assert_allclose(middle, [0.5, -0.5, 1.0, -1.0], atol=1e-9)


def test_a_slow_motion_stays_as_it_is():
    slow = line(2.0, 1.0)
    assert stretched(slow, 1.0) is slow
    assert stretched(slow, 4.0).value(2.0)[0, 0] == pytest.approx(0.5)


@given(st.floats(0.01, 2.0), st.floats(-2.0, 2.0))
def test_a_minimum_jerk_motion_uses_its_limits_and_no_more(near, far):
    ends = np.array([near, -near, far, 0.1])
    path = np.linspace(0.0, 1.0, 9)[:, None] * ends
    motion = minimum_jerk_motion(path, [LIMITS, LIMITS])
    times = np.linspace(0.0, motion.end_time(), 201)
    v = np.array([motion.EvalDerivative(t, 1)[:, 0] for t in times])
    a = np.array([motion.EvalDerivative(t, 2)[:, 0] for t in times])
    use = max(np.abs(v).max() / 1.5, np.sqrt(np.abs(a).max() / 6.0))
    assert use <= 1.001
    assert np.abs(v).max() / 1.5 > 0.99 or np.abs(a).max() / 6.0 > 0.99
    np.testing.assert_allclose(v[[0, -1]], 0.0, atol=1e-6)
    for share in (0.2, 0.5, 0.7):
        q = motion.value(share * motion.end_time())[:, 0]
        np.testing.assert_allclose(q, minimum_jerk_blend(share) * ends, atol=1e-6)


def test_arms_that_meet_on_their_ways_are_told():
    handover = MakeHandoverPlanner(load_scenario("handover"))
    pair = handover._modes[HandoverMode.PULL].replanner.both.pair
    home = np.zeros(14)
    # Each arm bows towards the other one.
    meet = np.tile([0.0, 0.9, 0.0, -0.4, 0.0, 0.4, 0.0], 2)
    both = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.array([home, meet]).T)
    with pytest.raises(NoPathError) as error:
        pair.checked(both, "bow")
    assert error.value.failure.failure is Failure.BLOCKED
    assert error.value.failure.message.startswith("bow, with both arms in motion: ")
    alone = np.concatenate([meet[:7], np.zeros(7)])
    assert pair.first_hit(np.linspace(home, 0.3 * alone, 5)) is None
