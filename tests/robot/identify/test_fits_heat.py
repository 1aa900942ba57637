import math

import pytest
from helpers import fix, read, update
from hypothesis import assume, given
from hypothesis import strategies as st

from drake_srg.gripper.tendon import (
    MotorTemperature,
    MotorTemperatureConfig,
    TendonDriveConfig,
)
from drake_srg.robot.identify.fits import (
    AIR,
    HEAT_PARAMETERS,
    NEVER,
    Motor,
    predict_seconds,
)
from drake_srg.robot.identify.log import RISE, LogRow

MOTOR = Motor(stall_current=3.0, dead_band=0.1, most=1.0)
VALUES = {p.name: p.prior for p in HEAT_PARAMETERS}


def seconds(current_ma, start=AIR, before=math.nan, motor=MOTOR):
    row = LogRow(
        *("heating", 30.0),
        current_ma=current_ma,
        temperature_c=start,
        before_ma=before,
    )
    return predict_seconds([row], motor, VALUES)[0]


def test_much_current_warms_the_heat_capacity_alone():
    # 12 V and 3 A at stall, all of it heat, and 1.2 W of electronics.
    power = 12.0 * 3.0 + 1.2
    assert seconds(3000.0, before=3000.0) == pytest.approx(
        5.0 * 113.0 / power, rel=0.02
    )


def test_the_heat_of_the_current_before_is_on_its_way():
    same, rested, hot = (seconds(1000.0, before=b) for b in (1000.0, math.nan, 2000.0))
    assert hot < same < rested < same + VALUES["winding_time"]


@given(st.floats(300.0, 2000.0), st.floats(0.0, 2000.0), st.floats(25.0, 40.0))
def test_the_times_are_those_of_the_simulated_motor(current, before, start):
    """The system in Drake and the fit have the same heat."""
    config = MotorTemperatureConfig(
        stall_current=MOTOR.stall_current,
        period=0.25,  # it integrates exactly
        **{name: VALUES[name] for name in VALUES},
    )
    drive = TendonDriveConfig(dead_band=MOTOR.dead_band)
    system = MotorTemperature(drive, config)
    expected = seconds(current, start, before)
    assume(expected < 1000.0)
    context = system.CreateDefaultContext()
    pwm = drive.pwm_of(current / 1e3 / MOTOR.stall_current / drive.full_scale)
    assume(pwm < 1.0)
    fix(system, context, pwm=pwm, motor_state=[0.0, 0.0])
    context.SetDiscreteState(0, [start])
    context.SetDiscreteState(1, [system.heat(before / 1e3 / MOTOR.stall_current)])
    for _ in range(round(expected / config.period)):
        update(system, context)
    (reached,) = read(system, context, "motor_temperature")
    assert reached - start == pytest.approx(RISE, abs=0.1)


@given(st.floats(50.0, 3000.0), st.floats(0.0, 60.0))
def test_it_takes_longer_with_less_current_and_from_warmer(current, start):
    assert seconds(0.9 * current, start) >= seconds(current, start)
    assert seconds(current, start + 1.0) >= seconds(current, start)


def test_it_never_warms_beyond_where_the_air_takes_all_heat():
    assert seconds(100.0, start=60.0) == NEVER
