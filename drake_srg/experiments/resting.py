"""How household objects that are dropped on a table come to rest.

One set of contact settings must bring all objects to rest. Each other set differs from
it in one setting.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.common.systems import contact_approximations
from drake_srg.experiments.data import household_objects
from drake_srg.experiments.registry import Track
from drake_srg.experiments.resting_drops import (
    POSES,
    Drop,
    Motion,
    Settings,
    simulate,
    tipping_angle,
)
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import COLORS, make_figure, style_axes

CHOSEN = Settings()
HALF = "half the step"
RIGID = dc.replace(CHOSEN, mat=0.0)
# The first are those of `kitchen`.
OTHERS = {
    "rigid box": dc.replace(RIGID, resolution=0.3),
    "rigid facets of 20 mm": dc.replace(RIGID, cell=0.02, resolution=0.3),
    "rigid facets, objects of 1 MPa, 200 s/m": dc.replace(
        RIGID, cell=0.025, modulus=1.0e6, dissipation=200.0
    ),
    "mat of 1 MPa": dc.replace(CHOSEN, mat=1.0e6),
    "mat of 5 s/m": dc.replace(CHOSEN, mat_dissipation=5.0),
    "round things as coarse as usual": dc.replace(CHOSEN, resolution=0.3),
    **{
        name: dc.replace(CHOSEN, approximation=name)
        for name in contact_approximations()
        if name != CHOSEN.approximation
    },
    "1/1024 s": dc.replace(CHOSEN, time_step=1.0 / 1024.0),
    HALF: dc.replace(CHOSEN, time_step=0.5 * CHOSEN.time_step),
    "10 ms": dc.replace(CHOSEN, time_step=0.01),
}
# The objects dropped with other settings.
COMPARED = (
    "005_tomato_soup_can",
    "056_tennis_ball",
    "mug",
    "wrench",
)
HEIGHTS = (0.005, 0.02, 0.05)  # m
# An object that moves faster is not at rest [m/s].
REST = 0.005
# Things that fall over when they are tipped by less than this do not rest but balance,
# until they fall by chance [rad]: a pencil on its end, a card on its edge.
BALANCING = 0.2
# Spans in which speeds count, and the one in which objects must not creep [s].
SOON, LATE, CREEP = (1.2, 1.5), (3.0, 3.3), (3.0, 13.0)
MOST_CREEP = 1e-3  # m
MOST_UNQUIET = 1.0 / 50.0  # share of drops that may move soon after the fall


@dc.dataclass(frozen=True)
class Count:
    """What became of the drops with one set of settings.

    Attributes:
        drops: Their number.
        exploded: Number of explosions.
        soon: Number of objects that moved in `SOON`.
        late: The same in `LATE`.
        speed: Simulated time over processor time.
    """

    drops: int
    exploded: int
    soon: int
    late: int
    speed: float


def run(
    track: Track, *, objects: Sequence[str] = (), quick: bool = False
) -> ExperimentResult:
    """Drop every object in every pose from every height.

    Args:
        track: Shows progress.
        objects: Names of the objects to drop; all by default.
        quick: Whether to drop from one height, with the chosen settings only.
    """
    things = household_objects()
    for name in objects:
        if name not in things:
            hint = suggest(name, things)
            raise ScenarioError(f"resting: objects: unknown object {name!r} {hint}")
    names = objects or list(things)
    high = [
        Drop(n, pose, HEIGHTS[-1])
        for n in names
        for pose in POSES
        if tipping_angle(things[n], pose) > BALANCING
    ]
    low = [dc.replace(d, height=h) for h in HEIGHTS[:-1] for d in high]
    cases = [("chosen", CHOSEN, d, CREEP[1]) for d in high]
    if not quick:
        cases += [("chosen", CHOSEN, d, LATE[1]) for d in low]
        some = [d for d in high if d.name in COMPARED]
        cases += [(s, OTHERS[s], d, LATE[1]) for s in OTHERS for d in some]
    motions: dict[str, dict[Drop, Motion]] = {}
    for label, settings, drop, duration in track(
        cases, lambda case: f"{case[0]}: {case[2]}"
    ):
        motion = simulate(drop, things[drop.name], settings, duration)
        motions.setdefault(label, {})[drop] = motion
    counts = {label: count(found) for label, found in motions.items()}
    return ExperimentResult(
        judge(motions, counts), {"drops": columns(motions)}, draw(counts)
    )


def count(motions: Mapping[Drop, Motion]) -> Count:
    """Count what became of drops."""
    found = list(motions.values())
    simulated = sum(float(m.time[-1]) for m in found)
    return Count(
        drops=len(found),
        exploded=sum(m.exploded for m in found),
        soon=sum(m.fastest(*SOON) > REST for m in found),
        late=sum(m.fastest(*LATE) > REST for m in found),
        speed=simulated / max(sum(m.wall for m in found), 1e-9),
    )


def judge(
    motions: Mapping[str, Mapping[Drop, Motion]], counts: Mapping[str, Count]
) -> list[Row]:
    """Expect rest with the chosen settings, and report the others."""
    chosen, found = counts["chosen"], motions["chosen"]
    creep = max(m.creep(CREEP[0]) for d, m in found.items() if d.height == HEIGHTS[-1])
    standing = [m for d, m in found.items() if d.pose == "standing"]
    sunk = max(m.sunk for m in standing)
    rows = [
        Row.at_most("chosen", "explosions", 0.0, chosen.exploded, "drops"),
        Row.at_most(
            "chosen",
            f"moving after {SOON[0]:g} s",
            MOST_UNQUIET,
            chosen.soon / chosen.drops,
            "of the drops",
        ),
        Row.at_most("chosen", f"moving after {LATE[0]:g} s", 0.0, chosen.late, "drops"),
        Row.at_most("chosen", "creep in 10 s", 1e3 * MOST_CREEP, 1e3 * creep, "mm"),
        Row.info("chosen", "deepest in the table at rest", 1e3 * sunk, "mm"),
    ]
    for label in OTHERS:
        if label in counts:
            rows += _describe(label, counts[label], chosen)
    if HALF in motions:
        changes = [
            abs(m.position[-1, 2] - found[d].position[-1, 2])
            for d, m in motions[HALF].items()
            if d.pose == "standing"
        ]
        change = 1e3 * max(changes)
        rows.append(
            Row.at_most(HALF, "change of the height at rest", 0.1, change, "mm")
        )
    return rows


def _describe(label: str, counted: Count, chosen: Count) -> list[Row]:
    spread = max(3.0, 0.1 * counted.drops)  # contact is chaotic
    return [
        Row.info(label, quantity, value, f"of {counted.drops} drops", spread=spread)
        for quantity, value in (
            ("explosions", counted.exploded),
            (f"moving after {SOON[0]:g} s", counted.soon),
            (f"moving after {LATE[0]:g} s", counted.late),
        )
    ] + [
        Row.info(
            label,
            "speed of simulation",
            counted.speed / chosen.speed,
            "of the chosen one's",
            spread=0.5 * counted.speed / chosen.speed,
        )
    ]


def columns(motions: Mapping[str, Mapping[Drop, Motion]]) -> dict[str, list[Any]]:
    """Return a line of the table for each drop."""
    table: dict[str, list[Any]] = {}
    for label, drops in motions.items():
        for drop, motion in drops.items():
            for column, value in (
                ("settings", label),
                ("object", drop.name),
                ("pose", drop.pose),
                ("height [mm]", 1e3 * drop.height),
                ("exploded", motion.exploded),
                (f"speed after {SOON[0]:g} s [mm/s]", 1e3 * motion.fastest(*SOON)),
                (f"speed after {LATE[0]:g} s [mm/s]", 1e3 * motion.fastest(*LATE)),
                ("sunk [mm]", 1e3 * motion.sunk),
                ("creep after 3 s [mm]", 1e3 * motion.creep(CREEP[0])),
            ):
                table.setdefault(column, []).append(value)
    return table


def draw(counts: Mapping[str, Count]) -> Any:
    """Draw the shares of restless drops, and the speed of the simulation."""
    figure = make_figure(10.0, 1.6 + 0.3 * len(counts), "Dropped on a table")
    restless, speed = figure.subplots(1, 2, sharey=True, width_ratios=[2, 1])
    y = np.arange(len(counts))[::-1]
    style_axes(restless, xlabel="drops [%]")
    style_axes(speed, xlabel="x real time, one object")
    bars = (
        (f"moving after {SOON[0]:g} s", "soon", COLORS[5]),
        (f"moving after {LATE[0]:g} s", "late", COLORS[0]),
        ("exploded", "exploded", COLORS[1]),
    )
    for i, (label, field, color) in enumerate(bars):
        shares = [100.0 * getattr(c, field) / c.drops for c in counts.values()]
        restless.barh(y + 0.25 * (1 - i), shares, 0.23, color=color, label=label)
    speed.barh(y, [c.speed for c in counts.values()], 0.6, color=COLORS[6])
    restless.set_yticks(y, list(counts))
    restless.axvline(100.0 * MOST_UNQUIET, color="#333333", ls="--", lw=0.8)
    restless.legend(fontsize=8, frameon=False, loc="center right")
    for axes in (restless, speed):
        axes.grid(visible=False)
    return figure
