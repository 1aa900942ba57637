"""The planner of a scenario with a visual servo, and the servo's camera."""

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

from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.systems import input_ports, output_ports
from drake_srg.objects.models import object_shape
from drake_srg.planning.grasps.grasps import Grasp
from drake_srg.planning.servoing.config import ServoConfig, Servoing
from drake_srg.planning.servoing.hand_motion import ServoArm
from drake_srg.planning.servoing.planner import ServoingPlanner
from drake_srg.planning.servoing.tracker import (
    FeatureSighting,
    PoseSighting,
    SilhouetteTracker,
    SurfaceTracker,
    Tracker,
)
from drake_srg.planning.servoing.visual_servo import (
    ImageBasedServo,
    PositionBasedServo,
    VisualServo,
)
from drake_srg.scenario import Scenario, servo_of
from drake_srg.station.perception import blob_targets
from drake_srg.station.planners import MakeHand, MakeTaskPlanner, pick_task
from drake_srg.station.plant import MakeModelsPlant, Models
from drake_srg.station.station import MakeStation
from drake_srg.vision.blob_localizer import BlobTarget
from drake_srg.vision.camera import CameraModel, calibrated_model
from drake_srg.vision.camera_errors import X_BE_believed


@dc.dataclass(frozen=True)
class CameraMount:
    """Mounting of the servo's camera in the hand, and its intrinsics.

    Attributes:
        X_GC: True pose of the colour imager [m].
        X_GC_believed: Calibrated pose of the colour imager [m].
        model: The camera's calibrated intrinsics.
    """

    X_GC: RigidTransform
    X_GC_believed: RigidTransform
    model: CameraModel

    @classmethod
    def of(cls, scenario: Scenario, plant: MultibodyPlant) -> CameraMount:
        """Return the mount of the servo's camera.

        Args:
            scenario: A scenario with a visual servo.
            plant: Plant of the scenario's models.

        Raises:
            ScenarioError: If the camera is not fixed to the hand.
        """
        servo = servo_of(scenario)
        assert servo is not None
        name = servo.camera
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
    """Return the tracker's result for an image of the object at a pose."""
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


_AHEAD = np.array([1.0, 0.0, 0.0])  # direction of the fingers, in the palm's frame


def MakeServoingPlanner(scenario: Scenario) -> Diagram:
    """Make the planner and the servo of a scenario with a visual servo.

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
    `SilhouetteTracker` (ibvs). `position_commanded` comes from the servo.

    Raises:
        ScenarioError: If the planner's hand does not know exactly one grasp of the
            object, or if the camera is not fixed to the hand.
    """
    config = servo_of(scenario)
    assert config is not None
    builder = DiagramBuilder()
    planner = builder.AddNamedSystem("planner", MakeServoTaskPlanner(scenario))
    tracker = builder.AddNamedSystem("tracker", MakeTracker(scenario))
    servo = builder.AddNamedSystem("servo", MakeServo(scenario))
    for name, port in input_ports(tracker).items():
        builder.ExportInput(port, f"{config.camera}.{name}")
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


def MakeServoTaskPlanner(scenario: Scenario) -> ServoingPlanner:
    """Make the planner of a scenario with a visual servo, but not the servo."""
    config = scenario.planner
    assert isinstance(config, Servoing)
    return ServoingPlanner(MakeTaskPlanner(scenario), pick_task(scenario), config)


def ConnectHandCamera(
    builder: DiagramBuilder, station: Diagram, planner: System
) -> None:
    """Connect a station's images to the planner's inputs of the same names."""
    for name, port in output_ports(station).items():
        target = name.removeprefix("camera_")
        if target != name and planner.HasInputPort(target):
            builder.Connect(port, planner.GetInputPort(target))


@dc.dataclass(frozen=True)
class _Goal:
    """The goal of a servo: the object between the fingers."""

    plant: MultibodyPlant  # of the scenario's models
    mount: CameraMount
    grasp: Grasp
    target: BlobTarget
    X_CO: RigidTransform  # the object in the camera, by the servo's calibration

    @classmethod
    def of(cls, scenario: Scenario) -> _Goal:
        servo = servo_of(scenario)
        assert servo is not None
        plant = MakeModelsPlant(scenario)
        mount, grasp = CameraMount.of(scenario, plant), _grasp(scenario, plant)
        shown = servo.goal == "shown"
        X_GC = mount.X_GC if shown else mount.X_GC_believed
        name = scenario.task.pick
        (target,) = (t for t in blob_targets(scenario) if t.name == name)
        return cls(plant, mount, grasp, target, X_GC.inverse() @ grasp.X_GO)


def MakeServo(scenario: Scenario, config: ServoConfig | None = None) -> VisualServo:
    """Make the visual servo of a scenario with a visual servo.

    Args:
        scenario: The scenario.
        config: Gains and limits; None: the scenario's.

    Raises:
        ScenarioError: As `MakeServoingPlanner` does.
    """
    servo = servo_of(scenario)
    assert servo is not None
    config, goal = config or servo, _Goal.of(scenario)
    mount, arm = goal.mount, ServoArm(goal.plant)
    if servo.method == "ibvs":
        shown = silhouette_at(scenario, mount, goal.target, goal.grasp, goal.X_CO)
        return ImageBasedServo(arm, mount.X_GC_believed, _AHEAD, shown, config)
    seen = PoseSighting(X_CO=goal.X_CO)
    return PositionBasedServo(arm, mount.X_GC_believed, _AHEAD, seen, config)


def MakeTracker(scenario: Scenario) -> Tracker:
    """Make the tracker of the object for the servo of a scenario with a visual servo.

    Raises:
        ScenarioError: As `MakeServoingPlanner` does.
    """
    servo = servo_of(scenario)
    assert servo is not None
    goal = _Goal.of(scenario)
    target, model = goal.target, goal.mount.model
    if servo.method == "ibvs":
        return SilhouetteTracker(target.color, model)
    return SurfaceTracker(
        target.shape,
        np.array(target.p_OC),
        target.color,
        goal.X_CO.rotation(),
        model,
    )


def _grasp(scenario: Scenario, plant: MultibodyPlant) -> Grasp:
    """Return the one grasp of the object that the hand knows."""
    name = scenario.task.pick
    shape = object_shape(name, scenario.objects[name])
    grasps = MakeHand(scenario, plant).grasps(shape, RigidTransform())
    if len(grasps) != 1:
        found = ", ".join(grasp.name for grasp in grasps) or "none"
        raise ScenarioError(
            f"planner: needs one way to grasp {name}, got {found} "
            "(allowed: planner.approaches: [above])"
        )
    return grasps[0]
