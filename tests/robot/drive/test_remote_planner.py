import dataclasses as dc
import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.common.safety_states import SafetyState, StopReason
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.arm_pair import stretched, together
from drake_srg.planning.servoing.tracker import PoseSighting
from drake_srg.robot.drive.cameras import Picture
from drake_srg.robot.drive.planner_process import ServoEye, sendable
from drake_srg.robot.drive.remote_planner import Answer, Pause, Plan
from drake_srg.types import PlannerStatus
from robot.drive.stand import HOME, MOVING, motion_to

PERIOD = 0.005
GOAL = HOME + 0.5
NOWHERE = np.full(7, np.nan)


def play(pause, begin, end, state, reason=StopReason.NONE, held=NOWHERE):
    """Return the pause or the motion after a while, and the commands."""
    commands = []
    for time in np.arange(begin, end, PERIOD):
        after = pause
        if isinstance(pause, Pause):
            after = pause.go_on(time, state, reason, held)
        pause = after
        motion = pause.motion if isinstance(pause, Pause) else pause
        commands.append(motion.position(time))
    return pause, np.array(commands)


@given(st.floats(0.0, 2.5))
def test_commands_of_a_kept_path_never_jump(moment):
    motion = motion_to(GOAL, duration=2.0)
    pause = Pause.begun(motion, moment)
    stop, release = SafetyState.PROTECTIVE_STOP, moment + 1.0
    pause, before = play(pause, moment, release, stop, StopReason.STALE)
    after, rest = play(pause, release, release + 4.0, SafetyState.RUNNING)
    assert isinstance(after, Motion)
    path = np.vstack([before, rest])
    assert np.max(np.abs(np.diff(path, axis=0))) < 0.5 * 1.5 / 2.0 * PERIOD * 1.1
    np.testing.assert_allclose(path[-1], GOAL, atol=1e-9)


@pytest.mark.parametrize("away", [0.0, 0.02, 0.5])
def test_an_arm_that_rests_elsewhere_first_goes_to_its_path(away):
    motion = motion_to(GOAL, duration=2.0)
    pause = Pause.begun(motion, 1.0)
    held = motion.position(1.05) + away * np.array([0, 0, 1, 0, 0, 0, 0])
    stop = SafetyState.EMERGENCY_STOP
    pause, _ = play(pause, 1.0, 2.0, stop, StopReason.EMERGENCY_STOP, held)
    after, path = play(pause, 2.0, 9.0, SafetyState.RUNNING)
    np.testing.assert_allclose(path[0], held, atol=2e-3 if away == 0.0 else 1e-9)
    np.testing.assert_allclose(path[-1], GOAL, atol=1e-9)
    assert np.max(np.abs(np.diff(path, axis=0))) < 0.5 * PERIOD
    assert isinstance(after, Motion)


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


def test_every_picture_is_looked_at_once_and_has_its_stamp():
    picture = Picture(1.5, np.zeros((2, 3, 4), np.uint8), np.ones((2, 3), np.float32))
    pictures = [None, picture, picture, dc.replace(picture, stamp=1.6)]
    camera = SimpleNamespace(newest=lambda: pictures.pop(0))
    tracker = SimpleNamespace(sight=lambda color, depth: PoseSighting(len(pictures)))
    eye = ServoEye(tracker, camera)
    assert eye.look() is None
    seen = eye.look()
    assert (seen.frame, seen.stamp) == (2, 1.5)
    assert eye.look() is None
    assert eye.look().stamp == 1.6


def line(duration):
    """Return a motion of two joints, from rest to rest."""
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
        [0.0, duration], np.array([[0.0, 0.8], [0.3, -0.5]]), np.zeros(2), np.zeros(2)
    )


@pytest.mark.parametrize(
    "trajectory",
    [
        line(1.3),
        stretched(line(1.3), 2.7),
        together([line(1.0), line(2.0)]),
        line(1e-3),
    ],
)
def test_motions_reach_the_control_loop_as_they_are(trajectory):
    motion = Motion(np.zeros(trajectory.rows()), trajectory, 5.0, 9.0)
    sent = pickle.loads(pickle.dumps(sendable(motion)))
    assert (sent.departed, sent.due) == (5.0, 9.0)
    for time in np.linspace(4.9, 9.1, 200):
        reached = sent.position(time)
        np.testing.assert_allclose(reached, motion.position(time), atol=1e-8)
    assert sendable(sent) is sent
