"""Motions of the kitchen's arm by both time parameterizations: durations and speed."""

from __future__ import annotations

import dataclasses as dc
import time as wall
from collections.abc import Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.motion.time_parameterization import MakeTimeParameterization
from drake_srg.planning.motion.trajectories import grid_of, rounded_path
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeTaskPlanner
from drake_srg.types import Vector

NAMES = ("toppra", "drake")
SPANS = (8, 32, 64)  # of the paths
_REPEATS = 3  # the fastest counts
# Python and C++ do not slow down alike on a busy machine: 0.37 to 0.52 were measured.
_RATIO_SPREAD = 0.3


@dc.dataclass(frozen=True)
class Comparison:
    """A path's motions by `NAMES`.

    Attributes:
        grid: Number of grid points.
        durations: Of the motions, shape (2,) [s].
        wall: Wall time that finding each took, shape (2,) [s].
    """

    grid: int
    durations: Vector
    wall: Vector


def compare(scene: PlanningScene, waypoints: Vector, spans: int) -> Comparison:
    """Time the motion along a rounded polyline by both.

    Args:
        scene: The arm.
        waypoints: The polyline, shape (K, N) [rad].
        spans: Of the path; the grid has twice as many points, and 30 at least.
    """
    path, _ = rounded_path(waypoints, spans)
    grid, limits = grid_of(path), MotionLimits.of_plant(scene)
    durations, times = [], []
    for name in NAMES:
        parameterize = MakeTimeParameterization(name)
        tries = []
        for _ in range(_REPEATS):
            start = wall.perf_counter()
            progress = parameterize(scene, path, limits, grid)
            tries.append(wall.perf_counter() - start)
        durations.append(np.nan if progress is None else progress.end_time())
        times.append(min(tries))
    return Comparison(len(grid), np.array(durations), np.array(times))


def run(track: Track, *, paths: int = 60) -> ExperimentResult:
    """Compare both on random paths of the kitchen's arm.

    Args:
        track: Shows progress.
        paths: Number of paths.
    """
    planner = MakeTaskPlanner(load_scenario("kitchen", seed=0))
    scene = planner.scene
    random = np.random.default_rng(0)
    results = []
    for i in track(range(paths)):
        first, second = random.uniform(-0.6, 0.6, (2, scene.num_joints))
        # Drake's finds no motion along some paths that turn back.
        second *= np.sign(first @ second)
        waypoints = planner.q_home + np.array([0.0 * first, first, first + second])
        results.append(compare(scene, waypoints, spans=SPANS[i % len(SPANS)]))
    return ExperimentResult(judge(results), {"paths": _table(results)}, draw(results))


def judge(results: Sequence[Comparison]) -> Sequence[Row]:
    """Judge the ratios toppra / Drake, and state the times."""
    durations = np.array([result.durations for result in results])
    ratios = durations[:, 0] / durations[:, 1]
    rows = [
        Row.within("all paths", f"duration, {name}", 1.0, ratio, "", absolute=0.05)
        for name, ratio in (
            ("smallest ratio", np.min(ratios)),
            ("median ratio", np.median(ratios)),
            ("largest ratio", np.max(ratios)),
        )
    ]
    for grid in sorted({result.grid for result in results}):
        times = np.array([result.wall for result in results if result.grid == grid])
        ratio = float(np.median(times[:, 0] / times[:, 1]))
        name = f"{grid} grid points"
        rows.append(
            Row.at_most(
                name, "wall time, median ratio", 1.0, ratio, "", spread=_RATIO_SPREAD
            )
        )
        for i, solver in enumerate(NAMES):
            time = 1e3 * float(np.median(times[:, i]))
            quantity = f"wall time, {solver}, median"
            rows.append(Row.info(name, quantity, time, "ms", clock="time"))
    return rows


def _table(results: Sequence[Comparison]) -> dict[str, Vector]:
    columns = {"grid points": np.array([result.grid for result in results])}
    for i, solver in enumerate(NAMES):
        columns[f"duration, {solver} [s]"] = np.array([r.durations[i] for r in results])
        columns[f"wall time, {solver} [s]"] = np.array([r.wall[i] for r in results])
    return columns


def draw(results: Sequence[Comparison]) -> Any:
    """Draw durations and wall times, toppra's against Drake's."""
    figure = make_figure(8.0, 4.0, "Time parameterization of the iiwa's motions")
    panels = figure.subplots(1, 2)
    titles = ("duration [s]", "wall time [ms]")
    durations = np.array([result.durations for result in results])
    times = 1e3 * np.array([result.wall for result in results])
    grids = np.array([result.grid for result in results])
    for axes, title, values in zip(panels, titles, (durations, times), strict=True):
        style_axes(axes, xlabel=f"Drake: {title}", ylabel=f"toppra: {title}")
        for grid, color in zip(np.unique(grids), COLORS, strict=False):
            toppra, drake = values[grids == grid].T
            axes.plot(drake, toppra, ".", color=color, label=f"{grid} grid points")
        axes.axline((0.0, 0.0), slope=1.0, color="#333333", ls="--", lw=0.8)
    panels[0].legend(fontsize=8, frameon=False)
    return figure
