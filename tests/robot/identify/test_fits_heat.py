import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.robot.identify.fits import (
    AIR,
    HEAT_PARAMETERS,
    NEVER,
    Motor,
    predict_seconds,
)
from drake_srg.robot.identify.log import LogRow

MOTOR = Motor(stall_current=3.0, dead_band=0.1, most=1.0)
VALUES = {p.name: p.prior for p in HEAT_PARAMETERS}


def seconds(current_ma, start=AIR, motor=MOTOR):
    row = LogRow("heating", 30.0, current_ma=current_ma, temperature_c=start)
    return predict_seconds([row], motor, VALUES)[0]


def test_much_current_warms_the_heat_capacity_alone():
    # 12 V and 3 A at stall, all of it heat, and 1.2 W of electronics.
    power = 12.0 * 3.0 + 1.2
    assert seconds(3000.0) == pytest.approx(5.0 * 113.0 / power, rel=0.02)


@given(st.floats(50.0, 3000.0), st.floats(0.0, 60.0))
def test_it_takes_longer_with_less_current_and_from_warmer(current, start):
    assert seconds(0.9 * current, start) >= seconds(current, start)
    assert seconds(current, start + 1.0) >= seconds(current, start)


def test_it_never_warms_beyond_where_the_air_takes_all_heat():
    assert seconds(100.0, start=60.0) == NEVER
