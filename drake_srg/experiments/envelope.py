"""Where the five-axis arm can grasp a leaning or lying cylinder and stand it upright.

The pads must hold the cylinder along its axis, with its middle at the tip. These are
five conditions, so five joints leave no choice of the approach: the hand must come
straight from above onto a cylinder that lies on the table. The planner plans for a grid
of places and directions without simulation. Then the cell simulates some cases within
the claimed envelope. A leaning cylinder would need a support, so it is only planned
for, as if it stood on its rim.
"""

from __future__ import annotations

import collections
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.envelope_cases import (
    LEANING_OFF,
    LYING,
    OFF_RADIAL,
    RADIUS,
    SIMULATED,
    UPRIGHT,
    Cell,
    Outcome,
    edges,
    make_cases,
)
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import COLORS, make_figure, style_axes

_CLAIMS = {
    UPRIGHT: "planned",
    LYING: f"planned up to {1e3 * RADIUS:.0f} mm from joint 1 "
    f"and {np.rad2deg(OFF_RADIAL):.0f} degrees off radial",
}
_LEANING_CLAIM = (
    f"planned up to {np.rad2deg(LEANING_OFF):.0f} degrees off the arm's direction"
)
# Details of the planner's messages: figures, and names of parts of hand or arm.
_PARTICULARS = r"-?\d+\.\d+|\w+(?= and \w+ are)"
_CLEARANCE = 1.0  # of the recess around the cylinder [mm]


def run(track: Track, *, runs: int = 10) -> ExperimentResult:
    """Plan for every case, simulate some, and find the edges of the envelope.

    Args:
        track: Shows progress.
        runs: Number of simulated cycles.
    """
    cell, outcomes = Cell(), []
    for seed, case in enumerate(track(make_cases(cell, runs))):
        simulated = case.way == SIMULATED
        outcomes.append(cell.run(case, seed) if simulated else cell.plan(case))
    return make_result(cell, outcomes, edges(cell))


def make_result(
    cell: Cell, outcomes: Sequence[Outcome], found: tuple[float, float, float]
) -> ExperimentResult:
    """Judge the outcomes and count the planner's messages; `found` as of `edges`."""
    cases = [o.case for o in outcomes]
    xy = np.array([cell.place(case) for case in cases])
    columns: dict[str, Any] = {
        "way": [case.way for case in cases],
        "x [m]": xy[:, 0],
        "y [m]": xy[:, 1],
        "radius [m]": [case.radius for case in cases],
        "lean [deg]": [float(np.rad2deg(case.lean)) for case in cases],
        "off radial [deg]": [float(np.rad2deg(case.off)) for case in cases],
        "claimed": [int(case.claimed) for case in cases],
        "failure": [o.failure or "" for o in outcomes],
        "message": [o.message for o in outcomes],
        "placement error [m]": [o.error for o in outcomes],
    }
    why = collections.Counter(
        (o.case.way, o.failure, re.sub(_PARTICULARS, "#", o.message))
        for o in outcomes
        if o.failure
    ).most_common()
    reasons: dict[str, Any] = {
        "way": [way for (way, _, _), _ in why],
        "failure": [failure for (_, failure, _), _ in why],
        "message": [message for (_, _, message), _ in why],
        "count": [count for _, count in why],
    }
    return ExperimentResult(
        judge(outcomes, found),
        {"poses": columns, "reasons": reasons},
        draw(cell, outcomes),
    )


def share(outcomes: Sequence[Outcome]) -> float:
    """Return the share of outcomes that succeeded [%]."""
    return 100.0 * float(np.mean([o.failure is None for o in outcomes]))


def judge(outcomes: Sequence[Outcome], found: tuple[float, float, float]) -> list[Row]:
    """Judge the claims and report the rest; `found` as of `edges`."""
    ways = by_way(outcomes)
    rows = []
    for way, of_way in ways.items():
        if way == SIMULATED:
            continue
        claimed = [o for o in of_way if o.case.claimed]
        if claimed:
            what = _CLAIMS.get(way, _LEANING_CLAIM)
            rows.append(Row.at_least(way, what, 100.0, share(claimed), "%"))
        if way != UPRIGHT:
            what = "planned, all places and directions"
            rows.append(Row.info(way, what, share(of_way), "%"))
        failures = collections.Counter(o.failure for o in of_way if o.failure)
        for failure, count in sorted(failures.items()):
            rows.append(Row.info(way, f"not planned: {failure}", count, ""))
    (far, *offs), off = found, np.rad2deg(OFF_RADIAL)
    what = "largest distance from joint 1, radial"
    rows.append(Row.at_least(LYING, what, 1e3 * RADIUS, 1e3 * far, "mm"))
    for side, value in zip(("left", "right"), np.rad2deg(offs), strict=True):
        what = f"largest angle off radial, to the {side}"
        rows.append(Row.at_least(LYING, what, off, float(value), "deg"))
    runs = ways[SIMULATED]
    stood = sum(o.failure is None for o in runs)
    error = 1e3 * float(np.max([o.error for o in runs]))
    return [
        *rows,
        Row.at_least(SIMULATED, "stood up in the recess", len(runs), stood, ""),
        Row.at_most(SIMULATED, "largest error in x or y", _CLEARANCE, error, "mm"),
    ]


def by_way(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """Return the outcomes by the way the cylinder stands or lies."""
    ways: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        ways.setdefault(outcome.case.way, []).append(outcome)
    return ways


def draw(cell: Cell, outcomes: Sequence[Outcome]) -> Any:
    """Draw a map of lying cylinders, and the share planned by direction."""
    figure = make_figure(11.0, 5.2, "Where the arm can stand a cylinder upright")
    table, shares = figure.subplots(1, 2, width_ratios=[1.1, 1.0])
    ways = by_way(outcomes)
    style_axes(table, xlabel="x [mm]", ylabel="y [mm]")
    for way, length, good in ((LYING, 7.0, COLORS[2]), (SIMULATED, 10.0, COLORS[0])):
        for o in ways.get(way, []):
            p, z = (
                1e3 * cell.place(o.case),
                cell.pose(o.case).rotation().matrix()[:2, 2],
            )
            ends = np.array([p - length * z, p + length * z])
            color, width = (good, 1.6) if o.failure is None else ("#c8ced6", 0.7)
            table.plot(*ends.T, "-", color=color, lw=width)
    angles = np.linspace(-0.5, 0.5, 50)
    arc = cell.center - RADIUS * np.column_stack([np.cos(angles), np.sin(angles)])
    table.plot(*1e3 * arc.T, "--", color=COLORS[-1], lw=0.8)
    side = 1e3 * np.array([cell.scenario.table.min, cell.scenario.table.max])
    table.set_xlim(*side[:, 0])
    table.set_ylim(*side[:, 1])
    table.set_aspect("equal")
    radius = f"dashed {1e3 * RADIUS:.0f} mm from joint 1"
    title = f"Lying: green planned, blue simulated; {radius}"
    table.set_title(title, fontsize=9, loc="left")

    style_axes(shares, xlabel="direction off radial [deg]", ylabel="planned [%]")
    shown = [way for way in ways if way not in (UPRIGHT, SIMULATED)]
    for k, way in enumerate(shown):
        of_way = ways[way]
        offs = sorted({o.case.off for o in of_way})
        values = [share([o for o in of_way if o.case.off == off]) for off in offs]
        # Ever thinner lines, so that none hides another.
        shares.plot(np.rad2deg(offs), values, ".-", lw=3.0 - 0.5 * k, label=way)
    shares.set_title("Share of places; 0 is away from the arm", fontsize=9, loc="left")
    shares.legend(fontsize=8, frameon=False)
    return figure
