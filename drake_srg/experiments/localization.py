"""How accurately the five-axis cell's camera locates its standing or lying cylinder.

The scenario's ceiling camera and localizer locate the cylinder in many poses, with
images of three sizes. Then the cameras of both varied scenarios look at scenes with
other lights, noise, clutter and occlusion. Nothing is simulated. Only the images are
judged.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder

from drake_srg.cell.perception import AddLocalizer
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.experiments.varied_scenes import (
    WITHIN,
    Scene,
    angle_between_axes,
    put_object,
)
from drake_srg.experiments.varied_scenes import judge as judge_scenes
from drake_srg.experiments.varied_scenes import look as look_at_scene
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station import MakeStation
from drake_srg.types import BlobFlag, Cylinder, Vector

SCENARIO, CAMERA = "assistive_arm", "ceiling"
SIZES = ((320, 240), (640, 480), (1280, 960))  # images [pixels]
STANDING, RECESS, TILTED, LYING = "standing", "in the recess", "tilted", "lying"
# From the arm thesis's table: where its blob detection saw the cylinder, and where it
# was [m].
DETECTED = np.array([-0.325013, -0.175051, 0.139989])
ACTUAL = np.array([-0.32495, -0.17498, 0.125])
# Our own limits: error on each axis if it stands [m], distance otherwise [m], error of
# the axis [rad].
MOST_STANDING, MOST_LYING, MOST_TURN = 0.3e-3, 0.5e-3, np.deg2rad(1.0)
_SIDES = ("width", "height")
_RECESS_DEPTH = 0.005  # m
_PLAY = 0.7e-3  # in the recess, on both axes; less than its clearance [m]


@dc.dataclass(frozen=True)
class Case:
    """One way in which the cylinder is placed, seen with images of one size."""

    way: str
    size: tuple[int, int]

    def __str__(self) -> str:
        return f"{self.way}, {self.size[0]} x {self.size[1]}"


@dc.dataclass(frozen=True)
class Sighting:
    """How a cylinder was located. Numbers are NaN if it was not seen.

    Attributes:
        X_WO: Its true pose.
        error: Estimated minus true centre, in W [m], shape (3,).
        turn: Angle between the estimated and the true axis [rad].
        quality: Quality of the blob.
        uncertain: Whether the blob is uncertain or missing.
    """

    X_WO: RigidTransform
    error: Vector
    turn: float
    quality: float
    uncertain: bool

    @property
    def distance(self) -> float:
        """Distance from the estimated to the true centre [m]."""
        return float(np.linalg.norm(self.error))

    @property
    def tilt(self) -> float:
        """Angle of the axis from the vertical [rad]."""
        return float(np.arccos(min(1.0, self.X_WO.rotation().matrix()[2, 2])))


def load(size: tuple[int, int]) -> Scenario:
    """Return the scenario with camera images of a size [pixels]."""
    changes = [f"cameras.{CAMERA}.{k}={v}" for k, v in zip(_SIDES, size, strict=True)]
    return load_scenario(SCENARIO, seed=0, overrides=changes)


def poses(
    scenario: Scenario, way: str, grid: int, others: int
) -> Iterator[RigidTransform]:
    """Yield poses X_WO of the cylinder all over the pick region, or in the recess.

    Args:
        scenario: See `load`.
        way: STANDING, RECESS, TILTED or LYING.
        grid: Standing places along each side of the region, and places in the recess.
        others: Number of tilted or lying places.
    """
    rng = np.random.default_rng(0)
    shape = scenario.objects[scenario.task.pick].shape
    assert isinstance(shape, Cylinder)
    region = scenario.task.region
    assert region is not None
    if way == STANDING:
        sides = np.linspace(region.min, region.max, grid).T
        places = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
        tilts = np.zeros(len(places))
    elif way == RECESS:
        places = rng.uniform(-_PLAY, _PLAY, (grid, 2)) + scenario.task.place.position
        tilts = np.zeros(len(places))
    else:
        places = rng.uniform(region.min, region.max, (others, 2))
        least = 0.0 if way == TILTED else np.pi / 2
        tilts = rng.uniform(least, np.pi / 2, others)
    for place, tilt in zip(places, tilts, strict=True):
        azimuth = rng.uniform(-np.pi, np.pi)
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        axis = np.sin(tilt) * level + [0.0, 0.0, np.cos(tilt)]
        height = 0.5 * shape.length * np.cos(tilt) + shape.radius * np.sin(tilt)
        height += scenario.table.height - (_RECESS_DEPTH if way == RECESS else 0.0)
        R_WO = RotationMatrix.MakeFromOneVector(axis, 2)
        yield RigidTransform(R_WO, [*place, height])


class Eye:
    """The station and the localizer of a scenario, without the rest of its cell."""

    def __init__(self, scenario: Scenario):
        self._name = scenario.task.pick
        builder = DiagramBuilder()
        station = builder.AddNamedSystem("station", MakeStation(scenario))
        self._localizer = AddLocalizer(builder, scenario, station)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant = station.GetSubsystemByName("plant")

    def look(self, X_WO: RigidTransform) -> Sighting:
        """Move the picked object and locate it."""
        moved = self._plant.GetMyMutableContextFromRoot(self._context)
        put_object(self._plant, moved, self._name, X_WO)
        context = self._localizer.GetMyContextFromRoot(self._context)
        blobs = self._localizer.GetOutputPort("blobs").Eval(context)
        blobs = [blob for blob in blobs if blob.object_name == self._name]
        if len(blobs) != 1:  # a second blob would show something else
            return Sighting(X_WO, np.full(3, np.nan), np.nan, np.nan, True)
        blob = blobs[0]
        return Sighting(
            X_WO,
            blob.position - X_WO.translation(),
            angle_between_axes(blob.axis, X_WO.rotation().matrix()[:, 2]),
            blob.quality,
            BlobFlag.UNCERTAIN in blob.flags,
        )


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
