import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments.servo_bench import Motion, simulate
from drake_srg.experiments.servo_motions import SHIPPED


def at_rest(time):
    return np.full_like(time, 0.5), 0.0 * time, 0.0 * time


@pytest.mark.parametrize("torque", [0.0, 0.1, -0.1])
def test_without_a_servo_a_load_accelerates_the_joint(torque):
    zero = [0.0] * 4
    nothing = dc.replace(SHIPPED, kp=zero, kd=zero, kff1=zero, kff2=zero)
    motion = Motion(at_rest, 1.0, load=lambda t: 0.0 * t + torque, duration=0.05)
    response, joint = simulate(nothing, motion)
    expected = 0.5 + 0.5 * torque / joint.inertia * response.time**2
    # The joint's friction takes c v / torque, at most 13 %; a loose tip adds to that.
    allowed = 0.2 * np.abs(expected[-1] - 0.5) + 1e-9
    assert np.max(np.abs(response.q - expected)) < allowed
    assert np.all(response.pwm == 0.0)
