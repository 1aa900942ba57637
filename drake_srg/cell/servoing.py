"""The planner of a scenario with a visual servo, and the goal of that servo."""

from __future__ import annotations

import dataclasses as dc
import functools

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.common.yaml import yaml_dump_typed
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import GetScopedFrameByName
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from drake_srg.cell.hands import MakeHand
from drake_srg.cell.perception import blob_targets
from drake_srg.cell.planners import planner_arguments
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.ports import input_ports, output_ports
from drake_srg.objects.models import object_shape
from drake_srg.planning.grasps.grasps import Grasp
from drake_srg.scenario import Scenario
from drake_srg.servoing.arm import ServoArm
from drake_srg.servoing.config import ServoingConfig
from drake_srg.servoing.image_based import ImageBasedServo
from drake_srg.servoing.position_based import PositionBasedServo
from drake_srg.servoing.servoing_planner import ServoingPlanner
from drake_srg.servoing.sightings import FeatureSighting
from drake_srg.servoing.silhouette_tracker import SilhouetteTracker
from drake_srg.servoing.surface_tracker import SurfaceTracker
from drake_srg.servoing.visual_servo import VisualServo
from drake_srg.station.plant import MakeModelsPlant, Models
from drake_srg.station.station import MakeStation
from drake_srg.vision.blob_localizer import BlobTarget
from drake_srg.vision.calibrated_camera import calibrated_model
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.camera_errors import X_BE_believed

_AHEAD = np.array([1.0, 0.0, 0.0])  # of the palm: where the fingers point
_UP = np.array([0.0, 0.0, 1.0])
_IMAGES = ("color_image", "depth_image")


def MakeServoingPlanner(scenario: Scenario) -> Diagram:
    """Make the planner of a scenario with `servoing`, together with its servo.

    .. pydrake_system::

        name: ServoedPlanner
        input_ports:
        - blobs
        - arm_state
        - gripper_state
        - grasped
        - proximity
        - obstacles (optional)
        - external_torque (optional)
        - CAMERA.color_image
        - CAMERA.depth_image
        output_ports:
        - position_commanded
        - servo_status
        - closure_commanded
        - mode
        - status

    The subsystems are `planner`, `servo` and `tracker`, a `SurfaceTracker` (pbvs) or a
    `SilhouetteTracker` (ibvs). `position_commanded` is the servo's.

    Raises:
        ScenarioError: If the planner's hand knows no grasp of the object or more than
            one, or if the camera is not fixed to the hand.
    """
    assert scenario.servoing is not None
    builder = DiagramBuilder()
    config = scenario.servoing
    planner = builder.AddNamedSystem(
        "planner",
        ServoingPlanner(**planner_arguments(scenario), time_limit=config.time_limit),
    )
    plant = MakeModelsPlant(scenario)
    mount = CameraMount.of(scenario, plant)
    servo, tracker = _AddServo(builder, scenario, config, mount, plant)
    for source, target in (
        (planner.GetOutputPort("servo_command"), servo.GetInputPort("command")),
        (
            planner.GetOutputPort("position_commanded"),
            servo.GetInputPort("position_planned"),
        ),
        (servo.GetOutputPort("status"), planner.GetInputPort("servo_status")),
        (tracker.GetOutputPort("sighting"), servo.GetInputPort("sighting")),
    ):
        builder.Connect(source, target)
    for name, port in input_ports(planner).items():
        if name != "servo_status":
            builder.ExportInput(port, name)
    builder.ConnectInput("arm_state", servo.GetInputPort("arm_state"))
    commanded = servo.GetOutputPort("position_commanded")
    builder.ExportOutput(commanded, "position_commanded")
    builder.ExportOutput(servo.GetOutputPort("status"), "servo_status")
    for name, output in output_ports(planner).items():
        if name not in ("servo_command", "position_commanded"):
            builder.ExportOutput(output, name)
    return builder.Build()


def ConnectHandCamera(
    builder: DiagramBuilder, station: Diagram, planner: System
) -> None:
    """Connect the images of a station to those inputs that a planner has for them."""
    for name, port in output_ports(station).items():
        target = name.removeprefix("camera_")
        if target != name and planner.HasInputPort(target):
            builder.Connect(port, planner.GetInputPort(target))


@dc.dataclass(frozen=True)
class CameraMount:
    """Where the camera's colour imager is in the hand.

    Attributes:
        X_GC: Truly [m].
        X_GC_believed: As calibrated [m].
        model: The camera's intrinsics, as calibrated.
    """

    X_GC: RigidTransform
    X_GC_believed: RigidTransform
    model: CameraModel

    @classmethod
    def of(cls, scenario: Scenario, plant: MultibodyPlant) -> CameraMount:
        """Return the mount of the servo's camera.

        Args:
            scenario: With `servoing`.
            plant: Of the scenario's models.

        Raises:
            ScenarioError: If the camera is not fixed to the hand.
        """
        assert scenario.servoing is not None
        name = scenario.servoing.camera
        config = scenario.cameras[name]
        palm = plant.GetBodyByName("palm", plant.GetModelInstanceByName("gripper"))
        base = config.X_PB.base_frame or "world"
        frame = GetScopedFrameByName(plant, base)
        if frame.body().index() not in {
            body.index() for body in plant.GetBodiesWeldedTo(palm)
        }:
            raise ScenarioError(
                f"cameras.{name}.X_PB.base_frame: must be fixed to the hand for "
                f"servoing, got {base} (allowed: gripper::palm)"
            )
        context = plant.CreateDefaultContext()
        X_GP = frame.CalcPose(context, palm.body_frame())
        calibration = scenario.camera_calibrations.get(name)
        model = calibrated_model(config, calibration)
        X_GB = X_GP @ config.X_PB.GetDeterministicValue()
        believed = X_GB
        if calibration is not None:
            believed = X_GP @ calibration.X_PB.GetDeterministicValue()
        elif name in scenario.camera_errors:
            believed = X_GB @ X_BE_believed(scenario.camera_errors[name])
        return cls(X_GB @ model.X_BC, believed @ model.X_BC, model)


def _AddServo(
    builder: DiagramBuilder,
    scenario: Scenario,
    config: ServoingConfig,
    mount: CameraMount,
    plant: MultibodyPlant,
) -> tuple[VisualServo, System]:
    """Add servo and tracker; export what the tracker needs of the camera."""
    name, arm = scenario.task.pick, ServoArm(plant)
    grasp = _grasp(scenario, plant)
    shown = config.goal == "shown"
    X_GC = mount.X_GC if shown else mount.X_GC_believed
    X_CO_goal = X_GC.inverse() @ grasp.X_GO
    (target,) = (t for t in blob_targets(scenario) if t.name == name)
    servo: VisualServo
    tracker: System
    if config.method == "ibvs":
        goal = _silhouette_at(scenario, mount, target, grasp, X_CO_goal)
        servo = ImageBasedServo(arm, mount.X_GC_believed, _AHEAD, goal, config)
        tracker = SilhouetteTracker(target.color, mount.model)
    else:
        servo = PositionBasedServo(arm, mount.X_GC_believed, _AHEAD, X_CO_goal, config)
        tracker = SurfaceTracker(
            target.shape,
            np.array(target.p_OC),
            target.color,
            X_CO_goal.rotation(),
            mount.model,
        )
    builder.AddNamedSystem("tracker", tracker)
    for port in _IMAGES:
        builder.ExportInput(tracker.GetInputPort(port), f"{config.camera}.{port}")
    return builder.AddNamedSystem("servo", servo), tracker


def _grasp(scenario: Scenario, plant: MultibodyPlant) -> Grasp:
    """Return the one way in which the hand may take the object."""
    name = scenario.task.pick
    shape = object_shape(name, scenario.objects[name])
    grasps = MakeHand(scenario, plant).grasps(shape, _UP)
    if len(grasps) != 1:
        found = ", ".join(grasp.name for grasp in grasps) or "none"
        raise ScenarioError(
            f"servoing: needs one way to grasp {name}, got {found} "
            "(allowed: planner.approaches: [above])"
        )
    return grasps[0]


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


def _silhouette_at(
    scenario: Scenario,
    mount: CameraMount,
    target: BlobTarget,
    grasp: Grasp,
    X_CO: RigidTransform,
) -> FeatureSighting:
    """Return what the tracker finds in an image of the object at a pose."""
    assert scenario.servoing is not None
    thing = scenario.objects[target.name]
    return _rendered(
        _Shown(
            Models.of(scenario),
            yaml_dump_typed(scenario.cameras[scenario.servoing.camera]),
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
    assert scenario.servoing is not None
    camera = scenario.servoing.camera
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
    for port in _IMAGES:
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
            f"servoing.camera: {camera} does not see all of {name} in the hand"
        )
    return seen
