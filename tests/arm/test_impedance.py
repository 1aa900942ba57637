import numpy as np
import pytest
from helpers import fix
from hypothesis import assume, given
from hypothesis import strategies as st
from pydrake.math import RotationMatrix

from arm.driven_arm import HOME, MODELS, DrivenArm
from drake_srg.arm.driver import stiff_gains
from drake_srg.arm.impedance import (
    ArmImpedanceDriver,
    CartesianSpring,
    CartesianStiffness,
    ImpedanceControl,
    JointSpring,
    damping_matrix,
    is_stable,
    largest_phase,
    natural_frequencies,
)
from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation

TRANSLATION, ROTATION = np.array([1000.0, 2000.0, 3000.0]), 200.0
P_FC = np.array([0.1, 0.02, 0.0])
PALM = MODELS.GetFrameByName("palm")
JOINTS = JointSpring(MODELS, "arm", np.linspace(100.0, 700.0, 7))
LIMP = JointSpring(MODELS, "arm", np.zeros(7))
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


HAND = CartesianStiffness(frame="gripper::palm", centre=[0.1, 0.0, 0.0])


class Arm(DrivenArm):
    """The arm on springs, which is pushed at the hand's centre."""

    def __init__(self, **config):
        super().__init__(ArmImpedanceDriver(home=list(HOME), **config))

    def push(self, force):
        super().push(force, p_GP=HAND.centre)

    @property
    def pose(self):
        return self.plant.GetFrameByName("palm").CalcPoseInWorld(self.plant_context)


def test_a_pushed_hand_yields_by_force_over_stiffness_and_comes_back():
    arm = Arm(cartesian=HAND)
    before, centre = arm.pose, np.array(HAND.centre)
    force = np.array([6.0, -8.0, 10.0])
    arm.push(force)
    arm.advance(1.5)
    moved = arm.pose @ centre - before @ centre
    # A percent is for the limp fingers, which swing.
    np.testing.assert_allclose(moved, force / 2000.0, atol=0.01 * 5e-3)
    turn = (before.rotation().inverse() @ arm.pose.rotation()).ToAngleAxis().angle()
    assert turn < 1e-4  # a force at the centre turns nothing
    arm.push(np.zeros(3))
    arm.advance(1.5)
    np.testing.assert_allclose(arm.pose @ centre, before @ centre, atol=5e-5)


def test_pushed_joints_yield_by_torque_over_stiffness_and_come_back():
    arm = Arm()
    arm.advance(0.2)
    model = MODELS.GetModelInstanceByName("arm")
    stiffness = 0.25 * stiff_gains(MODELS, model, HOME)[0]
    joints = JointSpring(MODELS, "arm", stiffness)
    force = np.array([6.0, -8.0, 10.0])
    arm.push(force)
    arm.advance(1.0)
    palm = MODELS.GetFrameByName("palm")
    _, _, J = joints.forward(palm, np.array(HAND.centre), arm.q)
    torque = J[3:].T @ force
    largest = np.max(np.abs(torque / stiffness))
    np.testing.assert_allclose(arm.q - HOME, torque / stiffness, atol=0.01 * largest)
    arm.push(np.zeros(3))
    arm.advance(1.0)
    np.testing.assert_allclose(arm.q, HOME, atol=1e-4)


def test_a_free_arm_follows_without_lag():
    arm = Arm(cartesian=HAND)
    direction = np.array([0.3, 0.2, -0.3, 0.2, 0.3, -0.2, 0.3])
    lag = []
    for k in range(201):
        s = k / 200
        q = HOME + direction * s**3 * (10 - 15 * s + 6 * s * s)
        arm.command(q)
        arm.advance(0.005)
        lag.append(np.max(np.abs(arm.q - q)))
    # Two periods at up to 0.56 rad/s, and what the left-out Coriolis torques do.
    assert max(lag) < 0.008
    arm.advance(0.5)
    np.testing.assert_allclose(arm.q, HOME + direction, atol=5e-4)


def test_weak_springs_give_way_to_a_strong_push():
    arm = Arm(max_torque=[5.0] * 7)
    arm.push([0.0, 60.0, 0.0])  # 40 N m about joint 1
    arm.advance(0.3)
    assert arm.q[0] - HOME[0] > 0.1


def control(**limits):
    spring = JointSpring(MODELS, "arm", np.full(7, 1000.0))
    system = ImpedanceControl(
        spring,
        0.7,
        max_torque=np.full(7, limits.get("max_torque", 1e3)),
        max_acceleration=np.full(7, 10.0),
        effort_limits=np.full(7, limits.get("effort_limits", 1e3)),
        period=0.005,
    )
    return system, system.CreateDefaultContext()


def test_torques_stay_within_their_limits():
    for most, total in ((20.0, 1e3), (1e3, 50.0)):
        system, context = control(max_torque=most, effort_limits=total)
        state = np.concatenate([HOME, np.zeros(7)])
        desired = np.concatenate([HOME + np.linspace(-1.0, 1.0, 7), np.zeros(7)])
        gravity = np.linspace(30.0, -30.0, 7)
        fix(
            system,
            context,
            desired_state=desired,
            state_measured=state,
            gravity=gravity,
        )
        torque = system.get_output_port().Eval(context)
        spring = 1000.0 * (desired - state)[:7]
        expected = np.clip(np.clip(spring, -most, most) + gravity, -total, total)
        np.testing.assert_allclose(torque, expected, atol=1e-9)


@pytest.mark.parametrize(
    "override, message",
    [
        ("{joint_stiffness: [1, 2]}", "arm.joint_stiffness: needs one entry per"),
        ("{max_torque: [1, 2]}", "arm.max_torque: needs one entry per actuated joint"),
        ("{max_torque: [0]}", "arm.max_torque: must be greater than 0.0, got 0"),
        ("{damping_ratio: 1.5}", "arm.damping_ratio: must be at most 1.0, got 1.5"),
        ("{damping_ratio: 0}", "arm.damping_ratio: must be at least 0.1, got 0"),
        ("{stiffness: 3}", "arm: unknown key 'stiffness' (did you mean"),
        ("{cartesian: {rotation: 400}}", "rotation: must be at most 300.0, got 400"),
        ("{cartesian: {translation: [1]}}", "translation: needs 3 numbers, got 1"),
        (
            "{cartesian: {frame: 'arm::finger'}}",
            "arm.cartesian.frame: unknown frame 'arm::finger' (allowed: MODEL::FRAME",
        ),
        (
            "{period: 0.02, cartesian: {}}",
            "arm.period: 0.02 s is too long for this stiffness, with which the arm ",
        ),
        ("{joint_stiffness: [9e4, 9e4, 9e4, 9e4, 9e4, 9e4, 9e4]}", "(allowed: up to"),
    ],
)
def test_bad_settings_are_named_with_what_is_allowed(override, message):
    with pytest.raises(ScenarioError) as error:
        MakeStation(
            load_scenario(
                "kitchen",
                overrides=[
                    f"arm=!ArmImpedanceDriver {override}",
                    "cameras={}",
                    "localizer.cameras=[]",
                    "recording={}",
                ],
            )
        )
    assert message in str(error.value)
