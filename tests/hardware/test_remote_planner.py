import numpy as np

from drake_srg.hardware.exchange import Answer
from drake_srg.hardware.remote_planner import Plan
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.types import PlannerStatus
from hardware.stand import HOME, MOVING, motion_to

THERE = HOME + 0.5
STATUS = PlannerStatus(mode=MOVING)


def answer(time, motion=None):
    return Answer(time, motion, 0.0, STATUS)


def test_a_motion_keeps_its_clock_while_the_planners_stands_still():
    motion = motion_to(THERE, departed=1.0)
    plan = Plan(Motion(HOME)).after(answer(1.0, motion), 5.0)
    np.testing.assert_allclose(plan.position(6.0), motion.position(2.0))
    # The planner has thought for a second meanwhile.
    plan = plan.after(answer(1.5), 6.5)
    np.testing.assert_allclose(plan.position(6.5), motion.position(2.5))


def test_a_stop_that_comes_late_does_not_jump_back():
    motion = motion_to(THERE, departed=1.0)
    plan = Plan(Motion(HOME)).after(answer(1.0, motion), 5.0)
    before = plan.position(6.2)
    plan = plan.after(answer(2.0, motion.stopped(2.0)), 6.2)
    np.testing.assert_allclose(plan.position(6.2), before)
    # At rest 0.4 s later, on the same path.
    np.testing.assert_array_equal(plan.position(6.6), plan.position(9.0))
    assert np.all(plan.position(9.0) > before)
