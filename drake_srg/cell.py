"""The cell: a station with localizer and planner, the autonomous system."""

import copy
import functools

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from drake_srg.arm.drivers import AddJerkLimits
from drake_srg.disturbances import Disturber, Target
from drake_srg.errors import ScenarioError, scenario_errors
from drake_srg.goals import goal_pose
from drake_srg.gripper.drivers import LinkageDriver
from drake_srg.objects import known_shape, object_body, object_shape, simple_shape
from drake_srg.perception import AddLocalizer, AddObstacleFinder
from drake_srg.planning.grasps import Hand
from drake_srg.planning.linkage_hand import LinkageHand
from drake_srg.planning.pick_and_place import PickAndPlacePlanner
from drake_srg.planning.planning_scene import PlanningScene
from drake_srg.planning.scripted import ScriptedPlanner
from drake_srg.planning.srg_hand import SrgHand
from drake_srg.planning.task_motions import TaskPlanner
from drake_srg.plant import Models
from drake_srg.ports import Ports, input_ports, output_ports
from drake_srg.scenario import Scenario, is_continuous
from drake_srg.station import AddStation, MakeStation
from drake_srg.types import Vector

# What a planner commands, and what that is called at the station.
_COMMANDS = (
    ("position_commanded", "arm.position_commanded"),
    ("closure_commanded", "gripper.closure_commanded"),
)


@scenario_errors()
def MakeCell(scenario: Scenario) -> Diagram:
    """Build the diagram of a station whose task a localizer and a planner do.

    .. pydrake_system::

        name: Cell
        output_ports:
        - (all of the station's)
        - localizer.blobs
        - planner.mode
        - planner.status
        - arm.position_commanded
        - gripper.closure_commanded

    The subsystems are named `station`, `localizer`, `planner` and, where the scenario
    has disturbances, `disturber`. To replace one, build the diagram with your own in
    its place: this function is short for that reason.

    Where the scenario has a `script`, the planner plays it, and there is no localizer.
    Where its plant is continuous, what is in the station is in the cell itself.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    builder = DiagramBuilder()
    AddCell(builder, scenario).Export(builder)
    diagram = builder.Build()
    diagram.set_name("cell")
    return diagram


def AddCell(builder: DiagramBuilder, scenario: Scenario) -> Ports:
    """Add what `MakeCell` makes a diagram of to a diagram, and return its ports.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    needed = {
        "arm": scenario.arm,
        "gripper": scenario.gripper,
        "task.pick": scenario.task.pick,
        "localizer.cameras (or script)": scenario.localizer.cameras or scenario.script,
    }
    missing = [key for key, value in needed.items() if not value]
    if missing:
        raise ScenarioError(f"a cell also needs {', '.join(missing)}")
    station: Diagram | Ports
    if is_continuous(scenario):
        # Drake's CENIC integrator looks for the plant among the root's own subsystems.
        station = AddStation(builder, scenario)
    else:
        station = builder.AddNamedSystem("station", MakeStation(scenario))
    ports = Ports()
    planner: System
    if scenario.script:
        planner = builder.AddNamedSystem("planner", MakeScriptedPlanner(scenario))
        ConnectCommands(builder, station, planner)
        if any(step.force_limit is not None for step in scenario.script):
            builder.Connect(
                planner.GetOutputPort("force_limit"),
                station.GetInputPort("gripper.force_limit"),
            )
    else:
        localizer = AddLocalizer(builder, scenario, station)
        planner = builder.AddNamedSystem("planner", MakePlanner(scenario))
        ConnectPlanner(builder, station, localizer, planner)
        if scenario.localizer.obstacles:
            finder = AddObstacleFinder(builder, scenario, station, localizer)
            builder.Connect(finder.get_output_port(), planner.GetInputPort("obstacles"))
        ports.outputs["localizer.blobs"] = localizer.GetOutputPort("blobs")
    AddDisturber(builder, scenario, station, planner)
    ports.outputs |= output_ports(station)
    for name, exported in (
        ("mode", "planner.mode"),
        ("status", "planner.status"),
        *_COMMANDS,
    ):
        ports.outputs[exported] = planner.GetOutputPort(name)
    return ports


def AddDisturber(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Diagram | Ports,
    planner: System,
) -> None:
    """Add what lets a scenario's disturbances happen, where it has any.

    It is connected to the station and to the planner's `mode`.
    """
    plant = (builder if isinstance(station, Ports) else station).GetSubsystemByName(
        "plant"
    )
    disturbances = []
    for disturbance in scenario.disturbances:
        name = disturbance.object or scenario.task.pick
        config = scenario.objects[name]
        if config.present:
            body = object_body(plant, plant.GetModelInstanceByName(name))
            # A copy: the plant's own would keep its diagram alive.
            inertia = copy.copy(plant.get_body(body).default_spatial_inertia())
            target = Target(name, body, inertia, simple_shape(name, config))
            disturbances.append((disturbance, target))
    if not disturbances:
        return
    # With CENIC, a power of two: see `scenario_checks`.
    period = scenario.plant_config.time_step or 1.0 / 256.0
    disturber = builder.AddNamedSystem("disturber", Disturber(disturbances, period))
    builder.Connect(planner.GetOutputPort("mode"), disturber.GetInputPort("mode"))
    builder.Connect(
        station.GetOutputPort("object_poses_cheat"),
        disturber.GetInputPort("object_poses"),
    )
    for port in input_ports(station, "object_forces_cheat"):
        builder.Connect(disturber.GetOutputPort("object_forces"), port)


def MakePlanner(scenario: Scenario) -> PickAndPlacePlanner:
    """Make the planner of a scenario's task."""
    name, place = scenario.task.pick, scenario.task.place
    shape = object_shape(name, scenario.objects[name])
    return PickAndPlacePlanner(
        MakeTaskPlanner(scenario),
        name,
        shape,
        goal_pose(scenario, shape),
        place.tolerance,
        obstacles={
            other: known
            for other, config in scenario.objects.items()
            if other != name and (known := known_shape(other, config)) is not None
        },
        repeat=scenario.task.repeat,
        config=scenario.planner,
    )


def MakeScriptedPlanner(scenario: Scenario) -> System:
    """Make what plays a scenario's script: a `ScriptedPlanner`, or one in a diagram.

    Where the scenario has `messages`, `arm_reference` in that diagram makes motion of
    the arm's targets.
    """
    assert scenario.arm is not None
    home = np.array(scenario.arm.home)
    if scenario.messages is None:
        return ScriptedPlanner(home, scenario.script)
    builder = DiagramBuilder()
    messages = builder.AddNamedSystem(
        "messages", ScriptedPlanner(home, scenario.script, jumps=True)
    )
    reference = AddJerkLimits(builder, scenario.arm)
    position = "position_commanded"
    builder.Connect(messages.GetOutputPort(position), reference.get_input_port())
    builder.ExportOutput(reference.get_output_port(), position)
    for name, port in output_ports(messages).items():
        if name != position:
            builder.ExportOutput(port, name)
    return builder.Build()


def MakeTaskPlanner(scenario: Scenario) -> TaskPlanner:
    """Make what plans the motions, with a model of its own of arm and furniture."""
    config = scenario.planner
    scene = _planning_scene(
        Models.of(scenario), config.clearance, config.hand_clearance, config.payload
    ).copy()
    assert scenario.arm is not None
    hand = MakeHand(scenario, scene.plant)
    return TaskPlanner(scene, hand, np.array(scenario.arm.home), config)


@functools.lru_cache(maxsize=2)
def _planning_scene(
    models: Models, margin: float, hand_margin: float, payload: float
) -> PlanningScene:
    """The planner's model; only copies of it are used."""
    builder = RobotDiagramBuilder(time_step=0.0)
    models.add_to(builder.plant())
    return PlanningScene(
        builder, margin=margin, hand_margin=hand_margin, payload=payload
    )


def MakeHand(scenario: Scenario, plant: MultibodyPlant) -> Hand:
    """Make what the planner knows of a scenario's gripper, a model of `plant`."""
    config = scenario.planner
    if not isinstance(scenario.gripper, LinkageDriver):
        return SrgHand(config.approaches, config.tilts, config.squeeze)
    gripper = plant.GetModelInstanceByName("gripper")

    def p_GF(name: str) -> Vector:
        frame = plant.GetFrameByName(name, gripper)
        X_GF = frame.GetFixedPoseInBodyFrame()
        return np.array(X_GF.translation())  # the plant may not live on

    def measured(name: str, otherwise: Vector) -> Vector:  # by calibration
        return p_GF(name) if plant.HasFrameNamed(name, gripper) else otherwise

    p_GT = measured("tip", p_GF("grasp_center"))
    return LinkageHand(
        p_GT,
        measured("released", p_GT) - p_GT,
        scenario.gripper.master_slave.full_scale,
    )


def ConnectPlanner(
    builder: DiagramBuilder,
    station: Diagram | Ports,
    localizer: System,
    planner: System,
) -> None:
    """Connect a planner with our ports to a station and a localizer."""
    builder.Connect(localizer.GetOutputPort("blobs"), planner.GetInputPort("blobs"))
    for source, target in (
        ("arm.state_measured", "arm_state"),
        ("gripper.state_measured", "gripper_state"),
        ("gripper.grasped", "grasped"),
        ("gripper.proximity", "proximity"),
    ):
        builder.Connect(station.GetOutputPort(source), planner.GetInputPort(target))
    if "arm.external_torque" in output_ports(station):
        builder.Connect(
            station.GetOutputPort("arm.external_torque"),
            planner.GetInputPort("external_torque"),
        )
    ConnectCommands(builder, station, planner)


def ConnectCommands(
    builder: DiagramBuilder, station: Diagram | Ports, planner: System
) -> None:
    """Connect what a planner commands to a station."""
    for source, target in _COMMANDS:
        builder.Connect(planner.GetOutputPort(source), station.GetInputPort(target))
