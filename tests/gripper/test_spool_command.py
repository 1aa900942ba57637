import numpy as np
import pytest
from helpers import fix, port_table, read, update
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.gripper.moment_arms import wire_travel
from drake_srg.gripper.spool_command import (
    SpoolCommand,
    SpoolCommandConfig,
    spool_angle,
)

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


def test_ports():
    assert port_table(SpoolCommand(RADIUS)) == (
        {
            "closure_commanded": 1,
            "motor_state": 2,
            "triggered": 4,
            "hold": 1,
            "motor_position_commanded": 1,
            "motor_torque_commanded": 1,
        },
        {"angle_desired": 1, "torque_desired": 1},
    )


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
