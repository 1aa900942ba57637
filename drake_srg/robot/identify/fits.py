"""Fits of a gripper's motor, friction and heat to its log.

For each set point, the vendor's test goes to a position just beyond where the tips
meet, at full effort, and waits 1 s. It then presses, by position control with less
effort or by torque control, and reads the position every 66 ms until this changes by 5
counts or less. So a stop is read up to a quarter of a second after the press began,
while friction holds the wires' tension from the approach.
"""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence

import numpy as np

from drake_srg.robot.identify.least_squares import Fit, Parameter, fit
from drake_srg.robot.identify.log import RISE, LogRow
from drake_srg.types import Vector

COUNTS_PER_RAD = 4096 / math.tau
FULL_LOAD = 1023
TORQUE_UNIT = 4.5e-3  # A per unit of the goal torque
# Torque at the spool per ampere at stall, from the data sheet [N m/A].
TORQUE_CONSTANT = 6.0 / 4.1
NO_LOAD_SPEED = 6.6  # data sheet [rad/s]
# Goals of the test, relative to the calibrated zero [counts].
_APPROACH, _PRESS = -50.0, -250.0
# The simulated part of the approach: its start, and its time, after which all rests.
_START, _APPROACH_TIME = 450.0, 0.4  # counts, s
# A packet and its answer take 16 ms. The goal is the second packet of a press. The
# position is read at least twice, with 50 ms of waiting between reads.
_GOAL_AT, _FIRST_READ, POLL = 0.016, 0.032, 0.066  # s
_MOST_POLLS = 3
_STEP = 1e-3  # s

PRESS_PARAMETERS = (
    Parameter("stiffness", "N m/rad", 30.0, 3.0),
    Parameter("slack", "counts", 60.0, 2.0),
    # Springs open released fingers against `gear` and `gear_load`: they pull the spool
    # with 0.05 N m when the hand is open, 0.09 N m when it is closed.
    Parameter("gear", "N m", 0.015, 1.5),
    Parameter("gear_load", "", 0.4, 1.6),
    # Lubricated steel has 1.2 to 1.5.
    Parameter("stiction", "", 1.3, 1.3),
    Parameter("torque_rise", "s", 0.1, 3.0),
    Parameter("inertia", "kg m²", 0.01, 1.5),
    Parameter("position_gain", "PWM units per count", 4.0, 3.0),
)
# Stops fit at several local minima of friction and gain: try several starts.
STARTS = [
    {"position_gain": gain, "slack": slack, "gear_load": share}
    for gain in (4.0, 8.0, 14.0)
    for slack in (30.0, 60.0, 90.0)
    for share in (0.2, 0.4, 0.6)
]


@dc.dataclass(frozen=True)
class Motor:
    """The motor, as identified from the servo's registers; see `identify`.

    Attributes:
        stall_current: Estimated current at a PWM of 1 [A].
        dead_band: PWM, 0 .. 1, below which no current flows.
        most: Largest PWM of the servo, 0 .. 1.

    The first two may be arrays of shape (p, 1), for p motors at once.
    """

    stall_current: float | Vector
    dead_band: float | Vector
    most: float

    def current(self, pwm: Vector) -> Vector:
        """Return the estimated current at rest [A] for PWMs of -1 .. 1."""
        return self.stall_current * self.useful(pwm)

    def useful(self, pwm: Vector) -> Vector:
        """Return the current at rest for PWMs of -1 .. 1, as a share of stall's."""
        return _shrunk(pwm, self.dead_band) / (1.0 - self.dead_band)


def calibrated_zero(rows: Sequence[LogRow]) -> float:
    """Return the position that the test's calibration found as closed [counts].

    Calibration presses like the position rows, so it stops where most of them stop.
    """
    stops = [row.stop_counts for row in rows if row.test == "position"]
    return float(np.median(stops))


def polls(row: LogRow) -> int:
    """Return how many waits passed until the test noticed the stop."""
    if math.isnan(row.seconds):
        return 1
    before = 1.082 if row.test == "position" else 0.062
    return int(np.clip(round((row.seconds - before) / POLL), 1, _MOST_POLLS))


def predict_stops(
    rows: Sequence[LogRow],
    zero: float,
    motor: Motor,
    values: Mapping[str, float | Vector],
) -> Vector:
    """Return the stops of position and torque rows, shape (K,) [counts].

    Args:
        rows: Rows of these two tests.
        zero: Calibrated zero [counts].
        motor: The motor.
        values: Values of `PRESS_PARAMETERS` by name. With p values of each, shape
            (p, 1), the stops have shape (p, K).
    """
    setpoint = np.array([row.setpoint_pct for row in rows]) / 100.0
    by_torque = np.array([row.test == "torque" for row in rows])
    limit = np.minimum(setpoint, motor.most)
    # As a share of the stall current.
    goal = setpoint * FULL_LOAD * TORQUE_UNIT / motor.stall_current
    share, gear = values["gear_load"], values["gear"]
    stall = TORQUE_CONSTANT * motor.stall_current * (1.0 + share) + gear
    inertia, damping = values["inertia"], stall / NO_LOAD_SPEED
    gain = values["position_gain"] / FULL_LOAD
    stiction = np.maximum(values["stiction"], 1.0)
    free, stiffness = zero + values["slack"], values["stiffness"] / COUNTS_PER_RAD
    reads = _APPROACH_TIME + _FIRST_READ + POLL * np.arange(_MOST_POLLS + 1)
    read_at = {round(t / _STEP) for t in reads}
    total = inertia + _STEP * damping
    seen = []
    # All rows approach alike, so one column stands for all of them until they press.
    w = np.zeros(np.broadcast(free, setpoint[:1]).shape)
    x = w + zero + _START
    torque_pwm = np.zeros(np.broadcast(free, setpoint).shape)
    for k in range(max(read_at) + 1):
        t = k * _STEP - _APPROACH_TIME
        if t < 0.0:
            pwm = _within(gain * (x - zero - _APPROACH), -motor.most, motor.most)
        else:
            pressed = t >= _GOAL_AT
            wanted = goal if pressed else 0.0
            missing = wanted - motor.useful(torque_pwm)
            rise = _STEP * missing / values["torque_rise"]
            torque_pwm = _within(torque_pwm + rise, 0.0, motor.most)
            way = x - zero - (_PRESS if pressed else _APPROACH)
            position_pwm = _within(gain * way, -limit, limit)
            pwm = np.where(by_torque, torque_pwm, position_pwm)
        drive = stall * motor.useful(pwm)
        load = stiffness * np.maximum(free - x, 0.0)
        rests = w == 0.0
        w = (inertia * w + _STEP * (drive - load)) / total
        most = (gear + share * load) * (_STEP / total)
        rests = rests & (np.abs(w) <= stiction * most)
        w = np.where(rests, 0.0, _shrunk(w, most))
        x = x - _STEP * w * COUNTS_PER_RAD
        if k in read_at:
            seen.append(x.copy())
    chosen = [polls(row) for row in rows]
    columns = np.arange(len(rows))
    result: Vector = np.array(seen)[chosen, ..., columns].T
    return result


def _shrunk(values: Vector, by: Vector | float) -> Vector:
    """Return values moved towards 0 by an amount, at most to 0."""
    return values - _within(values, -by, by)


def _within(values: Vector, low: Vector | float, high: Vector | float) -> Vector:
    """Return the values of np.clip, which takes five times as long for few values."""
    result: Vector = np.minimum(np.maximum(values, low), high)
    return result


SUPPLY, AIR = 12.0, 25.0  # V, degC; the vendor logged neither
# Stands for "never", if losses to the air keep the motor from warming by `RISE` [s].
NEVER = 3600.0
# Between these times, the temperature is nearly linear.
_TIMES = np.arange(0.0, NEVER + 0.5)  # s

# The priors follow from data sheet and geometry (see MotorTemperatureConfig), and from
# the standby current of 0.1 A in the manual.
HEAT_PARAMETERS = (
    Parameter("heat_capacity", "J/K", 113.0, 2.0),
    Parameter("thermal_resistance", "K/W", 7.6, 1.5),
    Parameter("idle_power", "W", 1.2, 2.0),
    Parameter("winding_time", "s", 10.0, 1.5),
)


def losses(current: Vector, motor: Motor) -> Vector:
    """Return the heat of windings, brushes and bridge [W] at a current [A]."""
    lost = motor.dead_band * SUPPLY
    resistance = (SUPPLY - lost) / motor.stall_current
    result: Vector = current**2 * resistance + current * lost
    return result


def predict_seconds(
    rows: Sequence[LogRow], motor: Motor, values: Mapping[str, float | Vector]
) -> Vector:
    """Return the times of heating rows, shape (K,) [s], at most `NEVER`.

    Args:
        rows: Rows of the test `heating`.
        motor: The motor.
        values: Values of `HEAT_PARAMETERS` by name. With p values of each, shape
            (p, 1), the times have shape (p, K).
    """
    idle, resistance = values["idle_power"], values["thermal_resistance"]
    winding = values["winding_time"]
    times = []
    for row in rows:
        power, before = (
            losses(np.nan_to_num(current) / 1e3, motor) + idle
            for current in (row.current_ma, row.before_ma)
        )
        body = resistance * values["heat_capacity"]
        decay = np.exp(-_TIMES / body)
        # The heat flow from the winding starts with a lag, see MotorTemperature.
        lag = np.exp(-_TIMES / winding) - decay
        lag = (before - power) * resistance * winding / (winding - body) * lag
        start = row.temperature_c
        rise = (AIR + power * resistance - start) * (1.0 - decay) + lag
        times.append(_first(np.atleast_2d(rise)))
    result: Vector = np.stack(times, axis=-1)
    return result if np.ndim(resistance) else result[0]


def _first(rise: Vector) -> Vector:
    """Return when each row of temperatures at `_TIMES` first reaches `RISE` [s]."""
    over = rise >= RISE
    k = np.argmax(over, axis=1)
    reached, row = over[np.arange(len(rise)), k], np.arange(len(rise))
    before, after = rise[row, np.maximum(k - 1, 0)], rise[row, k]
    part = (RISE - before) / np.where(reached, after - before, 1.0)
    return np.where(reached, _TIMES[k] - 1.0 + part, NEVER)


# Standard deviations of the measurements, from differences of specimens and repeats.
CURRENT_SHARE, STOP_COUNTS, HEATING_SHARE = 0.05, 3.0, 0.1

_MOTOR = (
    Parameter("stall_current", "A", 4.1, 2.0),
    Parameter("dead_band", "of full PWM", 0.05, 3.0),
)


@dc.dataclass(frozen=True)
class Error:
    """A measurement and its prediction.

    Attributes:
        quantity: `current`, `stop` or `heating`.
        fitted: Prediction by the fit to all rows.
        predicted: Prediction by the fit to the other half of the rows.
        allowed: Largest deviation that agrees with the measurement.
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
    """Parameters identified from a log.

    Attributes:
        motor: The motor.
        zero: Calibrated zero [counts].
        fits: The fits of `motor`, `press` and `heat`.
        errors: One for each quantity of each row.
    """

    motor: Motor
    zero: float
    fits: dict[str, Fit]
    errors: Sequence[Error]


def identify(rows: Sequence[LogRow]) -> Identification:
    """Fit all rows, then each half of them to predict the other half.

    A half has every second row of each test.
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
            _QUANTITIES[quantity][1],
            measured := getattr(row, _QUANTITIES[quantity][0]),
            value,
            other[quantity, id(row)],
            6.0 if quantity == "stop" else 0.1 * measured,
        )
        for quantity, row, value in whole
    ]
    return Identification(motor, zero, fits, errors)


# Column of a row and unit, by quantity.
_QUANTITIES = {
    "current": ("current_ma", "mA"),
    "stop": ("stop_counts", "counts"),
    "heating": ("seconds", "s"),
}


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
