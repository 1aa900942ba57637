"""How long the servo takes to warm by 5 degrees: one heat capacity, one resistance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drake_srg.identification.least_squares import Parameter
from drake_srg.identification.log import LogRow
from drake_srg.identification.press import Motor
from drake_srg.types import Vector

RISE = 5.0  # K
SUPPLY, AIR = 12.0, 25.0  # V, degC; the vendor logged neither
# Time to warm by RISE with no loss to the air at all stands for "never" where the loss
# stops it [s].
NEVER = 3600.0

# Priors: data sheet and geometry (see MotorTemperatureConfig), and the standby current
# of 0.1 A of the manual.
HEAT_PARAMETERS = (
    Parameter("heat_capacity", "J/K", 113.0, 2.0),
    Parameter("thermal_resistance", "K/W", 7.6, 1.5),
    Parameter("idle_power", "W", 1.2, 2.0),
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
    """Return the times of heating rows, shape (K,) [s]; `NEVER` at most.

    Args:
        rows: Of the test `heating`.
        motor: The motor.
        values: Of `HEAT_PARAMETERS` by name; with p of each, shape (p, 1), the times
            are (p, K).
    """
    current = np.array([row.current_ma for row in rows]) / 1e3
    power = losses(current, motor) + values["idle_power"]
    resistance = values["thermal_resistance"]
    start = np.array([row.temperature_c for row in rows])
    left = AIR + power * resistance - start  # K to where it settles
    share = np.where(left > RISE, RISE / np.maximum(left, RISE), 1.0)
    with np.errstate(divide="ignore"):  # infinite where it never gets there
        times = -resistance * values["heat_capacity"] * np.log1p(-share)
    result: Vector = np.minimum(times, NEVER)
    return result
