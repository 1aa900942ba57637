"""What an identified gripper changes: payload, closing and creep beside the data sheet.

At the same command, the gripper of `drake-srg identify` (`srg_specimen`) pulls its
wires less than the data-sheet model (`gripper_bench`). Does it still hold 5 kg wrapped
and 2.5 kg between the pads?
"""

from __future__ import annotations

from typing import Any

import numpy as np

from drake_srg.experiments.hold_drift import creep, things
from drake_srg.experiments.payload_hold import HOLD, Load, hold
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.simulation.rig import Rig, bench_scenario

MODELS = {"data sheet": "gripper_bench", "specimen": "srg_specimen"}
# Claimed masses [kg].
CLAIMS = {"wrap": 5.0, "pinch": 2.5}
_DIRECTIONS = ("down", "side")
# A wire force as in `payload_pinch` for the creep of a held can and box, 0.35 of the
# data-sheet model's full PWM [N].
_CREEP_FORCE = 107.0
_CLOSED = 0.98  # of the sum of the joint angles at which the hand ends


def drive_of(model: str) -> TendonDriveConfig:
    """Return the drive of one of `MODELS`."""
    gripper = load_scenario(MODELS[model]).gripper
    assert gripper is not None and gripper.wire_motor is not None
    return gripper.wire_motor.drive


def closing_time(scenario: str, effort: float) -> float:
    """Return the time in which the empty hand closes [s]; NaN if it does not.

    Args:
        scenario: The bench.
        effort: Force limit of the servo.
    """
    bench = bench_scenario(
        gripper_rpy=[0.0, 0.0, 0.0],
        scenario=scenario,
        overrides=["object.present=false"],
    )
    with Rig(bench, name="specimen") as rig:
        rig.advance(0.1)
        rig.advance(3.0, closure=0.65, force_limit=effort)
        log = rig.log()
    q = log["gripper.state_measured"][:, :4].sum(axis=1)
    done = q >= _CLOSED * q[-1]
    return float(log["time"][np.argmax(done)]) - 0.1 if q[-1] > 3.0 else np.nan


def run(track: Track, *, effort: float = 0.8) -> ExperimentResult:
    """Hold the claimed masses, close and hold still with both models.

    Args:
        track: Shows progress.
        effort: Share of the servo's range, 0 .. 1, of SAKE's driver.
    """
    rows: list[Row] = []
    table: dict[str, list[Any]] = {
        "model": [],
        "grip": [],
        "direction": [],
        "wire_force_n": [],
        "held_for_s": [],
        "slip_mm": [],
        "creep_um_per_s": [],
    }
    cases = [(m, g, d) for m in MODELS for g in CLAIMS for d in _DIRECTIONS]
    for model, grip, direction in track(cases, label=", ".join):
        force = drive_of(model).wire_force_of(effort)
        load = Load(grip, direction, CLAIMS[grip], force)
        held = hold(load, MODELS[model])
        case = f"{model}, {grip}, {direction}"
        what = f"{load.mass:g} kg held for"
        rows += [
            Row.at_least(case, what, HOLD, held.held_for, "s"),
            Row.info(case, "slip while the load comes on", 1e3 * held.slip, "mm"),
            Row.info(case, "creep while held", 1e6 * held.creep / HOLD, "um/s"),
        ]
        values = (model, grip, direction, force, held.held_for)
        ends = (1e3 * held.slip, 1e6 * held.creep / HOLD)
        for column, value in zip(table.values(), (*values, *ends), strict=True):
            column.append(value)
    for model in track(list(MODELS), label=lambda m: f"{m}, closing and creep"):
        rows += _closing_and_creep(model, effort)
    return ExperimentResult(rows, {"loads": table}, _draw(effort))


def _closing_and_creep(model: str, effort: float) -> list[Row]:
    drive, scenario = drive_of(model), MODELS[model]
    share = f"{100 * effort:g} %"
    force = drive.wire_force_of(effort)
    rows = [
        Row.info(model, f"wire force at {share} effort", force, "N"),
        Row.info(model, "wire force at full effort", drive.full_wire_force, "N"),
    ]
    for limit in (effort, 1.0):
        time = closing_time(scenario, limit)
        what = f"closing time at {100 * limit:g} % effort"
        rows.append(Row.info(model, what, time, "s"))
    for name, (thing, height) in things().items():
        limit = drive.force_limit_of(_CREEP_FORCE)
        _, moved = creep(thing, height, scenario, {}, force_limit=limit)
        rate = 1e6 * moved[-1] / 10.0
        what = f"creep, {_CREEP_FORCE:g} N per wire"
        rows.append(Row.info(f"{model}, {name}", what, rate, "um/s"))
    return rows


def _draw(effort: float) -> Any:
    figure = make_figure(5.5, 3.6, "Wire force of both models")
    axes = figure.subplots()
    style_axes(axes, xlabel="effort [%]", ylabel="force of each wire [N]")
    efforts = np.linspace(0.0, 1.0, 101)
    for model, color in zip(MODELS, (COLORS[1], COLORS[0]), strict=True):
        drive = drive_of(model)
        forces = [drive.wire_force_of(x) for x in efforts]
        axes.plot(100 * efforts, forces, color=color, label=model)
    axes.axvline(100 * effort, color=COLORS[-1], lw=0.8, ls="--")
    axes.set_ylim(0.0)
    axes.legend(fontsize=8, frameon=False)
    return figure
