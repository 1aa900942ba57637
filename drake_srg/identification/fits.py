"""Fits a gripper's motor, friction and heat to its log, and tests the fits."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np

from drake_srg.identification.heat import HEAT_PARAMETERS, predict_seconds
from drake_srg.identification.least_squares import Fit, Parameter, fit
from drake_srg.identification.log import LogRow
from drake_srg.identification.press import (
    FULL_LOAD,
    PRESS_PARAMETERS,
    STARTS,
    Motor,
    calibrated_zero,
    predict_stops,
)
from drake_srg.types import Vector

# Standard deviations of the measurements: what specimens and repeats differ by.
CURRENT_SHARE, STOP_COUNTS, HEATING_SHARE = 0.05, 3.0, 0.1

_MOTOR = (
    Parameter("stall_current", "A", 4.1, 2.0),
    Parameter("dead_band", "of full PWM", 0.05, 3.0),
)


@dc.dataclass(frozen=True)
class Error:
    """A measurement and its prediction.

    Attributes:
        label: The test.
        quantity: `current`, `stop` or `heating`.
        unit: Of the values.
        measured: The measurement.
        fitted: Prediction by the fit to all rows.
        predicted: Prediction by the fit to the other half of the rows.
        allowed: Deviation that agrees with the measurement.
    """

    label: str
    quantity: str
    unit: str
    measured: float
    fitted: float
    predicted: float
    allowed: float


@dc.dataclass(frozen=True)
class Identification:
    """What a log tells.

    Attributes:
        motor: The motor as its registers show it.
        zero: Calibrated zero [counts].
        fits: By part: `motor`, `press` and `heat`.
        errors: Of every measurement.
    """

    motor: Motor
    zero: float
    fits: dict[str, Fit]
    errors: Sequence[Error]


def identify(rows: Sequence[LogRow]) -> Identification:
    """Fit all rows, then each half of them to predict the other.

    The halves are every second row of each test.
    """
    motor, zero, fits = _fit(rows)
    whole = _predict(rows, motor, zero, fits)
    halves: list[list[LogRow]] = [[], []]
    for test in ("position", "torque", "heating"):
        for i, row in enumerate(r for r in rows if r.test == test):
            halves[i % 2].append(row)
    other: dict[tuple[str, int], float] = {}
    for fitted, left in (halves, halves[::-1]):
        half = _fit(fitted, motor.most)
        predicted = _predict(left, half[0], zero, half[2])
        other.update({(q, id(row)): v for q, row, v in predicted})
    errors = [
        Error(
            row.label,
            quantity,
            _UNITS[quantity],
            measured := _measured(row, quantity),
            value,
            other[quantity, id(row)],
            6.0 if quantity == "stop" else 0.1 * measured,
        )
        for quantity, row, value in whole
    ]
    return Identification(motor, zero, fits, errors)


_UNITS = {"current": "mA", "stop": "counts", "heating": "s"}


def _measured(row: LogRow, quantity: str) -> float:
    return {
        "current": row.current_ma,
        "stop": row.stop_counts,
        "heating": row.seconds,
    }[quantity]


def _pressing(rows: Sequence[LogRow]) -> list[LogRow]:
    return [row for row in rows if row.test != "heating"]


def _heating(rows: Sequence[LogRow]) -> list[LogRow]:
    return [row for row in rows if row.test == "heating"]


def _fit(
    rows: Sequence[LogRow], most: float | None = None
) -> tuple[Motor, float, dict[str, Fit]]:
    pressing, heating = _pressing(rows), _heating(rows)
    if most is None:
        most = max(row.load for row in pressing) / FULL_LOAD
    fits = {"motor": fit(_MOTOR, lambda values: _current_errors(pressing, values))}
    motor = Motor(**fits["motor"].values, most=most)
    zero = calibrated_zero(rows)
    stops = np.array([row.stop_counts for row in pressing])
    fits["press"] = fit(
        PRESS_PARAMETERS,
        lambda v: (predict_stops(pressing, zero, motor, v) - stops) / STOP_COUNTS,
        starts=STARTS,
    )
    seconds = np.array([row.seconds for row in heating])
    fits["heat"] = fit(
        HEAT_PARAMETERS,
        lambda v: np.log(predict_seconds(heating, motor, v) / seconds) / HEATING_SHARE,
    )
    return motor, zero, fits


def _current_errors(rows: Sequence[LogRow], values: dict[str, Vector]) -> Vector:
    motor = Motor(**values, most=1.0)
    load = np.array([row.load for row in rows]) / FULL_LOAD
    current = np.array([row.current_ma for row in rows]) / 1e3
    result: Vector = (motor.current(load) / current - 1.0) / CURRENT_SHARE
    return result


def _predict(
    rows: Sequence[LogRow], motor: Motor, zero: float, fits: dict[str, Fit]
) -> list[tuple[str, LogRow, float]]:
    pressing, heating = _pressing(rows), _heating(rows)
    load = np.array([row.load for row in pressing]) / FULL_LOAD
    parts = (
        ("current", pressing, 1e3 * motor.current(load)),
        (
            "stop",
            pressing,
            predict_stops(pressing, zero, motor, fits["press"].values),
        ),
        (
            "heating",
            heating,
            predict_seconds(heating, motor, fits["heat"].values),
        ),
    )
    return [
        (quantity, row, float(value))
        for quantity, part, values in parts
        for row, value in zip(part, values, strict=True)
    ]
