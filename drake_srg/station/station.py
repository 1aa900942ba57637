"""The station: plant, sensors and drivers, with the same ports as the hardware."""

from __future__ import annotations

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem

from drake_srg.arm.driver import AddArmDriver
from drake_srg.arm.external_torque import AddExternalTorque
from drake_srg.arm.safety.config import SafetyConfig
from drake_srg.arm.safety.monitor import AddSafetyMonitor, SafetyMonitor
from drake_srg.common.exceptions import scenario_errors
from drake_srg.common.systems import input_ports, output_ports
from drake_srg.gripper.driver import PLANT_INPUTS
from drake_srg.gripper.drivers import AddGripperDriver
from drake_srg.objects.models import object_body
from drake_srg.objects.poses import ObjectPoses, PeakForce
from drake_srg.objects.slides import AddSlide
from drake_srg.planning.insertion.config import Insert
from drake_srg.scenario.schema import RobotArm, Scenario, robot_arms
from drake_srg.station.cameras import AddCameras
from drake_srg.station.plant import AddPlant, MakeModelsPlant, check_driven
from drake_srg.station.sleeping import AddSleepMonitor

# Ports of a gripper driver that connect to the plant and are not exported.
_INTERNAL = {*PLANT_INPUTS, "actuation", "desired_state"}

# Inputs of the safety monitor that are exported as `safety.NAME`.
_SAFETY_INPUTS = ("estop", "release", "speed_override", "heartbeat")


@scenario_errors()
def MakeStation(scenario: Scenario) -> Diagram:
    """Build the diagram of a scenario's plant, sensors and drivers.

    .. pydrake_system::

        name: Station
        input_ports:
        - arm.position_commanded (with an arm)
        - gripper.closure_commanded (with a gripper)
        - gripper.joint_position_commanded (optional; not SrgTendonDriver)
        - gripper.hold (optional; with a gripper)
        - gripper.force_limit (optional; with a gripper)
        - gripper.closure_messages (with per_message; not SrgTendonDriver)
        - gripper.motor_position_commanded (optional; SrgTendonDriver)
        - gripper.motor_torque_commanded (optional; SrgTendonDriver)
        - safety.estop (optional; with safety)
        - safety.release (optional; with safety)
        - safety.speed_override (optional; with safety)
        - safety.heartbeat (optional; with safety)
        - object_forces_cheat (optional)
        output_ports:
        - arm.state_measured (with an arm)
        - arm.torque_measured (with an arm)
        - arm.external_torque (if planner or safety limits it)
        - arm.position_allowed (with safety)
        - arm.position_held (with safety)
        - safety.state (with safety)
        - safety.speed_scale (with safety)
        - gripper.state_measured (with a gripper)
        - gripper.pwm (with a gripper)
        - gripper.proximity (with a gripper that has these sensors)
        - gripper.contact_force (with a gripper)
        - gripper.contact_wrench (with a gripper)
        - gripper.grasped (with a gripper)
        - gripper.motor_state (SrgTendonDriver)
        - gripper.wire_force (SrgTendonDriver)
        - gripper.motor_temperature (SrgTendonDriver)
        - camera_NAME.color_image (with cameras)
        - camera_NAME.depth_image (with cameras)
        - camera_NAME.body_pose_in_world (with cameras)
        - arm.state_cheat (with an arm)
        - object_poses_cheat
        - contact_results_cheat
        - plant_state_cheat
        - hole_force_cheat (with the planner !Insert)
        - objects_asleep_cheat (with sleeping)

    Ports of the arm, the gripper and the cameras exist only if the scenario has them.
    With `arms`, the ports of the arm NAME begin with `NAME.` in place of `arm.`,
    `NAME.gripper.` in place of `gripper.`, and `NAME.safety.` in place of `safety.`.
    For the ports' values, see `AddArmDriver`, `SrgPositionDriver`, `SrgTendonDriver`,
    `LinkageDriver` and Drake's RgbdSensor. A gripper driver or finger sensor of your
    own adds its ports as `gripper.NAME`. Disturbances enter through
    `object_forces_cheat` (list[ExternallyAppliedSpatialForce]). With `safety`, a
    `SafetyMonitor` is between `arm.position_commanded` and the arm's driver, which gets
    `arm.position_allowed`.

    The subsystems are named `plant`, `scene_graph`, `arm_driver`, `gripper_driver`
    (with `arms`, `NAME_arm_driver` and so on), `rgbd_sensor_NAME`, `object_poses`, with
    slides `slide_NAME`, with safety `safety_monitor` and, with sleeping,
    `sleep_monitor`. Objects sleep only if the caller advances with
    `station.sleeping.MakeAdvance`, like `Simulate`, `Rig` and `Serve`.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    builder = DiagramBuilder()
    AddStation(builder, scenario)
    diagram = builder.Build()
    diagram.set_name("station")
    return diagram


def AddStation(builder: DiagramBuilder, scenario: Scenario) -> None:
    """Add the systems of `MakeStation` to a diagram and export their ports.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    plant, scene_graph = AddPlant(builder, scenario)
    check_driven(plant, scenario)
    for name, slide in scenario.slides.items():
        AddSlide(builder, plant, name, slide)
    robots = robot_arms(scenario)
    for robot in robots:
        with robot.named_errors():
            gripper = None
            if robot.gripper is not None:
                gripper = _AddGripper(builder, plant, scene_graph, scenario, robot)
            if robot.arm is not None:
                _AddArm(builder, plant, gripper, scenario, robot)
    for name, output in AddCameras(builder, plant, scene_graph, scenario).items():
        builder.ExportOutput(output, name)
    poses = _AddObjectPoses(builder, plant, scenario)
    builder.ExportOutput(poses.get_output_port(), "object_poses_cheat")
    builder.ExportOutput(
        plant.get_contact_results_output_port(), "contact_results_cheat"
    )
    builder.ExportOutput(plant.get_state_output_port(), "plant_state_cheat")
    if isinstance(scenario.planner, Insert):
        _AddHoleForce(builder, plant, scenario, scenario.planner)
    forces = plant.get_applied_spatial_force_input_port()
    builder.ExportInput(forces, "object_forces_cheat")
    if scenario.sleeping is not None:
        AddSleepMonitor(builder, plant, scene_graph, scenario, scenario.sleeping)
    for robot in robots:
        name = robot.system("contact_torques")
        if builder.HasSubsystemNamed(name):
            # The arm also feels forces on the object that it holds.
            contact_torques = builder.GetSubsystemByName(name)
            builder.ConnectInput(
                "object_forces_cheat", contact_torques.GetInputPort("applied_forces")
            )


def _AddGripper(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    scenario: Scenario,
    robot: RobotArm,
) -> ModelInstanceIndex:
    """Add the driver of an arm's gripper, and return the gripper's model instance."""
    assert robot.gripper is not None
    gripper = plant.GetModelInstanceByName(robot.gripper_model)
    driver = AddGripperDriver(
        builder,
        plant,
        gripper,
        robot.gripper,
        robot.seed(scenario.random_seed),
        name=robot.system("gripper_driver"),
        scene_graph=scene_graph,
    )
    for name, port in input_ports(driver).items():
        if name not in _INTERNAL:
            builder.ExportInput(port, f"{robot.gripper_model}.{name}")
    for name, output in output_ports(driver).items():
        if name not in _INTERNAL:
            builder.ExportOutput(output, f"{robot.gripper_model}.{name}")
    return gripper


def _AddHoleForce(
    builder: DiagramBuilder, plant: MultibodyPlant, scenario: Scenario, config: Insert
) -> None:
    """Add the system that measures the force between peg and hole, for metrics."""
    names = scenario.task.pick, config.hole
    if not all(map(plant.HasModelInstanceNamed, names)):
        return
    # With CENIC, a power of two; see `drake_srg.scenario.checks`.
    period = plant.time_step() or 1.0 / 256.0
    force = builder.AddNamedSystem("hole_force", PeakForce(plant, names, period))
    builder.Connect(plant.get_contact_results_output_port(), force.get_input_port())
    builder.ExportOutput(force.get_output_port(), "hole_force_cheat")


def _AddArm(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex | None,
    scenario: Scenario,
    robot: RobotArm,
) -> None:
    """Add an arm's driver and, if the planner needs it, the torque estimator."""
    assert robot.arm is not None
    config, prefix = robot.arm, robot.arm_model
    arm = plant.GetModelInstanceByName(prefix)
    models_plant = MakeModelsPlant(scenario)
    seed = robot.seed(scenario.random_seed)
    driver = AddArmDriver(
        builder,
        plant,
        arm,
        gripper,
        models_plant,
        config,
        seed,
        name=robot.system("arm_driver"),
    )
    monitor = None
    if robot.safety is None:
        builder.ExportInput(
            driver.GetInputPort("position_commanded"), f"{prefix}.position_commanded"
        )
    else:
        monitor = _AddSafety(builder, driver, models_plant, robot, robot.safety)
    for name, output in (
        ("state_measured", driver.GetOutputPort("state_measured")),
        ("state_cheat", plant.get_state_output_port(arm)),
        ("torque_measured", plant.get_net_actuation_output_port(arm)),
    ):
        builder.ExportOutput(output, f"{prefix}.{name}")
    safety_feels = robot.safety is not None and robot.safety.feels
    if not scenario.planner.feels and not safety_feels:
        return
    # A continuous plant computes its contacts anew for every sample. It already does
    # this whenever the planner or a touch sensor reads its input, so use their period.
    period = (config if plant.time_step() else scenario.planner).period
    torque = AddExternalTorque(
        builder,
        plant,
        arm,
        gripper,
        models_plant,
        period,
        config.errors,
        seed,
        prefix=robot.system(""),
    )
    builder.ExportOutput(torque, f"{prefix}.external_torque")
    if monitor is not None:
        builder.Connect(torque, monitor.GetInputPort("external_torque"))


def _AddSafety(
    builder: DiagramBuilder,
    driver: Diagram,
    models_plant: MultibodyPlant,
    robot: RobotArm,
    safety: SafetyConfig,
) -> SafetyMonitor:
    """Add the safety monitor between the commands and the arm's driver."""
    config, prefix = robot.arm, robot.arm_model
    assert config is not None
    monitor = AddSafetyMonitor(
        builder,
        models_plant,
        config.home,
        safety,
        config.period,
        arm=prefix,
        name=robot.system("safety_monitor"),
    )
    allowed = monitor.GetOutputPort("position_allowed")
    builder.Connect(allowed, driver.GetInputPort("position_commanded"))
    builder.Connect(
        driver.GetOutputPort("state_measured"), monitor.GetInputPort("state_measured")
    )
    builder.ExportInput(
        monitor.GetInputPort("position_commanded"), f"{prefix}.position_commanded"
    )
    builder.ExportOutput(allowed, f"{prefix}.position_allowed")
    for name in _SAFETY_INPUTS:
        port = monitor.GetInputPort(name)
        builder.ExportInput(port, f"{robot.prefix}safety.{name}")
    held = monitor.GetOutputPort("position_held")
    builder.ExportOutput(held, f"{prefix}.position_held")
    for name in ("state", "speed_scale"):
        output = monitor.GetOutputPort(name)
        builder.ExportOutput(output, f"{robot.prefix}safety.{name}")
    return monitor


def _AddObjectPoses(
    builder: DiagramBuilder, plant: MultibodyPlant, scenario: Scenario
) -> LeafSystem:
    """Add the system that outputs the true poses of the objects."""
    bodies = {
        name: object_body(plant, plant.GetModelInstanceByName(name))
        for name, config in scenario.objects.items()
        if config.present
    }
    poses = builder.AddNamedSystem("object_poses", ObjectPoses(bodies))
    builder.Connect(plant.get_body_poses_output_port(), poses.get_input_port(0))
    if poses.num_input_ports() > 1:
        builder.Connect(
            plant.get_deformable_body_configuration_output_port(),
            poses.get_input_port(1),
        )
    return poses
