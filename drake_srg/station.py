"""The station: what the hardware would offer, with every input exported."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometrySet,
    Role,
    SceneGraph,
)
from pydrake.lcm import DrakeLcm
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    GetScopedFrameByName,
    ModelDirective,
    ModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.rendering import MultibodyPositionToGeometryPose
from pydrake.systems.sensors import ApplyCameraConfig

from drake_srg.arm.drivers import AddArmPositionDriver, SetArmGains
from drake_srg.errors import ScenarioError, one_line, scenario_errors
from drake_srg.gripper.drivers import (
    AddGripperDriver,
    SetTendonDynamics,
    SrgTendonDriver,
)
from drake_srg.ground_truth import ObjectPoses
from drake_srg.objects import (
    AddObject,
    SetDefaultObjectPose,
    X_FO_start,
    known_shape,
    object_body,
)
from drake_srg.parsing import ConfigureParser
from drake_srg.ports import Ports
from drake_srg.preflight import check_constraints
from drake_srg.scenario import Scenario

_LID = "package://drake_srg/sdf/lid.sdf"
# Those of them that the driver has become the station's.
_GRIPPER_INPUTS = (
    *("closure_commanded", "joint_position_commanded", "hold", "force_limit"),
)
_GRIPPER_OUTPUTS = (
    *("state_measured", "pwm", "proximity", "contact_force", "contact_wrench"),
    *("grasped", "motor_state", "wire_force"),
)


@scenario_errors()
def MakeStation(scenario: Scenario) -> Diagram:
    """Build the diagram of plant, sensors and drivers of a scenario.

    .. pydrake_system::

        name: Station
        input_ports:
        - arm.position_commanded
        - gripper.closure_commanded
        - gripper.joint_position_commanded (optional; not SrgTendonDriver)
        - gripper.hold (optional)
        - gripper.force_limit (optional)
        - object_forces_cheat (optional)
        output_ports:
        - arm.state_measured
        - arm.torque_measured
        - gripper.state_measured
        - gripper.pwm
        - gripper.proximity
        - gripper.contact_force
        - gripper.contact_wrench
        - gripper.grasped
        - gripper.motor_state (SrgTendonDriver)
        - gripper.wire_force (SrgTendonDriver)
        - camera_NAME.color_image
        - camera_NAME.depth_image
        - camera_NAME.body_pose_in_world
        - object_poses_cheat
        - contact_results_cheat

    Ports of the arm, the gripper and cameras exist where the scenario has these. What
    they carry stands at `AddArmPositionDriver`, `AddSrgPositionDriver`,
    `AddSrgTendonDriver`, `AddLinkageDriver` and Drake's RgbdSensor. The subsystems are
    named `plant`, `scene_graph`, `arm_driver`, `gripper_driver`, `rgbd_sensor_NAME` and
    `object_poses`. Disturbances enter by `object_forces_cheat`
    (list[ExternallyAppliedSpatialForce]).

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    builder = DiagramBuilder()
    AddStation(builder, scenario).Export(builder)
    diagram = builder.Build()
    diagram.set_name("station")
    return diagram


def AddStation(builder: DiagramBuilder, scenario: Scenario) -> Ports:
    """Add what `MakeStation` makes a diagram of to a diagram, and return its ports.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    ports = Ports()
    plant, scene_graph = MakePlant(builder, scenario)

    # Drivers.
    arm = gripper = None
    if scenario.gripper is not None:
        gripper = plant.GetModelInstanceByName("gripper")
        driver = AddGripperDriver(builder, plant, gripper, scenario.gripper)
        builder.Connect(
            scene_graph.get_query_output_port(), driver.GetInputPort("query_object")
        )
        for name in _GRIPPER_INPUTS:
            if driver.HasInputPort(name):
                ports.inputs[f"gripper.{name}"] = driver.GetInputPort(name)
        for name in _GRIPPER_OUTPUTS:
            if driver.HasOutputPort(name):
                ports.outputs[f"gripper.{name}"] = driver.GetOutputPort(name)
    if scenario.arm is not None:
        arm = plant.GetModelInstanceByName("arm")
        control_plant = MultibodyPlant(time_step=0.0)
        AddDirectives(control_plant, scenario)
        control_plant.Finalize()
        driver = AddArmPositionDriver(
            builder, plant, arm, gripper, control_plant, scenario.arm
        )
        ports.inputs["arm.position_commanded"] = driver.GetInputPort(
            "position_commanded"
        )
        ports.outputs["arm.state_measured"] = plant.get_state_output_port(arm)
        ports.outputs["arm.torque_measured"] = plant.get_net_actuation_output_port(arm)

    if scenario.cameras:
        ports.outputs |= AddCameras(builder, plant, scene_graph, scenario)

    # Ground truth.
    poses = builder.AddNamedSystem(
        "object_poses",
        ObjectPoses(
            {
                name: object_body(plant, plant.GetModelInstanceByName(name))
                for name, config in scenario.objects.items()
                if config.present
            }
        ),
    )
    builder.Connect(plant.get_body_poses_output_port(), poses.get_input_port(0))
    if poses.num_input_ports() > 1:
        builder.Connect(
            plant.get_deformable_body_configuration_output_port(),
            poses.get_input_port(1),
        )
    ports.inputs["object_forces_cheat"] = plant.get_applied_spatial_force_input_port()
    ports.outputs["object_poses_cheat"] = poses.get_output_port()
    ports.outputs["contact_results_cheat"] = plant.get_contact_results_output_port()
    return ports


@scenario_errors()
def MakePlant(
    builder: DiagramBuilder, scenario: Scenario
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add the plant with all models of a scenario to a diagram, finalized.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    check_constraints(scenario)
    plant, scene_graph = AddMultibodyPlant(
        plant_config=scenario.plant_config,
        scene_graph_config=scenario.scene_graph_config,
        builder=builder,
    )
    AddDirectives(plant, scenario)
    AddObjects(plant, scenario)
    if scenario.arm is not None:
        arm = plant.GetModelInstanceByName("arm")
        SetArmGains(plant, arm, scenario.arm)
    if isinstance(scenario.gripper, SrgTendonDriver):
        gripper = plant.GetModelInstanceByName("gripper")
        SetTendonDynamics(plant, gripper, scenario.gripper.drive)
    plant.Finalize()
    if scenario.arm is not None:
        plant.SetDefaultPositions(arm, scenario.arm.home)
    IgnoreContacts(scene_graph, scenario.ignored_contacts)
    return plant, scene_graph


def IgnoreContacts(scene_graph: SceneGraph, pairs: Sequence[Sequence[str]]) -> None:
    """Filter the contact between geometry that a scenario names in pairs.

    Raises:
        ScenarioError: If a name fits no collision geometry.
    """
    inspector = scene_graph.model_inspector()
    geometries = inspector.GetAllGeometryIds(Role.kProximity)

    def named(pattern: str) -> GeometrySet:
        found = [g for g in geometries if fnmatchcase(inspector.GetName(g), pattern)]
        if not found:
            raise ScenarioError(
                f"ignored_contacts: {pattern!r} is the name of no collision geometry"
            )
        return GeometrySet(found)

    for first, second in pairs:
        scene_graph.collision_filter_manager().Apply(
            CollisionFilterDeclaration().ExcludeBetween(named(first), named(second))
        )


def AddCameras(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    scenario: Scenario,
) -> dict[str, OutputPort]:
    """Add the cameras of a scenario, and return their ports by name.

    They see a scene graph of their own. In the plant's, the renderers would follow
    every step of the simulation, which costs as much as the bare plant; this one takes
    the plant's state when somebody asks for an image. What is soft is in the plant's
    alone, and costs more than the renderers do: with soft objects, cameras see that.
    """
    if not any(config.soft for config in scenario.objects.values()):
        plant, scene_graph = _AddRenderScene(builder, plant, scenario)
    ports: dict[str, OutputPort] = {}
    for name, camera_config in scenario.cameras.items():
        config = copy.copy(camera_config)
        config.name = name
        ApplyCameraConfig(
            config=config,
            builder=builder,
            plant=plant,
            scene_graph=scene_graph,
            lcm=DrakeLcm("memq://null"),  # stands for no publishing
        )
        sensor = builder.GetSubsystemByName(f"rgbd_sensor_{name}")
        # Not by GetOutputPort: that, of a system that Drake made, keeps its builder
        # alive where the garbage collector cannot see it (Drake 1.51.1).
        for port, exported in (
            (sensor.color_image_output_port(), "color_image"),
            (sensor.depth_image_32F_output_port(), "depth_image"),
            (sensor.body_pose_in_world_output_port(), "body_pose_in_world"),
        ):
            ports[f"camera_{name}.{exported}"] = port
    return ports


def _AddRenderScene(
    builder: DiagramBuilder, plant: MultibodyPlant, scenario: Scenario
) -> tuple[MultibodyPlant, SceneGraph]:
    scene = builder.AddNamedSystem("render_scene_graph", SceneGraph())
    render_plant = MultibodyPlant(time_step=0.0)
    render_plant.RegisterAsSourceForSceneGraph(scene)
    AddDirectives(render_plant, scenario)
    AddObjects(render_plant, scenario)
    render_plant.Finalize()
    poses = builder.AddNamedSystem(
        "render_poses",
        MultibodyPositionToGeometryPose(render_plant, input_multibody_state=True),
    )
    builder.Connect(plant.get_state_output_port(), poses.get_input_port())
    builder.Connect(
        poses.get_output_port(),
        scene.get_source_pose_port(render_plant.get_source_id()),
    )
    return render_plant, scene


def AddDirectives(plant: MultibodyPlant, scenario: Scenario) -> None:
    """Add all models of a scenario but its objects to a plant.

    Raises:
        ScenarioError: If a directive cannot be processed.
    """
    parser = Parser(plant)
    ConfigureParser(parser)
    directives: list[ModelDirective] = scenario.directives
    try:
        ProcessModelDirectives(ModelDirectives(directives=directives), parser)
    except RuntimeError as error:
        reason = " ".join(str(error).split())[:300]
        raise ScenarioError(f"directives: {reason}") from None


def AddObjects(plant: MultibodyPlant, scenario: Scenario) -> None:
    """Add the objects where they are at the start, and the marker of the goal.

    Raises:
        ScenarioError: If an object cannot be made or its base frame is unknown.
    """
    height = scenario.table.height
    for name, config in scenario.objects.items():
        X_WO = X_FO_start(config, known_shape(name, config), height)
        if config.pose is not None and config.pose.base_frame not in (None, "world"):
            X_WO = _X_WF_start(scenario, name, config.pose.base_frame) @ X_WO
        if config.present:
            model = AddObject(plant, name, config)
            SetDefaultObjectPose(plant, model, X_WO)
        if config.covered:
            x, y = X_WO.translation()[:2]
            AddFixture(plant, f"lid_of_{name}", _LID, [x, y, height])
    if scenario.task.place.marker:
        AddFixture(
            plant,
            "goal_marker",
            scenario.task.place.marker,
            [*scenario.task.place.position, height],
        )


def _X_WF_start(scenario: Scenario, name: str, frame: str) -> RigidTransform:
    """Pose in world, at the start, of a frame of a model among the directives."""
    plant = MultibodyPlant(time_step=0.0)
    AddDirectives(plant, scenario)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    if scenario.arm is not None:
        arm = plant.GetModelInstanceByName("arm")
        plant.SetPositions(context, arm, scenario.arm.home)
    try:
        return GetScopedFrameByName(plant, frame).CalcPoseInWorld(context)
    except RuntimeError as error:
        raise ScenarioError(
            f"objects.{name}.pose.base_frame: {one_line(error)}"
        ) from None


def AddFixture(
    plant: MultibodyPlant, name: str, url: str, p_WF: Sequence[float]
) -> None:
    """Weld the model at `url` to the world as instance `name`, its origin at p_WF."""
    parser = Parser(plant)
    ConfigureParser(parser)
    parser.SetAutoRenaming(True)
    (model,) = parser.AddModels(url=url)
    plant.RenameModelInstance(model, name)
    body = plant.get_body(plant.GetBodyIndices(model)[0])
    X_WF = RigidTransform(np.asarray(p_WF))
    plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WF)
