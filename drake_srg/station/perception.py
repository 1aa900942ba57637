"""The perception of a cell: localizer, obstacle finder, labels and height maps."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Iterable

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System

from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.systems import input_ports
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import body_color, known_shape
from drake_srg.objects.solids import body_corners, known_solid
from drake_srg.planning.clearing.destination import BESIDE, Destination
from drake_srg.planning.clearing.placing import row_destination
from drake_srg.scenario import Scenario, perception_cameras, robot_arms
from drake_srg.station.plant import Models
from drake_srg.theses.blob_localizer import ThesisBlobConfig, ThesisBlobLocalizer
from drake_srg.types import Vector
from drake_srg.vision.blob_localizer import BlobLocalizer, BlobTarget
from drake_srg.vision.camera import CameraModel, calibrated_model
from drake_srg.vision.color import ColorRange, color_name
from drake_srg.vision.height_map import THING, HeightMapper
from drake_srg.vision.obstacles import ObstacleFinder
from drake_srg.vision.surfaces import CameraLeveling, Surface
from drake_srg.vision.thing_labeler import ALL, KnownThing, ThingLabeler

# A goal whose height differs from the table's by at most this is a recess in the table
# or a mat on it, not a surface of its own [m].
_RECESS = 0.01


def AddLocalizer(
    builder: DiagramBuilder, scenario: Scenario, station: Diagram
) -> BlobLocalizer | ThesisBlobLocalizer:
    """Add the localizer of a scenario and connect it to the station's cameras.

    Raises:
        ScenarioError: If the localizer knows none of the objects, two look alike, a
            range of colours is invalid, or the thesis's localizer has more than one
            camera.
    """
    cameras, config = camera_models(scenario), scenario.localizer
    if config.thesis is not None:
        localizer = builder.AddNamedSystem(
            "localizer", _thesis_localizer(scenario, config.thesis)
        )
        _ConnectCameras(builder, station, localizer)
        return localizer
    localizer = builder.AddNamedSystem(
        "localizer",
        BlobLocalizer(blob_targets(scenario), cameras, min_area=config.min_area),
    )
    if config.level_cameras:
        for name, camera in cameras.items():
            leveling = builder.AddNamedSystem(
                f"camera_leveling_{name}", CameraLeveling(camera, _tables(scenario))
            )
            for port in ("depth_image", "body_pose_in_world"):
                source = station.GetOutputPort(f"camera_{name}.{port}")
                builder.Connect(source, leveling.GetInputPort(port))
    _ConnectCameras(builder, station, localizer, level=config.level_cameras)
    return localizer


def _thesis_localizer(
    scenario: Scenario, config: ThesisBlobConfig
) -> ThesisBlobLocalizer:
    """Return the localizer of the five-axis arm's thesis, for one camera."""
    cameras = camera_models(scenario)
    if len(cameras) != 1:
        raise ScenarioError(
            "localizer.cameras: must name one camera where localizer.thesis is given, "
            f"got {', '.join(cameras)}"
        )
    ((name, camera),) = cameras.items()
    return ThesisBlobLocalizer(scenario.task.pick, name, camera, config)


def _ConnectCameras(
    builder: DiagramBuilder, station: Diagram, system: System, *, level: bool = False
) -> None:
    """Connect a system's inputs `CAMERA.PORT` to the cameras of a station.

    With `level`, the poses come from each camera's `CameraLeveling`.
    """
    for name, port in input_ports(system).items():
        camera, of_camera, what = name.partition(".")
        if not of_camera:
            continue
        source = station.GetOutputPort(f"camera_{name}")
        if level and what == "body_pose_in_world":
            leveling = builder.GetSubsystemByName(f"camera_leveling_{camera}")
            source = leveling.get_output_port()
        builder.Connect(source, port)


def AddObstacleFinder(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Diagram,
    localizer: System,
) -> ObstacleFinder:
    """Add the finder of obstacles and connect it to the station and the localizer."""
    known = {n: known_shape(n, config) for n, config in scenario.objects.items()}
    finder = builder.AddNamedSystem(
        "obstacle_finder",
        ObstacleFinder(
            camera_models(scenario),
            _surfaces(scenario),
            {name: shape for name, shape in known.items() if shape is not None},
        ),
    )
    level = scenario.localizer.level_cameras
    _ConnectCameras(builder, station, finder, level=level)
    builder.Connect(localizer.GetOutputPort("blobs"), finder.GetInputPort("blobs"))
    return finder


def camera_models(scenario: Scenario) -> dict[str, CameraModel]:
    """Return the models of the localizer's cameras."""
    return _models(scenario, scenario.localizer.cameras)


def destination_camera_models(scenario: Scenario) -> dict[str, CameraModel]:
    """Return the models of all cameras that look at the destinations of loads."""
    return _models(scenario, perception_cameras(scenario))


def _models(scenario: Scenario, names: Iterable[str]) -> dict[str, CameraModel]:
    calibrations = scenario.camera_calibrations
    return {
        name: calibrated_model(scenario.cameras[name], calibrations.get(name))
        for name in names
    }


def _surfaces(scenario: Scenario) -> list[Surface]:
    """Return the surfaces with possible obstacles: around objects' region and goal."""
    task, table = scenario.task, scenario.table
    low = np.maximum(np.array(task.region.min) - task.spacing, table.min)
    high = np.minimum(np.array(task.region.max) + task.spacing, table.max)
    return [
        Surface((low[0], low[1]), (high[0], high[1]), table.height),
        _around_goal(scenario),
    ]


def _tables(scenario: Scenario) -> list[Surface]:
    """Return the level surfaces: the table and the surroundings of the goal."""
    low, high = scenario.table.min, scenario.table.max
    table = Surface((low[0], low[1]), (high[0], high[1]), scenario.table.height)
    return [table, _around_goal(scenario)]


def _around_goal(scenario: Scenario) -> Surface:
    (x, y), around = scenario.task.place.position, scenario.task.spacing
    height = scenario.table.height
    on = scenario.task.place.height
    if on is not None and abs(on - height) > _RECESS:
        height = on
    return Surface((x - around, y - around), (x + around, y + around), height)


def blob_targets(scenario: Scenario) -> list[BlobTarget]:
    """Return the objects that a scenario's localizer looks for.

    Raises:
        ScenarioError: If there are no such objects, two look alike, or a range of
            colours is invalid.
    """
    targets: list[BlobTarget] = []
    for name, config in scenario.objects.items():
        solid = known_solid(name, config)
        if solid is None:
            continue  # the localizer does not look for it
        shape, p_OC = solid
        with scenario_errors(f"objects.{name}.color_range"):
            colors = _color_range(config)
        for other in targets:
            if (other.shape, other.color) == (shape, colors):
                raise ScenarioError(
                    f"objects.{name}: looks like {other.name}; "
                    "give it another shape, color or color_range"
                )
        targets.append(BlobTarget(name, shape, colors, tuple(p_OC)))
    if not targets:
        raise ScenarioError(
            "objects: the localizer knows none of them (allowed: a single cylinder, "
            "box or sphere, or a model with a color_range)"
        )
    return targets


def _color_range(config: ObjectConfig) -> ColorRange:
    if config.color_range is None:
        return ColorRange.around(config.color)
    lower, upper = config.color_range.lower, config.color_range.upper
    return ColorRange(
        (lower[0], lower[1], lower[2]),
        (upper[0], upper[1], upper[2]),
        config.color_range.space,  # type: ignore[arg-type] # ColorRange checks it
    )


ROW = "row"  # in place of a bin's name


@dc.dataclass(frozen=True)
class Label:
    """A label of things, and their bin.

    Attributes:
        name: Name of an object or a colour, or `all`.
        bin: Name of the bin's model, or `ROW`.
        named: Whether `name` is that of an object.
    """

    name: str
    bin: str
    named: bool = False


def labels(scenario: Scenario) -> tuple[Label, ...]:
    """Return the labels of a scenario that clears its table, in order of priority.

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
    """Return the place of each object in the row, on its support, (3,) [m]."""
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


def needs_labels(scenario: Scenario) -> bool:
    """Return whether the planner must tell things apart.

    It must if some things stay on the table, or their bins differ.
    """
    return [label.name for label in labels(scenario)] != [ALL]


def destinations(scenario: Scenario) -> dict[str, str | None]:
    """Return the bin of each object; None for objects that must stay.

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
    """Return the name of an object's colour; empty if the model has no colour."""
    rgb = body_color(name, config)
    return "" if rgb is None else color_name(rgb)


def AddThingLabeler(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Diagram,
    height_map: OutputPort,
) -> OutputPort:
    """Add a labeler of height maps, and return the port of the labelled map.

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
    _ConnectCameras(builder, station, labeler)
    if known:
        localizer = AddLocalizer(builder, scenario, station)
        builder.Connect(localizer.GetOutputPort("blobs"), labeler.GetInputPort("blobs"))
    labeled: OutputPort = labeler.get_output_port()
    return labeled


# Least height of a bin's rim above the table [m].
_LEAST_RIM = 0.02


def bin_boxes(scenario: Scenario) -> dict[str, tuple[Vector, Vector]]:
    """Return the least and greatest corner of each bin by name, in world, (3,) [m].

    Raises:
        ScenarioError: If a model has no collision geometry, or does not rise above the
            table.
    """
    models = Models.of(scenario)
    boxes = {}
    for name in scenario.task.place.bins:
        try:
            boxes[name] = _fixed_box(models, name)
        except ScenarioError as error:
            raise ScenarioError(f"{bin_key(scenario, name)}: {error}") from None
        rise = boxes[name][1][2] - scenario.table.height
        if rise < _LEAST_RIM:
            raise ScenarioError(
                f"{bin_key(scenario, name)}: {name!r} is too low: a bin must rise at "
                f"least {_LEAST_RIM} m above the table, got {rise:.3f} m"
            )
    return boxes


def bin_floor(scenario: Scenario, name: str) -> float:
    """Return an upper bound of the world z of a bin's floor [m].

    It is the centre of the bin's opening, lowered by its distance to the nearest wall
    or floor.
    """
    low, high = _fixed_box(Models.of(scenario), name)
    p_W = np.array([*(0.5 * (low + high))[:2], high[2]])
    return float(high[2] - _distance(Models.of(scenario), name, tuple(p_W)))


def bin_key(scenario: Scenario, name: str) -> str:
    """Return the key that names a bin, for messages."""
    return "task.place.bin" if scenario.task.place.bin else f"task.place.bins.{name}"


def foot_box(scenario: Scenario) -> tuple[Vector, Vector]:
    """Return the least and greatest corner of the arm's fixed part, (3,) [m]."""
    return _fixed_box(Models.of(scenario), robot_arms(scenario)[0].arm_model)


@functools.lru_cache(maxsize=4)
def _distance(models: Models, name: str, p_W: tuple[float, ...]) -> float:
    """Return the distance of a point from a model, or 0 if Drake computes none [m]."""
    diagram, plant, scene_graph = _built(models)
    context = scene_graph.GetMyContextFromRoot(diagram.CreateDefaultContext())
    query = scene_graph.get_query_output_port().Eval(context)
    own = {
        geometry
        for index in plant.GetBodyIndices(plant.GetModelInstanceByName(name))
        for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index))
    }
    near = query.ComputeSignedDistanceToPoint(np.array(p_W))
    return float(min((d.distance for d in near if d.id_G in own), default=0.0))


@functools.lru_cache(maxsize=4)
def _fixed_box(models: Models, name: str) -> tuple[Vector, Vector]:
    """Return the least and greatest corner of a model's fixed bodies, (3,) [m]."""
    diagram, plant, scene_graph = _built(models)
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    inspector = scene_graph.model_inspector()
    corners = [np.zeros((0, 3))]
    for index in plant.GetBodyIndices(plant.GetModelInstanceByName(name)):
        body = plant.get_body(index)
        X_WB: RigidTransform = plant.EvalBodyPoseInWorld(context, body)
        if plant.IsAnchored(body) and plant.GetCollisionGeometriesForBody(body):
            corners.append((X_WB @ body_corners(plant, inspector, body).T).T)
    points = np.concatenate(corners)
    if not len(points):
        raise ScenarioError(f"{name!r} has no fixed collision geometry")
    return points.min(axis=0), points.max(axis=0)


def _built(models: Models) -> tuple[Diagram, MultibodyPlant, SceneGraph]:
    """Return the models' plant in a diagram with its geometry."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    models.add_to(plant)
    plant.Finalize()
    return builder.Build(), plant, scene_graph


# The map of the table leaves out each bin with a margin for errors of the map [m],
# the arm's foot and a row's places, with these margins.
_AROUND_BIN = 0.006
_AROUND_FOOT = 0.05
_AROUND_ROW = 0.08
# The map of destinations drops things over its edge only if they are this much higher
# than the rims of the bins [m].
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
    # The planner looks only with the arm out of the way, so things may reach over the
    # map's edge.
    mapper = HeightMapper(
        camera_models(scenario), region, ignored=ignored, over_edge=True
    )
    builder.AddNamedSystem(robot_arms(scenario)[0].system("height_mapper"), mapper)
    _ConnectCameras(builder, station, mapper)
    return mapper


def AddDestinationMapper(
    builder: DiagramBuilder, scenario: Scenario, station: Diagram
) -> HeightMapper:
    """Add a height mapper of the loads' destinations, connected to the cameras."""
    places = clearing_destinations(scenario)
    low = np.min([place.low for place in places], axis=0) - BESIDE
    high = np.max([place.high for place in places], axis=0) + BESIDE
    region = _surface(scenario, low, high)
    cameras = destination_camera_models(scenario)
    thing, over_edge = destination_map_limits(scenario)
    mapper = HeightMapper(cameras, region, thing=thing, over_edge=over_edge)
    builder.AddNamedSystem(robot_arms(scenario)[0].system("destination_mapper"), mapper)
    _ConnectCameras(builder, station, mapper)
    return mapper


def destination_map_limits(scenario: Scenario) -> tuple[float, bool]:
    """Return `thing` [m] and `over_edge` of the map of the loads' destinations.

    With bins, a region over the map's edge becomes unknown only if it is much higher
    than the rims: it is then the arm at the next thing. So an arm beside a bin hides
    nothing inside.
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
