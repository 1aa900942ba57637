import dataclasses as dc
import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.arm_pair import stretched, together
from drake_srg.planning.servoing.tracker import PoseSighting
from drake_srg.robot.drive.cameras import Picture
from drake_srg.robot.drive.planner_process import ServoEye, sendable


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
