"""The claimed payload, held with the palm down and to the side, and the largest mass.

`payload_wrap` has the fingers envelop the cylinder; `payload_pinch` holds it between
the pads.
"""

from __future__ import annotations

from typing import Any, Literal

from drake_srg.experiments.payload_hold import BENCH, HOLD, Held, Load, largest_mass
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.recording.timeline import make_figure, style_axes

EXPERIMENTS = {
    "payload_wrap": (
        "5 kg wrapped by the fingers, palm down and to the side, and the largest mass.",
        {"grip": "wrap", "mass": 5.0, "wire_force": 200.0},
    ),
    "payload_pinch": (
        "2.5 kg between the pads, palm down and to the side, and the largest mass.",
        {"grip": "pinch", "mass": 2.5, "wire_force": 125.0},
    ),
}
# Titles of the figures, by grip.
_TITLES = {
    "wrap": "68 mm cylinder, wrapped",
    "pinch": "68 mm cylinder between the pads",
}
DIRECTIONS = ("down", "side")
_AGREEMENT = 0.05  # relative, of the largest masses in both scenarios
_FAST = "gripper_bench_fast"


def run(
    track: Track,
    *,
    grip: Literal["wrap", "pinch"] = "wrap",
    mass: float = 5.0,
    wire_force: float = 200.0,
) -> ExperimentResult:
    """Hold a mass in both directions, and find the largest mass held.

    Args:
        track: Shows progress.
        grip: Whether the fingers wrap the cylinder or pinch it between the pads.
        mass: Claimed mass, held first [kg].
        wire_force: Force of each wire [N]; the servo gives up to 308.7 N.
    """
    rows: list[Row] = []
    columns: dict[str, list[Any]] = {k: [] for k in _COLUMNS}
    curves: dict[str, Held] = {}
    most: dict[tuple[str, str], float] = {}
    cases = [(direction, scenario) for direction in DIRECTIONS for scenario in _TRIED]
    for direction, scenario in track(cases, label=", ".join):
        claim = Load(grip, direction, mass, wire_force)
        tried = list(largest_mass(claim, scenario))
        for load, held in tried:
            results = (held.held_for, held.slip, held.creep)
            values = (scenario, direction, load.mass, *results)
            for column, value in zip(columns.values(), values, strict=True):
                column.append(value)
        most[direction, scenario] = max(
            (load.mass for load, held in tried if held.held), default=0.0
        )
        if scenario == BENCH:
            curves[direction] = tried[0][1]
    full = TendonDriveConfig().full_wire_force
    for direction, first in curves.items():
        case = f"{grip}, {direction}"
        bench, fast = (most[direction, scenario] for scenario in _TRIED)
        rows += [
            Row.at_least(case, f"{mass:g} kg held for", HOLD, first.held_for, "s"),
            Row.at_most(case, "wire force", full, first.wire_force, "N"),
            Row.info(case, "slip while the load comes on", first.slip * 1e3, "mm"),
            Row.info(case, "creep while held", first.creep / HOLD * 1e6, "um/s"),
            Row.at_least(case, "largest mass held", mass, bench, "kg"),
            Row.within(
                case,
                f"largest mass held, {_FAST}",
                bench,
                fast,
                "kg",
                relative=_AGREEMENT,
            ),
        ]
    title = f"{_TITLES[grip]}, {wire_force:.0f} N per wire"
    return ExperimentResult(rows, {"masses": columns}, _draw(title, columns, curves))


_TRIED = (BENCH, _FAST)
_COLUMNS = ("scenario", "direction", "mass_kg", "held_for_s", "slip_m", "creep_m")


def _draw(title: str, columns: dict[str, list[Any]], curves: dict[str, Held]) -> Any:
    figure = make_figure(9.0, 3.4, title)
    left, right = figure.subplots(1, 2)
    style_axes(
        left, xlabel="time since the lift began [s]", ylabel="motion in the hand [mm]"
    )
    for direction, held in curves.items():
        left.plot(held.time, held.moved * 1e3, label=direction)
    left.legend(fontsize=8, frameon=False)
    style_axes(right, xlabel="mass [kg]", ylabel="held for [s]")
    for direction, marker in zip(curves, "os", strict=True):
        points = [
            (mass, held_for)
            for case, name, mass, held_for, *_ in zip(*columns.values(), strict=True)
            if (case, name) == (BENCH, direction)
        ]
        right.plot(*zip(*points, strict=True), marker, label=direction)
    right.legend(fontsize=8, frameon=False)
    return figure
