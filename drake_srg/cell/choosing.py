"""What a cell needs to take only some things: labels, and where each of them goes."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from drake_srg.cell.perception import AddLocalizer, camera_models
from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import body_color
from drake_srg.objects.solids import known_solid
from drake_srg.scenario import Scenario
from drake_srg.types import Vector
from drake_srg.vision.color_names import color_name
from drake_srg.vision.thing_labeler import ALL, KnownThing, ThingLabeler

ROW = "row"  # in place of a bin's name


@dc.dataclass(frozen=True)
class Label:
    """A label of things, and the bin that they belong into.

    Attributes:
        name: Of an object, of a colour, or `all`.
        bin: Name of the bin's model, or `ROW`.
        named: Whether it is the name of an object.
    """

    name: str
    bin: str
    named: bool = False


def labels(scenario: Scenario) -> tuple[Label, ...]:
    """Return the labels of a scenario that clears its table, the strongest first.

    Names count before colours, and colours before `all`.
    """
    if scenario.task.place.row is not None:
        assert scenario.task.clear is not None
        return tuple(Label(n, ROW, named=True) for n in scenario.task.clear.objects)
    found: list[Label] = []
    for bin_name, selection in scenario.task.place.bins.items():
        named = [Label(name, bin_name, named=True) for name in selection.names]
        found += named or [Label(selection.colour or ALL, bin_name)]
    return tuple(sorted(found, key=lambda a: (not a.named, a.name == ALL)))


def row_places(scenario: Scenario) -> dict[str, Vector]:
    """Return where each object belongs in the row, on its support, (3,) [m]."""
    place, clear = scenario.task.place, scenario.task.clear
    if place.row is None or clear is None:
        return {}
    height = scenario.table.height if place.height is None else place.height
    yaw = place.row.direction
    along, start = np.array([np.cos(yaw), np.sin(yaw)]), np.array(place.row.start)
    return {
        name: np.array([*(start + i * place.row.spacing * along), height])
        for i, name in enumerate(clear.objects)
    }


def chooses(scenario: Scenario) -> bool:
    """Return whether some things stay, or not all go into the same bin."""
    return [label.name for label in labels(scenario)] != [ALL]


def destinations(scenario: Scenario) -> dict[str, str | None]:
    """Return the bin that each object belongs into, None for those that must stay.

    The colour of a model is that of its first visual geometry.

    Raises:
        ScenarioError: If an object's model cannot be read.
    """
    found: dict[str, str | None] = {}
    for name, config in scenario.objects.items():
        known = {name} | ({_color(name, config)} if _needs_color(scenario) else set())
        suits = (
            label.bin
            for label in labels(scenario)
            if label.name == ALL or label.name in known
        )
        found[name] = next(suits, None)
    return found


def _needs_color(scenario: Scenario) -> bool:
    return any(not label.named and label.name != ALL for label in labels(scenario))


def _color(name: str, config: ObjectConfig) -> str:
    """Return the name of an object's colour; empty if the model does not tell it."""
    rgb = body_color(name, config)
    return "" if rgb is None else color_name(rgb)


def AddThingLabeler(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Diagram,
    height_map: OutputPort,
) -> OutputPort:
    """Add what labels a height map, and return the port of the labelled map.

    Raises:
        ScenarioError: If the localizer does not know an object that is picked by name.
    """
    cameras = camera_models(scenario)
    known: dict[str, KnownThing] = {}
    for name in (label.name for label in labels(scenario) if label.named):
        solid = known_solid(name, scenario.objects[name])
        if solid is None:
            raise ScenarioError(
                f"objects.{name}: the localizer cannot tell it from others; give it a "
                "shape or a color_range, or pick by colour"
            )
        shape, p_OC = solid
        known[name] = KnownThing(shape, tuple(p_OC))
    names = [label.name for label in labels(scenario)]
    labeler = builder.AddNamedSystem(
        "thing_labeler",
        ThingLabeler(
            names,
            cameras,
            known,
            scenario.table.height,
            upright=scenario.task.place.row is not None,
        ),
    )
    builder.Connect(height_map, labeler.GetInputPort("height_map"))
    for camera in cameras:
        for port in ("color_image", "body_pose_in_world"):
            if labeler.HasInputPort(f"{camera}.{port}"):
                source = station.GetOutputPort(f"camera_{camera}.{port}")
                builder.Connect(source, labeler.GetInputPort(f"{camera}.{port}"))
    if known:
        localizer = AddLocalizer(builder, scenario, station)
        builder.Connect(localizer.GetOutputPort("blobs"), labeler.GetInputPort("blobs"))
    labeled: OutputPort = labeler.get_output_port()
    return labeled
