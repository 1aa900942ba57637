import numpy as np
import pytest

from drake_srg.experiments.servo_motions import MOTIONS


@pytest.mark.parametrize("name", ["minimum_jerk", "sine"])
def test_speed_and_acceleration_are_derivatives_of_the_angle(name):
    time = np.arange(0.0, 2.0, 1e-4)
    q, v, a = MOTIONS[name].reference(time)
    np.testing.assert_allclose(np.gradient(q, time)[1:-1], v[1:-1], atol=1e-3)
    np.testing.assert_allclose(np.gradient(v, time)[1:-1], a[1:-1], atol=2e-2)
    assert np.min(q) >= 0.0
    assert np.max(q) < 1.7  # straight fingers meet at 1.76
    assert np.max(np.abs(v)) < 3.67 + 1e-9
