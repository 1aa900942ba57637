import math

import pytest
from helpers import fix, read, update
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.gripper.tendon import (
    MotorTemperature,
    MotorTemperatureConfig,
    TendonDriveConfig,
    motor_load,
)

DRIVE = TendonDriveConfig()
# A period so long that the motor settles within a few updates.
QUICK = MotorTemperatureConfig(period=2000.0)


def make(pwm=0.0, speed=0.0, config=None):
    system = MotorTemperature(DRIVE, config)
    context = system.CreateDefaultContext()
    fix(system, context, pwm=pwm, motor_state=[0.3, speed])
    return system, context


def temperature(system, context, updates=1):
    for _ in range(updates):
        update(system, context)
    return read(system, context, "motor_temperature")[0]


def test_the_motor_starts_at_the_temperature_of_the_air():
    system, context = make(pwm=1.0)
    assert read(system, context, "motor_temperature") == [25.0]


def test_a_stalled_motor_settles_where_the_air_takes_all_copper_loss():
    # At a fifth of the stall torque, 0.82 A flow through 12 V / 4.1 A, at 7.6 K/W.
    loss = 0.82**2 * 12.0 / 4.1
    settled = temperature(*make(pwm=0.2 / DRIVE.full_scale, config=QUICK), updates=20)
    assert settled == pytest.approx(25.0 + 7.6 * loss)
    assert settled == pytest.approx(40.0, abs=0.1)


def test_the_first_rise_is_the_loss_over_the_heat_capacity():
    # In the first 0.1 s, the air takes nothing. All loss goes into 113 J/K.
    loss = DRIVE.full_scale**2 * 4.1 * 12.0
    rise = temperature(*make(pwm=1.0)) - 25.0
    assert rise == pytest.approx(loss * 0.1 / 113.0, rel=1e-3)


def test_the_motor_cools_with_its_time_constant():
    config = MotorTemperatureConfig()
    system, context = make(config=config)
    context.SetDiscreteState([80.0])
    cooled = temperature(system, context, updates=round(config.time_constant / 0.1))
    assert cooled - 25.0 == pytest.approx(55.0 / math.e, rel=1e-3)
    # Most of the heat is gone after the 20 minutes for which the manual asks to wait.
    assert 10 * 60 < config.time_constant < 20 * 60


def test_heat_comes_later_by_the_time_that_the_windings_take():
    slow = MotorTemperatureConfig(winding_time=10.0)
    # When most is in the housing, it lags by the mean of an exponential delay.
    late = temperature(*make(pwm=1.0, config=slow), updates=600)
    early = temperature(*make(pwm=1.0), updates=500)
    assert late == pytest.approx(early, rel=5e-3)
    settled = MotorTemperatureConfig(winding_time=10.0, period=2000.0)
    same = temperature(*make(pwm=0.3, config=settled), updates=20)
    assert same == pytest.approx(temperature(*make(0.3, config=QUICK), updates=20))


def test_the_heat_of_the_windings_arrives_after_the_current_has_ended():
    system, context = make(pwm=1.0, config=MotorTemperatureConfig(winding_time=10.0))
    before = temperature(system, context, updates=50)
    fix(system, context, pwm=0.0)
    # 30 W for 5 s leave 12 W on the way, of which 47 J arrive in the next 5 s.
    after = temperature(system, context, updates=50)
    assert after - before == pytest.approx(47.0 / 113.0, rel=0.02)


def test_without_load_no_current_flows():
    speed = DRIVE.full_scale * DRIVE.no_load_speed
    assert motor_load(DRIVE, 1.0, speed) == pytest.approx(0.0)
    assert temperature(*make(pwm=1.0, speed=speed)) == pytest.approx(25.0)


@given(st.floats(-1.0, 1.0), st.floats(-7.0, 7.0), st.floats(1e-3, 1e5))
def test_a_motor_never_cools_below_the_air(pwm, speed, period):
    config = MotorTemperatureConfig(period=period)
    assert temperature(*make(pwm, speed, config), updates=3) >= 25.0
