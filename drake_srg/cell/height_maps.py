"""The height maps of a cell that clears its table: of it, and of where loads go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.cell.bins import bin_boxes, foot_box
from drake_srg.cell.choosing import row_places
from drake_srg.cell.perception import camera_models, destination_camera_models
from drake_srg.planning.clearing.destination import BESIDE, Destination
from drake_srg.planning.clearing.placing import row_destination
from drake_srg.scenario import Scenario
from drake_srg.types import Vector
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.height_map import THING
from drake_srg.vision.height_mapper import HeightMapper
from drake_srg.vision.surface import Surface

# The map leaves out the bin and as much around it, for errors of the map [m].
_AROUND_BIN = 0.006
_AROUND_FOOT = 0.05  # and this much around the foot of the arm [m]
_AROUND_ROW = 0.08  # and this much around the middles of a row [m]
# A hand beside a bin hides the bin only where it is this much higher than the rim [m].
_ABOVE_RIM = 0.03


def AddHeightMapper(
    builder: DiagramBuilder, scenario: Scenario, station: Diagram
) -> HeightMapper:
    """Add the height mapper of a scenario and connect it to the station's cameras."""
    clear = scenario.task.clear
    assert clear is not None
    taken = [(*box, _AROUND_BIN) for box in bin_boxes(scenario).values()]
    taken.append((*foot_box(scenario), _AROUND_FOOT))
    if row := list(row_places(scenario).values()):
        taken.append((np.min(row, axis=0), np.max(row, axis=0), _AROUND_ROW))
    ignored = [
        _surface(scenario, corner[:2] - around, opposite[:2] + around)
        for corner, opposite, around in taken
    ]
    region = _surface(scenario, np.array(clear.region.min), np.array(clear.region.max))
    # The planner looks with the arm out of the way.
    return _AddMapper(
        "height_mapper",
        builder,
        station,
        camera_models(scenario),
        region,
        ignored,
        over_edge=True,
    )


def AddDestinationMapper(
    builder: DiagramBuilder, scenario: Scenario, station: Diagram
) -> HeightMapper:
    """Add a height mapper of where loads go, connected to the station's cameras."""
    places = clearing_destinations(scenario)
    low = np.min([place.low for place in places], axis=0) - BESIDE
    high = np.max([place.high for place in places], axis=0) + BESIDE
    region = _surface(scenario, low, high)
    cameras = destination_camera_models(scenario)
    thing, over_edge = destination_map_limits(scenario)
    return _AddMapper(
        "destination_mapper",
        builder,
        station,
        cameras,
        region,
        thing=thing,
        over_edge=over_edge,
    )


def destination_map_limits(scenario: Scenario) -> tuple[float, bool]:
    """Return `thing` [m] and `over_edge` of the map of where loads go.

    With them, an arm beside a bin hides nothing inside: what reaches over the map's
    edge that high is the arm at the next thing.
    """
    if rims := [high[2] for _, high in bin_boxes(scenario).values()]:
        return float(max(rims)) + _ABOVE_RIM - scenario.table.height, False
    return THING, True


def clearing_destinations(scenario: Scenario) -> list[Destination]:
    """Return the bins, or the places of a row."""
    bins = [Destination(a[:2], b[:2]) for a, b in bin_boxes(scenario).values()]
    return bins + [row_destination(p_WO) for p_WO in row_places(scenario).values()]


def _surface(scenario: Scenario, low: Vector, high: Vector) -> Surface:
    return Surface((low[0], low[1]), (high[0], high[1]), scenario.table.height)


def _AddMapper(
    name: str,
    builder: DiagramBuilder,
    station: Diagram,
    cameras: Mapping[str, CameraModel],
    region: Surface,
    ignored: Sequence[Surface] = (),
    *,
    thing: float = THING,
    over_edge: bool,
) -> HeightMapper:
    mapper = HeightMapper(
        cameras, region, ignored=ignored, thing=thing, over_edge=over_edge
    )
    builder.AddNamedSystem(name, mapper)
    for camera in cameras:
        for port in ("depth_image", "body_pose_in_world"):
            source = station.GetOutputPort(f"camera_{camera}.{port}")
            builder.Connect(source, mapper.GetInputPort(f"{camera}.{port}"))
    return mapper
