"""What the camera in the hand shows of an object in the hand, rendered."""

from __future__ import annotations

import dataclasses as dc
import functools

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.common.yaml import yaml_dump_typed
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from drake_srg.cell.camera_mount import CameraMount
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.planning.grasps.grasps import Grasp
from drake_srg.scenario import Scenario, servo_of
from drake_srg.servoing.sightings import FeatureSighting
from drake_srg.servoing.silhouette_tracker import SilhouetteTracker
from drake_srg.station.plant import Models
from drake_srg.station.station import MakeStation
from drake_srg.vision.blob_localizer import BlobTarget
from drake_srg.vision.camera import CameraModel


@dc.dataclass(frozen=True)
class _Shown:
    """An object that is held before the camera, as the key of a cache."""

    models: Models
    camera: str  # its configuration
    object: str  # its configuration
    X_CO: bytes
    fingers: tuple[tuple[str, float], ...]
    scenario: Scenario = dc.field(compare=False)
    X_GO: RigidTransform = dc.field(compare=False)
    target: BlobTarget = dc.field(compare=False)
    model: CameraModel = dc.field(compare=False)


def silhouette_at(
    scenario: Scenario,
    mount: CameraMount,
    target: BlobTarget,
    grasp: Grasp,
    X_CO: RigidTransform,
) -> FeatureSighting:
    """Return what the tracker finds in an image of the object at a pose."""
    servo = servo_of(scenario)
    assert servo is not None
    thing = scenario.objects[target.name]
    return _rendered(
        _Shown(
            Models.of(scenario),
            yaml_dump_typed(scenario.cameras[servo.camera]),
            f"{thing.model} {thing.shape} {thing.scale} {thing.color}",
            np.round(X_CO.GetAsMatrix34(), 9).tobytes(),
            tuple(sorted(grasp.fingers_open.items())),
            scenario,
            mount.X_GC @ X_CO,
            target,
            mount.model,
        )
    )


@functools.lru_cache(maxsize=4)
def _rendered(shown: _Shown) -> FeatureSighting:
    """Render the object before the camera of an arm at home, and find it."""
    scenario, name = shown.scenario, shown.target.name
    servo = servo_of(scenario)
    assert servo is not None
    camera = servo.camera
    pose = Transform()
    pose.base_frame = "gripper::palm"
    pose.translation = shown.X_GO.translation()
    pose.rotation = Rotation(shown.X_GO.rotation())
    thing = dc.replace(
        scenario.objects[name], pose=pose, position=None, yaw=0.0, drop=None
    )
    alone = dc.replace(
        scenario,
        objects={name: thing},
        cameras={camera: scenario.cameras[camera]},
        camera_errors={},
        camera_calibrations={},
    )
    builder = DiagramBuilder()
    with scenario_errors():
        station = builder.AddNamedSystem("station", MakeStation(alone))
    tracker = builder.AddNamedSystem(
        "tracker", SilhouetteTracker(shown.target.color, shown.model)
    )
    for port in ("color_image", "depth_image"):
        builder.Connect(
            station.GetOutputPort(f"camera_{camera}.{port}"), tracker.GetInputPort(port)
        )
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant = station.GetSubsystemByName("plant")
    plant_context = plant.GetMyContextFromRoot(context)
    for joint, angle in shown.fingers:
        plant.GetJointByName(joint).set_angle(plant_context, angle)
    seen: FeatureSighting = tracker.get_output_port().Eval(
        tracker.GetMyContextFromRoot(context)
    )
    if not len(seen.points):
        raise ScenarioError(
            f"planner.servo.camera: {camera} does not see all of {name} in the hand"
        )
    return seen
