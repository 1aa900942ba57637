"""The station: what the hardware would offer, with every input exported."""

from __future__ import annotations

from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.arm.drivers import AddArmPositionDriver
from drake_srg.arm.external_torque import AddExternalTorque
from drake_srg.common.errors import scenario_errors
from drake_srg.common.ports import Ports
from drake_srg.gripper.drivers import AddGripperDriver
from drake_srg.objects.models import object_body
from drake_srg.objects.poses import ObjectPoses
from drake_srg.scenario import Scenario
from drake_srg.station.cameras import AddCameras
from drake_srg.station.plant import MakeModelsPlant, MakePlant

# Those of them that the driver has become the station's.
_GRIPPER_INPUTS = (
    *("closure_commanded", "joint_position_commanded", "hold", "force_limit"),
    *("motor_position_commanded", "motor_torque_commanded"),
)
_GRIPPER_OUTPUTS = (
    *("state_measured", "pwm", "proximity", "contact_force", "contact_wrench"),
    *("grasped", "motor_state", "wire_force", "motor_temperature"),
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
        - gripper.motor_position_commanded (optional; SrgTendonDriver)
        - gripper.motor_torque_commanded (optional; SrgTendonDriver)
        - object_forces_cheat (optional)
        output_ports:
        - arm.state_measured
        - arm.torque_measured
        - arm.external_torque (with planner.max_external_torque)
        - gripper.state_measured
        - gripper.pwm
        - gripper.proximity
        - gripper.contact_force
        - gripper.contact_wrench
        - gripper.grasped
        - gripper.motor_state (SrgTendonDriver)
        - gripper.wire_force (SrgTendonDriver)
        - gripper.motor_temperature (SrgTendonDriver)
        - camera_NAME.color_image
        - camera_NAME.depth_image
        - camera_NAME.body_pose_in_world
        - arm.state_cheat
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
        driver = AddGripperDriver(
            builder, plant, gripper, scenario.gripper, scenario.random_seed
        )
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
        models_plant = MakeModelsPlant(scenario)
        driver = AddArmPositionDriver(
            builder,
            plant,
            arm,
            gripper,
            models_plant,
            scenario.arm,
            scenario.random_seed,
        )
        ports.inputs["arm.position_commanded"] = driver.GetInputPort(
            "position_commanded"
        )
        ports.outputs["arm.state_measured"] = driver.GetOutputPort("state_measured")
        ports.outputs["arm.state_cheat"] = plant.get_state_output_port(arm)
        ports.outputs["arm.torque_measured"] = plant.get_net_actuation_output_port(arm)
        if scenario.planner.max_external_torque is not None:
            # A continuous plant has to find its contacts anew for every sample: it does
            # as often as the planner and sensors of touch ask for them anyway.
            period = (scenario.arm if plant.time_step() else scenario.planner).period
            ports.outputs["arm.external_torque"] = AddExternalTorque(
                builder,
                plant,
                arm,
                gripper,
                models_plant,
                period,
                scenario.arm.errors,
                scenario.random_seed,
            )

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
    if builder.HasSubsystemNamed("contact_torques"):
        # An arm feels what pulls at what it holds.
        contact_torques = builder.GetSubsystemByName("contact_torques")
        ports.followers["object_forces_cheat"] = contact_torques.GetInputPort(
            "applied_forces"
        )
    ports.outputs["object_poses_cheat"] = poses.get_output_port()
    ports.outputs["contact_results_cheat"] = plant.get_contact_results_output_port()
    return ports
