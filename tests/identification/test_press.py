import math

import numpy as np
import pytest

from drake_srg.identification.log import LogRow, vendor_log
from drake_srg.identification.press import (
    PRESS_PARAMETERS,
    Motor,
    calibrated_zero,
    polls,
    predict_stops,
)

MOTOR = Motor(stall_current=2.88, dead_band=0.12, most=0.965)
VALUES = {p.name: p.prior for p in PRESS_PARAMETERS} | {"position_gain": 8.0}
TORQUES = [LogRow("torque", float(p), seconds=0.256) for p in range(20, 80, 10)]


def test_current_starts_at_the_dead_band_and_ends_at_the_stall_current():
    current = MOTOR.current(np.array([0.0, 0.12, -0.12, 1.0, -1.0]))
    assert current == pytest.approx([0.0, 0.0, 0.0, 2.88, -2.88])


def test_more_torque_closes_further():
    stops = predict_stops(TORQUES, 2810.0, MOTOR, VALUES)
    assert np.all(np.diff(stops) <= 0.0)
    assert stops[0] > stops[-1] + 5.0


def test_friction_keeps_what_the_approach_has_wound_up():
    weak = [LogRow("position", 40.0, seconds=1.15)]
    stops = [
        predict_stops(weak, 2810.0, MOTOR, VALUES | {"gear_load": share})[0]
        for share in (0.01, 0.7)
    ]
    assert stops[1] < stops[0]


def test_a_stop_counts_from_the_calibrated_zero():
    low, high = (predict_stops(TORQUES, z, MOTOR, VALUES) for z in (2000.0, 2810.0))
    assert high - low == pytest.approx(810.0)
    assert calibrated_zero(vendor_log()) == 2811.0


@pytest.mark.parametrize(
    ("test", "seconds", "expected"),
    [
        ("position", 1.15, 1),
        ("position", 1.22, 2),
        ("torque", 0.128, 1),
        ("torque", 0.192, 2),
        ("torque", 0.256, 3),
        ("torque", math.nan, 1),
    ],
)
def test_the_test_tells_how_often_it_waited(test, seconds, expected):
    assert polls(LogRow(test, 20.0, seconds=seconds)) == expected
