import numpy as np
import pytest

from drake_srg.experiments.servo_motions import MOTIONS


@pytest.mark.parametrize(
    ("name", "highest"),
    # Straight fingers meet at 1.76, which is what a grip is for.
    [("minimum_jerk", 1.7), ("sine", 1.7), ("grip", 1.94)],
)
def test_speed_and_acceleration_are_derivatives_of_the_angle(name, highest):
    time = np.arange(0.0, 2.0, 1e-4)
    q, v, a = MOTIONS[name].reference(time)
    np.testing.assert_allclose(np.gradient(q, time)[1:-1], v[1:-1], atol=1e-3)
    np.testing.assert_allclose(np.gradient(v, time)[1:-1], a[1:-1], atol=2e-2)
    assert np.min(q) >= 0.0
    assert np.max(q) < highest + 1e-9
    assert np.max(np.abs(v)) < 3.67 + 1e-9


@pytest.mark.parametrize("name", ["grip", "minimum_jerk"])
def test_a_reference_ends_at_its_target(name):
    time = np.arange(0.0, 2.0, 1e-3)
    reference, target = MOTIONS[name].reference(time)[0], MOTIONS[name].target(time)
    changes = np.flatnonzero(np.diff(target))
    assert len(changes)
    ends = [*changes, len(time) - 1]
    np.testing.assert_allclose(reference[ends], target[ends])
