"""How accurately the five-axis cell's camera locates its standing or lying cylinder.

The scenario's ceiling camera and localizer locate the cylinder in many poses, with
images of three sizes. Then the cameras of both varied scenarios look at scenes with
other lights, noise, clutter and occlusion. Nothing is simulated. Only the images are
judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.experiments.localization_cases import (
    CAMERA,
    LYING,
    RECESS,
    SCENARIO,
    STANDING,
    TILTED,
    Case,
    Eye,
    Sighting,
    load,
    poses,
)
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.varied_scenes import WITHIN, Scene
from drake_srg.experiments.varied_scenes import judge as judge_scenes
from drake_srg.experiments.varied_scenes import look as look_at_scene
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import load_scenario

SIZES = ((320, 240), (640, 480), (1280, 960))  # images [pixels]
# From the arm thesis's table: where its blob detection saw the cylinder, and where it
# was [m].
DETECTED = np.array([-0.325013, -0.175051, 0.139989])
ACTUAL = np.array([-0.32495, -0.17498, 0.125])
# Our own limits: error on each axis if it stands [m], distance otherwise [m], error of
# the axis [rad].
MOST_STANDING, MOST_LYING, MOST_TURN = 0.3e-3, 0.5e-3, np.deg2rad(1.0)


def run(
    track: Track, *, grid: int = 9, others: int = 60, scenes: int = 60
) -> ExperimentResult:
    """Locate a cylinder in many places with images of three sizes, then in scenes.

    Args:
        track: Shows progress.
        grid: Standing places along each side of the pick region.
        others: Tilted places, and lying ones.
        scenes: Scenes of each varied scenario.
    """
    own = load_scenario(SCENARIO).cameras[CAMERA]
    eyes = {size: Eye(load(size)) for size in SIZES}
    ways = (STANDING, RECESS, TILTED, LYING)
    cases = [Case(way, size) for size in SIZES for way in ways]
    sightings = {
        case: [
            eyes[case.size].look(X_WO)
            for X_WO in poses(load(case.size), case.way, grid, others)
        ]
        for case in track(cases)
    }
    size = (own.width, own.height)
    thesis = eyes[size].look(RigidTransform(ACTUAL))
    seen = {
        name: [look_at_scene(name, seed) for seed in range(scenes)]
        for name in track(list(WITHIN))
    }
    return make_result(sightings, thesis, size, seen)


def make_result(
    sightings: dict[Case, list[Sighting]],
    thesis: Sighting,
    size: tuple[int, int],
    scenes: dict[str, list[Scene]],
) -> ExperimentResult:
    """Judge sightings.

    Args:
        sightings: By case.
        thesis: The sighting at the place of the arm thesis's cylinder.
        size: The scenario's own image size [pixels], whose cases are judged. The others
            are informative.
        scenes: Scenes of the varied scenarios, by name.
    """
    flat = [(case, s) for case, found in sightings.items() for s in found]
    places = np.array([s.X_WO.translation() for _, s in flat])
    errors = np.array([s.error for _, s in flat])
    axes = np.array([s.X_WO.rotation().matrix()[:, 2] for _, s in flat])
    columns: dict[str, Any] = {
        "way": [case.way for case, _ in flat],
        "width [pixels]": [case.size[0] for case, _ in flat],
    }
    for i, name in enumerate("xyz"):
        columns[f"{name} [m]"] = places[:, i]
        columns[f"axis {name}"] = axes[:, i]
        columns[f"error {name} [m]"] = errors[:, i]
    columns["error of the axis [rad]"] = [s.turn for _, s in flat]
    columns["quality"] = [s.quality for _, s in flat]
    columns["uncertain"] = [int(s.uncertain) for _, s in flat]
    rows = judge(sightings, thesis, size)
    for name, seen in scenes.items():
        rows += judge_scenes(name, seen)
    return ExperimentResult(
        rows,
        {"sightings": columns},
        draw(sightings, size),
    )


def judge(
    sightings: dict[Case, list[Sighting]], thesis: Sighting, size: tuple[int, int]
) -> list[Row]:
    """Judge the thesis's place, then every case (see `make_result`)."""
    rows = []
    errors = 1e3 * np.abs([thesis.error, DETECTED - ACTUAL])
    for name, ours, theirs in zip("xyz", *errors, strict=True):
        what = f"error in {name}; expected: the thesis's"
        rows.append(Row.at_most("at the thesis's place", what, theirs, ours, "mm"))
    for case, found in sightings.items():
        errors = 1e3 * np.abs([s.error for s in found])
        turn = float(np.rad2deg(np.max([s.turn for s in found])))
        distance = 1e3 * float(np.max([s.distance for s in found]))
        upright = case.way in (STANDING, RECESS)
        most = 1e3 * (MOST_STANDING if upright else MOST_LYING)
        measured: list[tuple[str, float, float, str]] = [
            (f"largest error in {name}", most, float(error), "mm")
            for name, error in zip("xyz", errors.max(axis=0), strict=True)
        ]
        if not upright:
            measured = [("largest error of position", most, distance, "mm")]
        rms = float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
        measured.append(("largest error of axis", np.rad2deg(MOST_TURN), turn, "deg"))
        for what, limit, value, unit in measured:
            if case.size == size:
                rows.append(Row.at_most(str(case), what, limit, value, unit))
            else:
                rows.append(Row.info(str(case), what, value, unit))
        rows.append(Row.info(str(case), "root mean square of position", rms, "mm"))
    return rows


def draw(sightings: dict[Case, list[Sighting]], size: tuple[int, int]) -> Any:
    """Draw errors by size and axis, over the region, and against tilt."""
    figure = make_figure(11.0, 7.0, "Where the camera sees the cylinder")
    (bars, region), (position, turn) = figure.subplots(2, 2)
    sizes = list(dict.fromkeys(case.size for case in sightings))
    labels = [f"{w} x {h}" for w, h in sizes]
    _draw_standing(bars, sightings, sizes, labels)

    found = sightings[Case(STANDING, size)]
    places = 1e3 * np.array([s.X_WO.translation()[:2] for s in found])
    errors = 1e3 * np.array([s.error[:2] for s in found])
    style_axes(region, xlabel="x [mm]", ylabel="y [mm]")
    arrows = region.quiver(*places.T, *errors.T, color=COLORS[0], angles="xy")
    region.quiverkey(arrows, 1.2, 0.9, 0.02, "0.02 mm", fontproperties={"size": 8})
    region.set_xlim(places[:, 0].min() - 20.0, places[:, 0].max() + 20.0)
    region.set_ylim(places[:, 1].min() - 20.0, places[:, 1].max() + 20.0)
    region.set_aspect("equal")
    title = f"Standing on the pick region, {size[0]} x {size[1]}: error in x and y"
    region.set_title(title, fontsize=9, loc="left")

    style_axes(position, xlabel="tilt [deg]", ylabel="error of position [mm]")
    style_axes(turn, xlabel="tilt [deg]", ylabel="error of the axis [deg]")
    for color, wanted, label in zip(COLORS, sizes, labels, strict=False):
        tilted = [
            s
            for case, found in sightings.items()
            if case.size == wanted and case.way in (TILTED, LYING)
            for s in found
        ]
        tilts = [np.rad2deg(s.tilt) for s in tilted]
        style: dict[str, Any] = {"color": color, "ms": 3, "label": label}
        position.plot(tilts, [1e3 * s.distance for s in tilted], "o", **style)
        turn.plot(tilts, [np.rad2deg(s.turn) for s in tilted], "o", **style)
    position.axhline(1e3 * MOST_LYING, color=COLORS[-1], lw=0.8, ls="--")
    for axes, what in ((position, "centre; dashed: the limit"), (turn, "axis")):
        axes.set_title(f"Tilted and lying: {what}", fontsize=9, loc="left")
        axes.legend(fontsize=8, frameon=False)
    return figure


def _draw_standing(
    axes: Any,
    sightings: dict[Case, list[Sighting]],
    sizes: Sequence[tuple[int, int]],
    labels: Sequence[str],
) -> None:
    """Draw the largest error on each axis and the thesis's."""
    style_axes(axes, ylabel="largest error [mm]")
    theirs = 1e3 * np.abs(DETECTED - ACTUAL)
    bars = {
        label: Case(STANDING, size) for label, size in zip(labels, sizes, strict=True)
    }
    for k, (label, case) in enumerate(bars.items()):
        largest = 1e3 * np.max(np.abs([s.error for s in sightings[case]]), axis=0)
        axes.bar(np.arange(3) + 0.2 * k, largest, 0.18, color=COLORS[k], label=label)
    at = np.arange(3) + 0.2 * len(bars)
    axes.bar(at, theirs, 0.18, color=COLORS[-1], label="thesis, one place")
    axes.axhline(1e3 * MOST_STANDING, color=COLORS[-1], lw=0.8, ls="--")
    axes.set_xticks(np.arange(3) + 0.1 * len(bars), list("xyz"))
    axes.set_yscale("log")
    axes.set_title("Standing; dashed: the limit", fontsize=9, loc="left")
    axes.legend(fontsize=8, frameon=False)
