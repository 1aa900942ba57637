import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.experiments.response import overshoot, rise_time, rms, settling_time

TIME = np.linspace(0.0, 10.0, 10_001)


@given(lag=st.floats(0.05, 1.0), start=st.floats(-2, 2), step=st.floats(0.1, 2))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_first_order_lag_rises_in_its_time_constant_times_log_9(
    lag, start, step, sign
):
    end = start + sign * step
    q = start + (end - start) * (1 - np.exp(-TIME / lag))
    assert rise_time(TIME, q, start, end) == pytest.approx(lag * np.log(9), rel=1e-3)
    assert overshoot(q, start, end) == pytest.approx(0.0, abs=1e-12)
    band = 0.02 * step
    expected = lag * np.log(50)
    assert settling_time(TIME, q - end, band) == pytest.approx(expected, abs=2e-3)


@given(damping=st.floats(0.05, 0.8))
def test_a_second_order_lag_overshoots_by_its_damping(damping):
    w, root = 20.0, np.sqrt(1 - damping**2)
    phase = w * root * TIME
    swing = np.cos(phase) + damping / root * np.sin(phase)
    q = 1 - np.exp(-damping * w * TIME) * swing
    expected = np.exp(-np.pi * damping / root)
    assert overshoot(q, 0.0, 1.0) == pytest.approx(expected, abs=1e-3)


def test_a_response_that_never_arrives_has_no_times():
    assert np.isnan(rise_time(TIME, 0.08 * TIME, 0.0, 1.0))
    assert np.isnan(settling_time(TIME, np.sin(TIME), 0.1))


def test_a_response_that_starts_at_the_end_has_settled_at_once():
    assert settling_time(TIME, 0.0 * TIME, 0.1) == 0.0
    assert rise_time(TIME, 1.0 + 0.0 * TIME, 0.0, 1.0) == 0.0


def test_rms_of_a_sine():
    assert rms(3.0 * np.sin(2 * np.pi * TIME[:-1])) == pytest.approx(3 / np.sqrt(2))
