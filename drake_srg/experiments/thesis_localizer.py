"""The five-axis arm's thesis's localizer and ours, on the same images.

The thesis's rule knows no shape: it takes the middle of a blob and the depth of one
pixel plus 10 mm. Both localizers look at the cylinder at the thesis's place with three
cameras, of which the thesis describes one, and all over the pick region with ours.
Nothing is simulated. Only the images are judged.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from drake_srg.experiments.localization import ACTUAL, DETECTED
from drake_srg.experiments.localization_cases import CAMERA, SCENARIO, STANDING, poses
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.varied_scenes import put_object
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station import MakeStation
from drake_srg.station.perception import AddLocalizer
from drake_srg.theses.blob_localizer import ThesisBlobConfig, ThesisBlobLocalizer
from drake_srg.types import Vector

# Cameras that look straight down: where they hang in world [m]. The thesis describes
# its camera as above the middle of the scene, and publishes neither place nor angle. At
# 1.4 m, ours sees both tables from there.
OURS = "above both tables, as ours"
CAMERAS: Mapping[str, tuple[float, ...] | None] = {
    OURS: None,
    "above the scene's middle, as the thesis's": (0.0, 0.0, 1.4),
    "above the cylinder": (float(ACTUAL[0]), float(ACTUAL[1]), 1.0),
}
_THESIS, _OWN = "thesis's localizer", "our localizer"
# The rule gives a height 10 mm below the top, whatever the camera: 15 mm above the
# centre. The thesis prints 14.989 mm; this is ten times what is missing there [mm].
_HEIGHT_WITHIN = 0.1


class Eyes:
    """A camera of the cell with both localizers.

    Args:
        scenario: Of the cell.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._name = scenario.task.pick
        builder = DiagramBuilder()
        station = builder.AddNamedSystem("station", MakeStation(scenario))
        self._own = AddLocalizer(builder, scenario, station)
        ruled = dc.replace(
            scenario,
            localizer=dc.replace(scenario.localizer, thesis=ThesisBlobConfig()),
        )
        # Two systems of a diagram cannot have the same name.
        self._own.set_name("our_localizer")
        thesis = AddLocalizer(builder, ruled, station)
        assert isinstance(thesis, ThesisBlobLocalizer)
        self._thesis = thesis
        self._context = builder.Build().CreateDefaultContext()
        self._plant = station.GetSubsystemByName("plant")

    def look(self, X_WO: RigidTransform) -> dict[str, Vector]:
        """Return each localizer's estimate minus the centre of a cylinder there [m].

        An estimate is NaN where the localizer sees nothing. Shape (3,) each.
        """
        moved = self._plant.GetMyMutableContextFromRoot(self._context)
        put_object(self._plant, moved, self._name, X_WO)
        blob = self._thesis.locate(self._thesis.GetMyContextFromRoot(self._context))
        context = self._own.GetMyContextFromRoot(self._context)
        own = self._own.GetOutputPort("blobs").Eval(context)
        return {
            name: np.full(3, np.nan) if b is None else b.position - X_WO.translation()
            for name, b in ((_THESIS, blob), (_OWN, own[0] if own else None))
        }


def run(track: Track, *, grid: int = 9) -> ExperimentResult:
    """Look from three places, then all over the region.

    Args:
        track: Shows progress.
        grid: Places along each side of the pick region.
    """
    eyes = {name: Eyes(load(place)) for name, place in track(list(CAMERAS.items()))}
    at_place = {name: eye.look(RigidTransform(ACTUAL)) for name, eye in eyes.items()}
    places = list(poses(load(None), STANDING, grid, 0))
    seen = [eyes[OURS].look(X_WO) for X_WO in track(places, lambda X: "")]
    errors = {name: np.array([look[name] for look in seen]) for name in (_THESIS, _OWN)}
    p_WO = np.array([X_WO.translation() for X_WO in places])
    return make_result(at_place, p_WO, errors)


def load(place: Sequence[float] | None) -> Scenario:
    """Return the scenario with its camera elsewhere [m]; None: where it is."""
    camera = load_scenario(SCENARIO, seed=0).cameras[CAMERA]
    # As in CoppeliaSim, the optical axis passes through the middle of the image. By
    # default, Drake's passes half a pixel beside it, which the rule does not know.
    changes = [
        f"cameras.{CAMERA}.center_x={camera.width / 2}",
        f"cameras.{CAMERA}.center_y={camera.height / 2}",
    ]
    if place is not None:
        changes.append(f"cameras.{CAMERA}.X_PB.translation={list(place)}")
    return load_scenario(SCENARIO, seed=0, overrides=changes)


def make_result(
    at_place: Mapping[str, Mapping[str, Vector]],
    p_WO: Vector,
    errors: Mapping[str, Vector],
) -> ExperimentResult:
    """Judge what was seen.

    Args:
        at_place: Errors at the thesis's place by camera and localizer, shape (3,) [m].
        p_WO: Places in the region, shape (K, 3) [m].
        errors: Errors there by localizer, shape (K, 3) [m].
    """
    columns: dict[str, Any] = {
        f"{axis} [m]": p_WO[:, i] for i, axis in enumerate("xyz")
    }
    for name, found in errors.items():
        for i, axis in enumerate("xyz"):
            columns[f"{name}: error in {axis} [m]"] = found[:, i]
    return ExperimentResult(
        judge(at_place, errors), {"region": columns}, draw(at_place, p_WO, errors)
    )


def judge(
    at_place: Mapping[str, Mapping[str, Vector]], errors: Mapping[str, Vector]
) -> list[Row]:
    """Judge the thesis's place, then the region; see `make_result`."""
    printed = 1e3 * (DETECTED - ACTUAL)
    rows = []
    for camera, found in at_place.items():
        for name, error in found.items():
            case = f"at the thesis's place, camera {camera}, {name}"
            for i, axis in enumerate("xyz"):
                value = 1e3 * float(error[i])
                quantity = f"error in {axis}"
                if name == _THESIS and axis == "z":
                    rows.append(
                        Row.within(
                            case,
                            f"{quantity}; expected: as printed",
                            float(printed[2]),
                            value,
                            "mm",
                            absolute=_HEIGHT_WITHIN,
                        )
                    )
                elif name == _THESIS:
                    text = f"{quantity}; the thesis prints {printed[i]:.3f}"
                    rows.append(Row.info(case, text, value, "mm"))
                else:
                    most = abs(float(printed[i]))
                    text = f"{quantity}; expected: the thesis's"
                    rows.append(Row.at_most(case, text, most, abs(value), "mm"))
    for name, everywhere in errors.items():
        largest = 1e3 * np.max(np.abs(everywhere), axis=0)
        for axis, value in zip("xyz", largest, strict=True):
            case = f"all over the region, {name}"
            rows.append(Row.info(case, f"largest error in {axis}", float(value), "mm"))
    thesis, own = (np.linalg.norm(errors[name], axis=1) for name in (_THESIS, _OWN))
    rows.append(
        Row.at_least(
            "all over the region",
            "places where our localizer is nearer to the centre",
            len(own),
            float(np.sum(own < thesis)),
            "",
        )
    )
    return rows


def draw(
    at_place: Mapping[str, Mapping[str, Vector]],
    p_WO: Vector,
    errors: Mapping[str, Vector],
) -> Any:
    """Draw errors at the thesis's place by camera, and over the region."""
    figure = make_figure(11.0, 4.6, "The thesis's localizer and ours, same images")
    bars, region = figure.subplots(1, 2)
    style_axes(bars, ylabel="error at the thesis's place [mm]")
    at = np.arange(3)
    printed = 1e3 * np.abs(DETECTED - ACTUAL)
    bars.bar(at - 0.36, printed, 0.11, color=COLORS[-1], label="printed in the thesis")
    k = 0
    for name, hatch in ((_THESIS, ""), (_OWN, "///")):
        for color, (camera, found) in zip(COLORS, at_place.items(), strict=False):
            k += 1
            label = f"{name}, camera {camera.partition(',')[0]}"
            error = 1e3 * np.abs(found[name])
            style: dict[str, Any] = {"color": color, "hatch": hatch, "label": label}
            bars.bar(at - 0.36 + 0.12 * k, error, 0.11, edgecolor="white", **style)
    bars.set_yscale("log")
    bars.set_ylim(1e-5, 50.0)  # whatever is less is exact
    bars.set_xticks(at, list("xyz"))
    style_axes(region, xlabel="x [mm]", ylabel="y [mm]")
    for color, (name, everywhere) in zip(COLORS[3:], errors.items(), strict=False):
        arrows = region.quiver(
            *1e3 * p_WO[:, :2].T,
            *1e3 * everywhere[:, :2].T,
            color=color,
            angles="xy",
            scale_units="xy",
            scale=0.1,
            label=name,
        )
    region.quiverkey(arrows, 0.9, 1.04, 2.0, "2 mm", fontproperties={"size": 8})
    low, high = 1e3 * p_WO[:, :2].min(axis=0), 1e3 * p_WO[:, :2].max(axis=0)
    region.set_xlim(low[0] - 45.0, high[0] + 25.0)  # with room for arrows
    region.set_ylim(low[1] - 45.0, high[1] + 25.0)
    region.set_aspect("equal")
    region.set_title("Error in x and y, camera as ours", fontsize=9, loc="left")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure
