"""How far things on a table move that have come to rest and that nobody touches.

The objects of the cells that clear a table fall as they do there, and the arm waits at
home. The seeds are not those that stiction tolerance and steps were chosen on.
"""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.common.log_format import pose_key, row_to_pose
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.whole_run import simulate_whole
from drake_srg.objects.config import SleepingConfig
from drake_srg.objects.household import object_facts
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.types import Vector

TABLES = {"spread": "clear_table_fast", "heap": "clear_heap_fast"}
AS_IS = "as it is"
# What sleeps cannot move.
SETTINGS: Mapping[str, tuple[str, ...]] = {
    AS_IS: (),
    "awake, 5 ms": ("sleeping=null", "plant_config.time_step=0.005"),
    "awake, 2.5 ms": ("sleeping=null", "plant_config.time_step=0.0025"),
    "awake, Drake's stiction": (
        "sleeping=null",
        "plant_config.stiction_tolerance=1.0e-3",
    ),
}
LATEST, SPAN = 15.0, 10.0  # when all must be at rest, and how long then to watch [s]
MOST = 1e-3  # m
# The arm waits until the time is over.
_WAITING = (
    f"planner.latency={2 * (LATEST + SPAN)}",
    f"planner.time_budget={LATEST + SPAN + 1}",
)


@dc.dataclass(frozen=True)
class Stay:
    """How long the things on a table took to come to rest, and whether they stayed.

    Attributes:
        rest: Time from which on all were at rest [s]; None if not by `LATEST`.
        moved: The farthest that any point of them moved in the `SPAN` after that [m].
        thing: The model of the one that moved farthest.
    """

    rest: float | None
    moved: float = 0.0
    thing: str = ""


def run(
    track: Track, *, trials: int = 4, seed: int = 10200, keep: str = ""
) -> ExperimentResult:
    """Leave tables alone.

    Args:
        track: Shows progress.
        trials: Tables of each kind, each with all settings.
        seed: Of the first table.
        keep: File of finished trials, with which a run that was cut off goes on.
    """
    kept = KeptTrials(keep)
    cases = [
        (table, settings, seed + i)
        for i in range(trials)
        for table in TABLES
        for settings in SETTINGS
    ]
    stays: dict[tuple[str, str], list[Stay]] = {}
    for case in track(cases, lambda c: f"{c[0]}, {c[1]}, seed {c[2]}"):
        found = kept(str(case), functools.partial(_watched, *case))
        stays.setdefault(case[:2], []).append(Stay(**found))
    columns = table_of([c[2] for c in cases[:: len(SETTINGS) * len(TABLES)]], stays)
    return ExperimentResult(judge(stays), {"tables": columns}, draw(stays))


def watch(table: str, settings: str, seed: int) -> Stay:
    """Simulate a table that nobody touches."""
    scenario = load_scenario(
        TABLES[table], seed=seed, overrides=(*_WAITING, *SETTINGS[settings])
    )
    result = simulate_whole(scenario, record=False)
    log = result.log
    points = {}
    for name, config in scenario.objects.items():
        poses = [row_to_pose(row) for row in log[pose_key(name)]]
        p_OP = object_facts(name, config).points
        points[name] = np.array([(X_WO @ p_OP.T).T for X_WO in poses])
    stay = find_stay(log["time"], points)
    if not stay.thing:
        return stay
    model = Path(scenario.objects[stay.thing].model or "").stem
    return dc.replace(stay, thing=model)


def _watched(table: str, settings: str, seed: int) -> dict[str, Any]:
    return dc.asdict(watch(table, settings, seed))


def find_stay(time: Vector, points: Mapping[str, Vector]) -> Stay:
    """Find when all objects have come to rest, and how far they move after that.

    At rest, no point of any object is faster than objects are that fall asleep, for as
    long as that takes (`SleepingConfig`).

    Args:
        time: Shape (K,) [s].
        points: Of each object, shape (K, n, 3), in world [m].
    """
    sleeping = SleepingConfig()
    speeds = np.max([_speeds(time, p) for p in points.values()], axis=0)
    slow = speeds <= sleeping.speed
    # The last sample before each that was not slow.
    last = np.maximum.accumulate(np.where(slow, -1, np.arange(len(slow))))
    stirred = np.where(last < 0, time[0], time[last])
    rested = np.flatnonzero(slow & (time - stirred >= sleeping.after - 1e-9))
    if not len(rested) or time[rested[0]] > LATEST:
        return Stay(None)
    first = int(rested[0])
    rows = (time >= time[first]) & (time <= time[first] + SPAN + 1e-9)
    moved = {
        name: float(np.linalg.norm(p[rows] - p[first], axis=2).max())
        for name, p in points.items()
    }
    thing = max(moved, key=lambda name: moved[name])
    return Stay(float(time[first]), moved[thing], thing)


def _speeds(time: Vector, points: Vector) -> Vector:
    """Return the speed of the fastest point before each sample, shape (K,) [m/s]."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
    return np.concatenate([[np.inf], steps / np.diff(time)])


def judge(stays: Mapping[tuple[str, str], Sequence[Stay]]) -> list[Row]:
    """Expect that what is at rest stays, with the scenarios as they are."""
    rows = []
    for (table, settings), found in stays.items():
        name, of = f"{table}, {settings}", f"of {len(found)} tables"
        at_rest = [s for s in found if s.rest is not None]
        moved = 1e3 * max((s.moved for s in at_rest), default=0.0)
        quantity = f"farthest motion in {SPAN:g} s"
        rows.append(
            Row.info(name, f"at rest within {LATEST:g} s", len(at_rest), of, spread=2.0)
        )
        if settings == AS_IS:
            rows.append(Row.at_most(name, quantity, 1e3 * MOST, moved, "mm"))
        else:
            rows.append(Row.info(name, quantity, moved, "mm", spread=max(1.0, moved)))
    return rows


def table_of(
    seeds: Sequence[int], stays: Mapping[tuple[str, str], Sequence[Stay]]
) -> dict[str, list[Any]]:
    """Return a line of the table for each simulation."""
    lines: dict[str, list[Any]] = {}
    for (table, settings), found in stays.items():
        for seed, stay in zip(seeds, found, strict=True):
            for column, value in (
                ("table", table),
                ("settings", settings),
                ("seed", seed),
                ("at rest [s]", "" if stay.rest is None else stay.rest),
                ("farthest motion [mm]", 1e3 * stay.moved),
                ("of", stay.thing),
            ):
                lines.setdefault(column, []).append(value)
    return lines


def draw(stays: Mapping[tuple[str, str], Sequence[Stay]]) -> Any:
    """Draw when each table came to rest, and how far things moved after that."""
    figure = make_figure(7.0, 3.2, "Tables that nobody touches")
    axes = figure.subplots()
    style_axes(
        axes,
        xlabel="time at which everything is at rest [s]",
        ylabel=f"farthest motion in {SPAN:g} s [mm]",
    )
    for (table, settings), found in stays.items():
        at_rest = [s for s in found if s.rest is not None]
        axes.plot(
            [s.rest for s in at_rest],
            [max(1e3 * s.moved, 1e-4) for s in at_rest],
            dict(zip(TABLES, "os", strict=True))[table],
            color=COLORS[list(SETTINGS).index(settings)],
            markersize=4,
            label=f"{table}, {settings}",
        )
    axes.axhline(1e3 * MOST, color="#333333", ls="--", lw=0.8)
    axes.set_yscale("log")
    axes.legend(fontsize=7, frameon=False)
    return figure
