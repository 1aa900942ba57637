"""The perception of a cell: the localizer and the finder of obstacles."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System

from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import known_shape
from drake_srg.objects.solids import known_solid
from drake_srg.scenario import Scenario, perception_cameras
from drake_srg.vision.blob_localizer import BlobLocalizer, BlobTarget
from drake_srg.vision.calibrated_camera import calibrated_model
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.camera_leveling import CameraLeveling
from drake_srg.vision.color import ColorRange
from drake_srg.vision.obstacles import ObstacleFinder
from drake_srg.vision.surface import Surface
from drake_srg.vision.thesis_blob_localizer import ThesisBlobLocalizer

# A goal whose height differs from the table's by no more than this is a recess of the
# table or a mat on it, not a surface of its own [m].
_RECESS = 0.01


def AddLocalizer(
    builder: DiagramBuilder, scenario: Scenario, station: Diagram
) -> BlobLocalizer | ThesisBlobLocalizer:
    """Add the localizer of a scenario and connect it to the station's cameras.

    Raises:
        ScenarioError: If it knows none of the objects, if two look alike, if a range of
            colours is invalid, or if the thesis's localizer has more than one camera.
    """
    cameras, config = camera_models(scenario), scenario.localizer
    if config.thesis is not None:
        return _AddThesisLocalizer(builder, scenario, station)
    localizer = builder.AddNamedSystem(
        "localizer",
        BlobLocalizer(
            blob_targets(scenario),
            cameras,
            min_area=config.min_area,
        ),
    )
    for name, camera in cameras.items():
        for port in ("color_image", "depth_image", "body_pose_in_world"):
            source = station.GetOutputPort(f"camera_{name}.{port}")
            if port == "body_pose_in_world" and config.level_cameras:
                source = _AddLeveling(builder, scenario, station, name, camera)
            builder.Connect(source, localizer.GetInputPort(f"{name}.{port}"))
    return localizer


def _AddThesisLocalizer(
    builder: DiagramBuilder, scenario: Scenario, station: Diagram
) -> ThesisBlobLocalizer:
    """Add the localizer of the arm's thesis and connect it to its one camera."""
    cameras = camera_models(scenario)
    if len(cameras) != 1:
        raise ScenarioError(
            "localizer.cameras: must name one camera where localizer.thesis is given, "
            f"got {', '.join(cameras)}"
        )
    ((name, camera),) = cameras.items()
    localizer = builder.AddNamedSystem(
        "localizer",
        ThesisBlobLocalizer(
            scenario.task.pick, name, camera, scenario.localizer.thesis
        ),
    )
    for port in ("color_image", "depth_image", "body_pose_in_world"):
        source = station.GetOutputPort(f"camera_{name}.{port}")
        builder.Connect(source, localizer.GetInputPort(f"{name}.{port}"))
    return localizer


def AddObstacleFinder(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Diagram,
    localizer: System,
) -> ObstacleFinder:
    """Add the finder of obstacles and connect it to the station and the localizer."""
    cameras = camera_models(scenario)
    known = {n: known_shape(n, config) for n, config in scenario.objects.items()}
    finder = builder.AddNamedSystem(
        "obstacle_finder",
        ObstacleFinder(
            cameras,
            _surfaces(scenario),
            {name: shape for name, shape in known.items() if shape is not None},
        ),
    )
    for name in cameras:
        depth = station.GetOutputPort(f"camera_{name}.depth_image")
        builder.Connect(depth, finder.GetInputPort(f"{name}.depth_image"))
        pose = station.GetOutputPort(f"camera_{name}.body_pose_in_world")
        if scenario.localizer.level_cameras:
            leveling = builder.GetSubsystemByName(f"camera_leveling_{name}")
            pose = leveling.get_output_port()
        builder.Connect(pose, finder.GetInputPort(f"{name}.body_pose_in_world"))
    builder.Connect(localizer.GetOutputPort("blobs"), finder.GetInputPort("blobs"))
    return finder


def _AddLeveling(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Diagram,
    name: str,
    camera: CameraModel,
) -> OutputPort:
    """Add a CameraLeveling and return the port of the camera's corrected pose."""
    leveling = builder.AddNamedSystem(
        f"camera_leveling_{name}",
        CameraLeveling(camera, _tables(scenario)),
    )
    for port in ("depth_image", "body_pose_in_world"):
        source = station.GetOutputPort(f"camera_{name}.{port}")
        builder.Connect(source, leveling.GetInputPort(port))
    return leveling.get_output_port()


def camera_models(scenario: Scenario) -> dict[str, CameraModel]:
    """Return the models of the localizer's cameras."""
    return _models(scenario, scenario.localizer.cameras)


def destination_camera_models(scenario: Scenario) -> dict[str, CameraModel]:
    """Return the models of all cameras that see where loads go."""
    return _models(scenario, perception_cameras(scenario))


def _models(scenario: Scenario, names: Iterable[str]) -> dict[str, CameraModel]:
    calibrations = scenario.camera_calibrations
    return {
        name: calibrated_model(scenario.cameras[name], calibrations.get(name))
        for name in names
    }


def _surfaces(scenario: Scenario) -> list[Surface]:
    """Return where obstacles may stand: around the objects' region and the goal."""
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
        ScenarioError: If there are none, if two look alike, or if a range of colours is
            invalid.
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
        config.color_range.space,  # type: ignore[arg-type] # it checks that itself
    )
