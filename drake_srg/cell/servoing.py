"""The planner of a scenario with a visual servo, and the goal of that servo."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from drake_srg.cell.camera_mount import CameraMount
from drake_srg.cell.hands import MakeHand
from drake_srg.cell.perception import blob_targets
from drake_srg.cell.planners import planner_arguments
from drake_srg.cell.shown_goal import silhouette_at
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.ports import input_ports, output_ports
from drake_srg.objects.models import object_shape
from drake_srg.planning.grasps.grasps import Grasp
from drake_srg.scenario import Scenario, servo_of
from drake_srg.servoing.arm import ServoArm
from drake_srg.servoing.config import ServoConfig
from drake_srg.servoing.image_based import ImageBasedServo
from drake_srg.servoing.position_based import PositionBasedServo
from drake_srg.servoing.servoing_planner import ServoingPlanner
from drake_srg.servoing.silhouette_tracker import SilhouetteTracker
from drake_srg.servoing.surface_tracker import SurfaceTracker
from drake_srg.servoing.tracker import Tracker
from drake_srg.servoing.visual_servo import VisualServo
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.vision.blob_localizer import BlobTarget

_AHEAD = np.array([1.0, 0.0, 0.0])  # of the palm: where the fingers point


def MakeServoingPlanner(scenario: Scenario) -> Diagram:
    """Make the planner of a scenario with a visual servo, together with its servo.

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
    """Make the planner of a scenario with a visual servo, whose servo is elsewhere."""
    servo = servo_of(scenario)
    assert servo is not None
    limit = servo.time_limit
    return ServoingPlanner(**planner_arguments(scenario), time_limit=limit)


def ConnectHandCamera(
    builder: DiagramBuilder, station: Diagram, planner: System
) -> None:
    """Connect the images of a station to those inputs that a planner has for them."""
    for name, port in output_ports(station).items():
        target = name.removeprefix("camera_")
        if target != name and planner.HasInputPort(target):
            builder.Connect(port, planner.GetInputPort(target))


@dc.dataclass(frozen=True)
class _Goal:
    """The object in the hand that has reached it."""

    plant: MultibodyPlant  # of the scenario's models
    mount: CameraMount
    grasp: Grasp
    target: BlobTarget
    X_CO: RigidTransform  # in the camera, as far as the servo knows

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
    return PositionBasedServo(arm, mount.X_GC_believed, _AHEAD, goal.X_CO, config)


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
    """Return the one way in which the hand may take the object."""
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
