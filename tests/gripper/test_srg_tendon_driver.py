import dataclasses as dc

import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.framework import DiagramBuilder

from drake_srg.gripper import SrgPositionDriver, SrgTendonDriver
from drake_srg.gripper.srg_tendon_driver import (
    SpoolCommand,
    SpoolCommandConfig,
    TorqueControl,
    spool_angle,
)
from drake_srg.gripper.tendon import TendonDriveConfig, wire_travel
from gripper.driven_hand import SrgHand

RADIUS = 0.0076


def make(*, closure=0.0, motor=(0.0, 0.0), triggered=(0, 0, 0, 0), **optional):
    command = SpoolCommand(RADIUS)
    context = command.CreateDefaultContext()
    inputs = {"closure_commanded": closure, "motor_state": motor}
    fix(command, context, **inputs, triggered=triggered, **optional)
    return command, context


def target(command, context, **inputs):
    fix(command, context, **inputs)
    update(command, context)
    return read(command, context, "angle_desired")[0]


def test_closure_asks_for_the_joint_angles_of_algorithm_1():
    config = SpoolCommandConfig()
    for closure, base, tip in ((0.0, 0, 0), (0.5, 1.5, 0.0), (1.0, 1.94, 1.06)):
        expected = wire_travel(base, tip) / RADIUS
        assert spool_angle(closure, RADIUS, config) == pytest.approx(expected)


@given(st.floats(0, 1), st.floats(0, 1))
def test_more_closure_winds_more(a, b):
    config = SpoolCommandConfig()
    low, high = sorted((a, b))
    assert spool_angle(low, RADIUS, config) <= spool_angle(high, RADIUS, config)


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_any_closure_gives_a_target_within_the_range(closure):
    largest = spool_angle(1.0, RADIUS, SpoolCommandConfig())
    assert 0.0 <= target(*make(closure=closure)) <= largest


def test_a_nan_keeps_the_target():
    command, context = make(closure=0.4)
    before = target(command, context)
    assert target(command, context, closure_commanded=np.nan) == before > 0.0


def test_hold_stays_where_the_spool_is():
    command, context = make(closure=0.8, motor=(1.2, 0.5))
    target(command, context)
    assert target(command, context, hold=1.0) == 1.2
    # It goes on holding, wherever the spool drifts and whatever is commanded.
    assert target(command, context, motor_state=[1.3, 0], closure_commanded=0) == 1.2
    assert target(command, context, hold=0.0) == 0.0


def test_hold_keeps_a_grip():
    command, context = make(closure=0.8, motor=(1.2, 0.0), triggered=(0, 0, 1, 0))
    before = target(command, context)
    assert target(command, context, hold=1.0) == before > 1.2


def test_a_position_of_the_motor_overrides_closure():
    command, context = make(closure=0.4, motor_position_commanded=-0.7)
    assert target(command, context) == -0.7
    # Until it is NaN.
    closed = target(*make(closure=0.4))
    assert target(command, context, motor_position_commanded=np.nan) == closed


def test_hold_overrides_a_position_of_the_motor():
    command, context = make(motor=(1.2, 0.0), motor_position_commanded=2.0, hold=1.0)
    assert target(command, context) == 1.2


def torque(command, context, **inputs):
    target(command, context, **inputs)
    return read(command, context, "torque_desired")[0]


def test_the_motor_obeys_a_torque_until_it_is_nan():
    command, context = make()
    assert np.isnan(read(command, context, "torque_desired")[0])
    assert np.isnan(torque(command, context))
    assert torque(command, context, motor_torque_commanded=0.3) == 0.3
    assert np.isnan(torque(command, context, motor_torque_commanded=np.nan))


@pytest.mark.parametrize("triggered", [(0, 0, 0, 0), (0, 0, 1, 0)])
def test_hold_overrides_a_torque_of_the_motor(triggered):
    command, context = make(closure=0.5, triggered=triggered)
    target(command, context)
    before = target(command, context, hold=1.0)
    assert np.isnan(torque(command, context, motor_torque_commanded=-0.5))
    assert target(command, context, motor_state=[1.0, 0.0]) == before
    assert torque(command, context, hold=0.0) == -0.5


@pytest.mark.parametrize(
    ("touching", "before", "kept"),
    [(True, 0.3, 0.3), (False, 0.3, np.nan), (True, 0.0, np.nan), (True, -0.3, np.nan)],
)
def test_hold_keeps_a_grip_that_is_a_torque(touching, before, kept):
    command, context = make(
        motor=(1.2, 0.0),
        triggered=(0, 0, touching, 0),
        motor_torque_commanded=before,
    )
    target(command, context)
    assert torque(command, context, hold=1.0) == pytest.approx(kept, nan_ok=True)
    held = torque(command, context, motor_torque_commanded=0.9)
    assert held == pytest.approx(kept, nan_ok=True)
    assert target(command, context) == 1.2


def test_under_torque_control_the_target_follows_the_spool():
    command, context = make(
        motor=(1.2, 0.5), motor_position_commanded=2.0, motor_torque_commanded=0.0
    )
    assert target(command, context) == 1.2
    assert target(command, context, motor_state=[0.9, 0.0], hold=1.0) == 0.9
    fix(command, context, hold=0.0)
    assert target(command, context, motor_torque_commanded=np.nan) == 2.0


TENDON = SrgTendonDriver()


@pytest.fixture(scope="module")
def tendon_wrapped():
    hand = SrgHand(post=True, config=TENDON)
    hand.command(closure_commanded=1.0)
    hand.advance(3.5)
    return hand


@pytest.mark.slow
def test_wires_close_the_bases_first(tendon_wrapped):
    q, proximity = map(tendon_wrapped.array, ("state_measured", "proximity"))
    for base, tip in ((0, 2), (1, 3)):
        touched = np.flatnonzero(proximity[:, base] < 0.0)[0]
        # Its spring holds the tip on its stop until then.
        assert np.max(q[:touched, tip]) < 0.01
        assert q[-1, tip] > 0.5


@pytest.mark.slow
def test_the_plant_applies_all_torque_of_the_wires():
    # The model's effort limits are those of motors at the joints. They do not hold for
    # wires, whose moment arm at the base doubles as the finger closes.
    hand = SrgHand(post=True, config=TENDON)
    hand.command(closure_commanded=1.0, force_limit=1.0)
    hand.advance(2.0)
    net = hand.plant.get_net_actuation_output_port(hand.model)
    applied = net.Eval(hand.plant.GetMyContextFromRoot(hand.root))
    # The samples are a step apart, and the force still rises.
    assert applied == pytest.approx(hand.read("actuation"), rel=0.01)
    assert np.max(applied) > 2.1


def test_wires_pull_with_the_force_limit(tendon_wrapped):
    expected = TENDON.servo.force_limit * TENDON.drive.full_wire_force
    force = tendon_wrapped.read("wire_force")
    # Two seconds after the fingers close, seven time constants of wires and motor.
    assert force == pytest.approx([expected] * 2, rel=0.01)


@pytest.mark.slow
def test_wires_let_go(tendon_wrapped):
    tendon_wrapped.command(closure_commanded=0.0)
    tendon_wrapped.advance(4.0)
    assert tendon_wrapped.q == pytest.approx([0.0] * 4, abs=0.02)
    assert tendon_wrapped.read("wire_force") == pytest.approx([0.0, 0.0], abs=0.1)


@pytest.mark.slow
def test_wires_close_an_empty_hand_as_position_control_does():
    # The palm is level, so gravity acts along the hinges.
    for config in (TENDON, SrgPositionDriver()):
        hand = SrgHand(config=config)
        hand.command(closure_commanded=0.4)
        hand.advance(1.5)
        assert hand.q == pytest.approx([1.2, 1.2, 0.0, 0.0], abs=0.02)


def test_the_motor_goes_where_it_is_told():
    hand = SrgHand(config=TENDON)
    hand.command(closure_commanded=1.0, motor_position_commanded=0.8)
    hand.advance(1.5)
    # Within one count of the real servo's encoder, of 4096 per turn.
    assert hand.read("motor_state")[0] == pytest.approx(0.8, abs=2 * np.pi / 4096)


@pytest.mark.slow
def test_wires_pull_with_the_torque_that_the_motor_is_told():
    hand = SrgHand(post=True, config=TENDON)
    hand.command(motor_torque_commanded=0.2, motor_position_commanded=0.0)
    hand.advance(3.0)
    expected = 0.2 * TENDON.drive.full_wire_force
    assert hand.read("wire_force") == pytest.approx([expected] * 2, rel=0.01)
    # At rest, though wires and motor are a spring and a mass with no other damper.
    assert abs(hand.read("motor_state")[1]) < 1e-3


@pytest.mark.slow
def test_torque_control_closes_the_hand_fast_with_little_torque():
    # SAKE's driver closes the hand with 100 of 1023 in less than the 4 s that it waits.
    # At the speed that this much PWM gives, it would take longer.
    hand = SrgHand(config=TENDON)
    hand.command(motor_torque_commanded=0.125)
    hand.advance(2.0)
    assert hand.q[0] > 1.7


@pytest.mark.slow
def test_position_control_takes_over_where_torque_control_ends():
    hand = SrgHand(post=True, config=TENDON)
    hand.command(motor_torque_commanded=0.2, force_limit=0.2)
    hand.advance(2.0)
    held = hand.read("motor_state")[0]
    hand.command(motor_torque_commanded=np.nan, motor_position_commanded=held)
    for _ in range(30):
        hand.advance(0.02)
        # The spool stays, though the wires give way under this torque, 0.94 N m: two of
        # 2.5e4 N/m at 7.6 mm.
        assert abs(hand.read("motor_state")[0] - held) < 0.94 / 2.9


@pytest.mark.slow
def test_without_torque_the_springs_turn_the_motor_back():
    hand = SrgHand(config=TENDON)
    hand.command(closure_commanded=0.5)
    hand.advance(2.0)
    wound, before = hand.read("motor_state")[0], hand.q
    hand.command(motor_torque_commanded=0.0)
    hand.advance(2.0)
    # Slowly, with two wires of 1 N at 7.6 mm against a fifth of 0.91 N m s/rad.
    assert -0.3 < hand.read("motor_state")[0] - wound < -0.1
    assert np.all(hand.q[:2] < before[:2] - 0.05)


def test_pulling_warms_the_motor(tendon_wrapped):
    assert tendon_wrapped.read("motor_temperature")[0] > 25.0


def test_joints_with_rotors_of_their_own_are_refused():
    hand = SrgHand()
    with pytest.raises(ValueError, match="SetTendonDynamics"):
        SrgTendonDriver().AddDriver(DiagramBuilder(), hand.plant, hand.model)


CONTROL_PERIOD = 0.005
SLOW = TendonDriveConfig(dead_band=0.1, torque_rise=0.1)


def control(drive, torque, updates=1):
    system = TorqueControl(drive, CONTROL_PERIOD)
    context = system.CreateDefaultContext()
    fix(system, context, torque_desired=torque)
    for _ in range(updates):
        update(system, context)
    return system, context, read(system, context, "pwm_desired")[0]


@pytest.mark.parametrize("torque", [-0.8, -0.1, 0.3, 0.8])
def test_it_finds_the_pwm_that_gives_the_torque(torque):
    drive = TendonDriveConfig(dead_band=0.1)
    fast = dc.replace(drive, torque_rise=0.1 * CONTROL_PERIOD)
    for model, updates in ((drive, 1), (fast, 30), (SLOW, 300)):
        pwm = control(model, torque, updates)[2]
        assert model.useful_pwm(pwm) == pytest.approx(torque, abs=1e-3)


def test_it_rises_from_zero_at_the_rate_of_what_is_missing():
    assert control(SLOW, 0.5)[2] == pytest.approx(0.5 * CONTROL_PERIOD / 0.1)


def test_position_control_passes_and_resets_it():
    system, context, _ = control(SLOW, 0.5, 100)
    fix(system, context, torque_desired=np.nan)
    update(system, context)
    assert np.isnan(read(system, context, "pwm_desired")[0])
    fix(system, context, torque_desired=0.5)
    update(system, context)
    assert read(system, context, "pwm_desired")[0] == pytest.approx(0.025)
