import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pydrake.math import RotationMatrix

from drake_srg.arm.impedance_law import (
    CartesianSpring,
    JointSpring,
    damping_matrix,
    is_stable,
    largest_phase,
    natural_frequencies,
)
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant

HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
TRANSLATION, ROTATION = np.array([1000.0, 2000.0, 3000.0]), 200.0
P_FC = np.array([0.1, 0.02, 0.0])
PLANT = MakeModelsPlant(load_scenario("kitchen"))
PALM = PLANT.GetFrameByName("palm")
JOINTS = JointSpring(PLANT, "arm", np.linspace(100.0, 700.0, 7))
LIMP = JointSpring(PLANT, "arm", np.zeros(7))
RATIOS = st.floats(0.1, 1.0)
SEEDS = st.integers(0, 2**32 - 1)


def cartesian(joints):
    return CartesianSpring(joints, PALM, P_FC, TRANSLATION, ROTATION)


def near(seed, most=0.2):
    """A posture near home."""
    return HOME + np.random.default_rng(seed).uniform(-most, most, 7)


@given(SEEDS, RATIOS)
def test_every_mode_has_the_damping_ratio(seed, ratio):
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(2, 4, 4))
    M, K = A @ A.T + 0.1 * np.eye(4), B @ B.T
    D = damping_matrix(M, K, ratio)
    np.testing.assert_allclose(D, D.T, atol=1e-9 * np.max(np.abs(D)))
    # In its own modes, D M^-1 D = (2 ratio)² K.
    np.testing.assert_allclose(
        D @ np.linalg.solve(M, D), 4.0 * ratio**2 * K, atol=1e-8 * np.max(np.abs(K))
    )


def test_a_joint_without_stiffness_is_not_damped():
    K = np.diag([100.0, 0.0])
    np.testing.assert_allclose(damping_matrix(np.eye(2), K, 0.7)[1], 0.0, atol=1e-12)
    np.testing.assert_allclose(natural_frequencies(np.eye(2), K), [0.0, 10.0])


@given(SEEDS, SEEDS)
def test_the_hands_spring_gives_back_the_energy_that_it_takes(seed, other):
    q, q_0 = near(seed), near(other)
    p_0, R_0, _ = LIMP.forward(PALM, P_FC, q_0)

    def energy(q):
        p, R, _ = LIMP.forward(PALM, P_FC, q)
        angle = RotationMatrix(R_0 @ R.T).ToAngleAxis().angle()
        return 0.5 * TRANSLATION @ (p_0 - p) ** 2 + 0.5 * ROTATION * angle**2

    gradient = [
        (energy(q + h) - energy(q - h)) / 2e-6 for h in 1e-6 * np.eye(7)
    ]  # central differences
    torque, _, _ = cartesian(LIMP).pull(q, q_0)
    np.testing.assert_allclose(torque, -np.array(gradient), atol=1e-3)


@given(SEEDS, SEEDS)
def test_springs_in_the_null_space_do_not_push_the_hand(seed, other):
    assume(seed != other)
    q, q_0 = near(seed), near(other)
    with_joints, _, M = cartesian(JOINTS).pull(q, q_0)
    extra = with_joints - cartesian(LIMP).pull(q, q_0)[0]
    _, _, J = JOINTS.forward(PALM, P_FC, q)
    np.testing.assert_allclose(J @ np.linalg.solve(M, extra), 0.0, atol=1e-6)
    assert np.max(np.abs(extra)) > 1e-3


@pytest.mark.parametrize("spring", [JOINTS, cartesian(JOINTS)])
def test_the_stiffness_is_the_torques_slope_at_rest(spring):
    _, K, _ = spring.pull(HOME, HOME)
    for i, h in enumerate(1e-6 * np.eye(7)):
        slope = (spring.pull(HOME, HOME + h)[0] - spring.pull(HOME, HOME - h)[0]) / 2e-6
        np.testing.assert_allclose(slope, K[:, i], atol=1e-3)


@given(RATIOS, st.floats(0.2, 0.98), st.floats(1.02, 2.0))
def test_a_mode_decays_up_to_the_largest_phase_and_swings_up_beyond(
    ratio, below, above
):
    def swing(phase):
        """Greatest share of the first swing that is left after many periods."""
        x, v, u, size = 1.0, 0.0, 0.0, []
        for _ in range(4000):
            x, v, u = x + v + 0.5 * u, v + u, -(phase**2) * x - 2 * ratio * phase * v
            size.append(abs(x))
            if size[-1] > 1e6:
                break
        return max(size[-100:])

    phase = largest_phase(ratio)
    assert is_stable(below * phase, ratio)
    assert not is_stable(above * phase + 1e-3, ratio)
    assert swing(below * phase) < 0.1 < swing(above * phase + 1e-3)
