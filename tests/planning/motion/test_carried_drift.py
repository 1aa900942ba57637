import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.planning.motion.carried_drift import carried_drift

TIME, HALF_STEP = 2.0, 0.006


def turn(*joints):
    """Return a motion at constant speed: each joint by so much in `TIME`."""
    ends = np.column_stack([np.zeros(len(joints)), joints])
    return PiecewisePolynomial.FirstOrderHold([0.0, TIME], ends)


@pytest.mark.parametrize("p_GO", [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]])
def test_what_turns_about_one_joint_drifts_outwards(pendulum, p_GO):
    motion = turn(1.2, 0.0)
    drift = carried_drift(pendulum, motion, np.array(p_GO), HALF_STEP)
    radius, speed = 0.5 + p_GO[0], 1.2 / TIME
    outwards = speed**2 * radius * HALF_STEP * TIME
    np.testing.assert_allclose(drift, [outwards, 0.0, 0.0], atol=1e-6)


def test_it_is_what_steps_add_up_to(pendulum):
    motion, h, p_GO = turn(0.8, -1.3), 1e-3, np.array([0.1, 0.0, 0.05])
    X_GO = p_GO.copy()
    for t in np.arange(0.0, TIME, h):
        q, v = motion.value(t).ravel(), motion.EvalDerivative(t).ravel()
        X_WG, dt = pendulum.X_WG(q), 1e-6
        speed = (pendulum.X_WG(q + dt * v) @ X_GO - X_WG @ X_GO) / dt
        X_GO = pendulum.X_WG(q + h * v).inverse() @ (X_WG @ X_GO + h * speed)
    drift = carried_drift(pendulum, motion, p_GO, 0.5 * h)
    np.testing.assert_allclose(drift, X_GO - p_GO, rtol=0.01, atol=1e-6)


def test_the_object_of_an_arm_at_rest_stays(pendulum):
    drift = carried_drift(pendulum, turn(0.0, 0.0), np.array([0.1, 0.0, 0.0]), 0.006)
    np.testing.assert_array_equal(drift, np.zeros(3))
