"""A simulated gripper beside a real one: currents, stops and heat by the registers.

The vendor's test runs on the data-sheet model (`gripper_bench`) and on the specimen
that `drake-srg identify` made of the vendor's log (`srg_specimen`). Rows of the
specimen are judged: 10 % for currents and times, 6 counts for stops.
"""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.servo_stand import ServoStand
from drake_srg.experiments.vendor_test import VendorTest, press_bench, warm
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.robot.identify.fits import FULL_LOAD, calibrated_zero
from drake_srg.robot.identify.log import LogRow, vendor_log
from drake_srg.scenario import load_scenario

MODELS = {"data sheet": "gripper_bench", "specimen": "srg_specimen"}
_SHARE, _COUNTS = 0.1, 6.0
_WARM = "time to warm by 5 degrees"
# Of the firmware's position control, PWM units per count: the MX-64's default gain, and
# what `drake-srg identify` makes of the log (where it is tied to the rotor's inertia).
GAINS = {"data sheet": 4.0, "specimen": 7.66}
# Read in whole degrees, a rise of 5 may be one of 4.5 to 5.5.
_HEATING_SHARE = 0.1
# Rows that the model of the specimen is known to miss, by label and quantity.
_COULOMB = "one Coulomb friction cannot hold at 30 % and let go at 20 %"
_CREEPS = "still winds in when the script reads it"
_DEGREES = "off by about as much as whole degrees allow"
_KNOWN = {
    ("position 20 %", "stop"): _COULOMB,
    ("position 30 %", "stop"): _COULOMB,
    **{(f"torque {share} %", "stop"): _CREEPS for share in (50, 65, 70, 75)},
    ("heating 20 %", _WARM): _DEGREES,
    ("heating 40 %", _WARM): _DEGREES,
}


def run(track: Track) -> ExperimentResult:
    """Run the vendor's test on both models.

    Args:
        track: Shows progress.
    """
    measured = vendor_log()
    most = max(row.load for row in measured if row.test != "heating") / FULL_LOAD
    cases = [(model, row) for model in MODELS for row in measured]
    simulated: dict[str, list[LogRow]] = {model: [] for model in MODELS}
    tests: dict[str, tuple[ServoStand, VendorTest]] = {}
    for model, row in track(cases, label=lambda c: f"{c[0]}, {c[1].label}"):
        if row.test == "heating":
            gripper = load_scenario(MODELS[model]).gripper
            assert gripper is not None and gripper.wire_motor is not None
            seconds = warm(gripper.wire_motor, row)
            simulated[model].append(dc.replace(row, seconds=seconds))
            continue
        if model not in tests:
            stand = ServoStand(press_bench(MODELS[model], most, GAINS[model]), model)
            tests[model] = stand, VendorTest(stand)
        simulated[model].append(tests[model][1].press(row))
    rows = [row for m in MODELS for row in judge(m, measured, simulated[m])]
    table = _table(measured, simulated)
    return ExperimentResult(rows, {"rows": table}, _draw(measured, simulated))


def judge(
    model: str, measured: Sequence[LogRow], simulated: Sequence[LogRow]
) -> list[Row]:
    """Compare rows; those of the specimen are judged, the others only told."""
    judged, rows = model == "specimen", []
    offset = calibrated_zero(simulated) - calibrated_zero(measured)

    def add(
        label: str, what: str, real: float, ours: float, unit: str, allowed: float
    ) -> None:
        name = f"{model}, {label}"
        quantity = f"{what} (real {real:.4g})"
        if judged:
            row = Row.within(name, what, real, ours, unit, absolute=allowed)
            reason = _KNOWN.get((label.partition(",")[0], what), "")
            rows.append(row.because(reason))
        else:
            rows.append(Row.info(name, quantity, ours, unit))

    for real, ours in zip(measured, simulated, strict=True):
        if real.test == "heating":
            seconds, allowed = real.seconds, _HEATING_SHARE * real.seconds
            add(
                f"{real.label}, from {real.temperature_c:g} degC",
                _WARM,
                *(seconds, ours.seconds, "s", allowed),
            )
            continue
        current = real.current_ma
        add(real.label, "current", current, ours.current_ma, "mA", _SHARE * current)
        stop = ours.stop_counts - offset
        add(real.label, "stop", real.stop_counts, stop, "counts", _COUNTS)
        time = real.seconds
        if real.test == "position":  # by torque, it is the test's own waiting alone
            allowed = _SHARE * time
            add(real.label, "time until noticed", time, ours.seconds, "s", allowed)
    return rows


def _table(
    measured: Sequence[LogRow], simulated: Mapping[str, Sequence[LogRow]]
) -> dict[str, Any]:
    table: dict[str, Any] = {
        "test": [row.test for row in measured],
        "setpoint_pct": [row.setpoint_pct for row in measured],
    }
    for name, rows in {"real": measured, **simulated}.items():
        for field in ("load", "stop_counts", "current_ma", "seconds"):
            table[f"{name}: {field}"] = [float(getattr(row, field)) for row in rows]
    return table


def _draw(measured: Sequence[LogRow], simulated: Mapping[str, Sequence[LogRow]]) -> Any:
    figure = make_figure(11.0, 4.0, "A real gripper and its models")
    axes = figure.subplots(1, 4)
    panels = (
        ("position", "current_ma", "position control", "estimated current [mA]"),
        (
            "position",
            "stop_counts",
            "position control",
            "stop, from most stops [counts]",
        ),
        ("torque", "stop_counts", "torque control", "stop, from most stops [counts]"),
        ("heating", "seconds", "heating", "time to warm by 5 degrees [s]"),
    )
    styles = {
        "real": {"marker": "o", "ls": "", "color": "black", "mfc": "none"},
        "data sheet": {"color": COLORS[1], "ls": "--", "marker": "."},
        "specimen": {"color": COLORS[0], "marker": "."},
    }
    for panel, (test, field, title, label) in zip(axes, panels, strict=True):
        style_axes(panel, xlabel="set point [%]", ylabel=label)
        panel.set_title(title, fontsize=9, loc="left")
        for name, rows in {"real": measured, **simulated}.items():
            shift = calibrated_zero(rows) if field == "stop_counts" else 0.0
            points = sorted(
                (row.setpoint_pct, getattr(row, field) - shift)
                for row in rows
                if row.test == test
            )
            shown = [(x, y) for x, y in points if math.isfinite(y)]
            panel.plot(*np.array(shown).T, label=name, ms=4, lw=1.0, **styles[name])
        if field == "stop_counts":
            panel.set_ylim(-120.0, 80.0)
        if field == "seconds":
            panel.set_yscale("log")
    axes[0].legend(fontsize=8, frameon=False)
    return figure
