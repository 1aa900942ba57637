"""The cell: a station with localizer and planner, working on its own."""

import copy
import functools
import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from drake_srg.common.exceptions import ScenarioError, one_line, scenario_errors
from drake_srg.common.systems import export_outputs, input_ports
from drake_srg.objects.disturber import Disturber, Target
from drake_srg.objects.models import object_body, simple_shape
from drake_srg.planning.carrying.config import CarryTogether
from drake_srg.planning.handover.config import Handover
from drake_srg.planning.insertion.config import Insert
from drake_srg.planning.planner_machine import (
    Clear,
    PickAndPlace,
    PlannerConfig,
)
from drake_srg.planning.servoing.config import Servoing
from drake_srg.scenario.schema import (
    RobotArm,
    Scenario,
    accept_planner,
    check_single_arm,
    robot_arms,
    script_of,
)
from drake_srg.station.clearing import (
    MakeClearingPair,
    MakeClearingPlanner,
    shares_of,
)
from drake_srg.station.perception import (
    AddDestinationMapper,
    AddHeightMapper,
    AddLocalizer,
    AddObstacleFinder,
    AddThingLabeler,
    needs_labels,
)
from drake_srg.station.planners import (
    MakeCarryPlanner,
    MakeHandoverPlanner,
    MakeInsertionPlanner,
    MakePlanner,
    MakeScriptedPlanner,
    MakeTaughtPlanner,
)
from drake_srg.station.servoing import ConnectHandCamera, MakeServoingPlanner
from drake_srg.station.station import MakeStation
from drake_srg.theses.script import Script
from drake_srg.theses.taught import Taught

# Configurations of planners that need the localizer's cameras.
_LOOKING = (PickAndPlace, Clear, Servoing, Insert, Handover, CarryTogether, Taught)
_ONE_ARM = (RobotArm(),)


def command_ports(arms: Sequence[RobotArm]) -> list[tuple[str, str]]:
    """Return the planner's output ports of commands, and the station's input ports."""
    return [
        pair
        for arm in arms
        for pair in (
            (f"{arm.prefix}position_commanded", f"{arm.arm_model}.position_commanded"),
            (
                f"{arm.prefix}closure_commanded",
                f"{arm.gripper_model}.closure_commanded",
            ),
        )
    ]


# The planner's output port that counts messages; also an input of the gripper.
_MESSAGES = "closure_messages"


@scenario_errors()
def MakeCell(
    scenario: Scenario,
    make_station: Callable[[Scenario], Diagram] = MakeStation,
    make_planner: Callable[[Scenario], System] | None = None,
) -> Diagram:
    """Build the diagram of a station, a localizer and a planner.

    .. pydrake_system::

        name: Cell
        input_ports:
        - safety.estop (optional; with safety)
        - safety.release (optional; with safety)
        - safety.speed_override (optional; with safety)
        - safety.heartbeat (optional; with safety)
        output_ports:
        - (all of the station's)
        - localizer.blobs (unless the planner clears a table or is `!Script`)
        - height_mapper.height_map (with the planner `!Clear`)
        - planner.mode
        - planner.status
        - arm.position_commanded
        - gripper.closure_commanded

    The subsystems are named `station`, `localizer`, `planner` and, with disturbances,
    `disturber`. To replace one, build the diagram yourself with your own in its place;
    `AddCell` is kept short for that purpose.

    The tag of the scenario's `planner` chooses the planner:

    * `!PickAndPlace`: a `PickAndPlacePlanner`.
    * `!Taught`: a `TaughtPlanner`.
    * `!Insert`: an `InsertionPlanner`.
    * `!Handover`: a `HandoverPlanner` of two arms.
    * `!CarryTogether`: a `CarryPlanner` of two arms.
    * `!Servoing`: a `ServoingPlanner` with a visual servo; see `MakeServoingPlanner`.
    * `!Clear`: a `ClearingPlanner`, with a `height_mapper` in place of the localizer.
      With `arms`, a diagram of `MakeClearingPair`, with ports `planner.NAME.mode` and
      `NAME.height_mapper.height_map` for each arm.
    * `!Script`: a planner that plays the script, without a localizer.

    Args:
        scenario: The scenario of the cell.
        make_station: Builds the station: any diagram with the ports of `MakeStation`'s.
        make_planner: Makes a planner in place of the scenario's. The planner needs the
            outputs of `PickAndPlacePlanner` and the input `blobs`.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    builder = DiagramBuilder()
    AddCell(builder, scenario, make_station, make_planner)
    diagram = builder.Build()
    diagram.set_name("cell")
    return diagram


def AddCell(
    builder: DiagramBuilder,
    scenario: Scenario,
    make_station: Callable[[Scenario], Diagram] = MakeStation,
    make_planner: Callable[[Scenario], System] | None = None,
) -> None:
    """Add the systems of `MakeCell` to a diagram and export their ports.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    arms = robot_arms(scenario)
    if scenario.arms and make_planner is None and not scenario.planner.several_arms:
        check_single_arm(scenario, f"planner: !{type(scenario.planner).__name__}")
    needed: dict[str, object] = {
        **{f"{arm.key}arm": arm.arm for arm in arms},
        **{f"{arm.key}gripper": arm.gripper for arm in arms},
        "task.pick": scenario.task.pick or scenario.task.clear,
    }
    if make_planner is not None:
        needed["task.pick"] = scenario.task.pick
        needed["localizer.cameras"] = scenario.localizer.cameras
    elif isinstance(scenario.planner, _LOOKING):
        key = "localizer.cameras (or planner: !Script)"
        needed[key] = scenario.localizer.cameras
    missing = [key for key, value in needed.items() if not value]
    if missing:
        raise ScenarioError(f"a cell also needs {', '.join(missing)}")
    station = builder.AddNamedSystem("station", make_station(scenario))
    export_outputs(builder, station)
    for name, port in input_ports(station).items():
        if name.startswith(tuple(f"{arm.prefix}safety." for arm in arms)):
            builder.ExportInput(port, name)
    planner = AddScenarioPlanner(builder, scenario, station, make_planner)
    ConnectCommands(builder, station, planner, arms)
    AddDisturber(builder, scenario, station, planner)
    own_modes = [f"{arm.name}.mode" for arm in arms if arm.name]
    for name, exported in (
        ("mode", "planner.mode"),
        ("status", "planner.status"),
        *(
            (name, f"planner.{name}")
            for name in own_modes
            if planner.HasOutputPort(name)
        ),
        *command_ports(arms),
    ):
        builder.ExportOutput(planner.GetOutputPort(name), exported)


def AddScenarioPlanner(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Diagram,
    make_planner: Callable[[Scenario], System] | None = None,
) -> System:
    """Add a scenario's planner and perception, connected to the station's sensors.

    Its commands are not connected; see `ConnectCommands`. `make_planner` makes a
    planner in place of the scenario's; see `MakeCell`.
    """
    if make_planner is not None:
        return AddLocalizingPlanner(builder, scenario, station, make_planner)
    return _adder(scenario.planner)(builder, scenario, station)


def load_make_cell(name: str) -> Callable[[Scenario], Diagram]:
    """Return a user's own function that builds a cell.

    Args:
        name: `module:function`; the module may also be in the working directory.

    Raises:
        ScenarioError: If there is no such function.
    """
    module, colon, function = name.partition(":")
    if not (module and colon and function):
        raise ScenarioError(f"--cell {name}: must be MODULE:FUNCTION")
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
    try:
        make_cell = getattr(importlib.import_module(module), function, None)
    except Exception as error:  # the user's module may raise anything
        words = f"{type(error).__name__}: {one_line(error)}"
        raise ScenarioError(f"--cell {name}: cannot be imported: {words}") from error
    if not callable(make_cell):
        raise ScenarioError(f"--cell {name}: {module} has no function {function!r}")
    made: Callable[[Scenario], Diagram] = make_cell
    return made


def AddLocalizingPlanner(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Diagram,
    make_planner: Callable[[Scenario], System],
) -> System:
    """Add a planner with the inputs of `PickAndPlacePlanner`, and the localizer."""
    localizer = AddLocalizer(builder, scenario, station)
    planner = builder.AddNamedSystem("planner", make_planner(scenario))
    builder.Connect(localizer.GetOutputPort("blobs"), planner.GetInputPort("blobs"))
    ConnectSensors(builder, station, planner, robot_arms(scenario))
    ConnectHandCamera(builder, station, planner)
    if scenario.localizer.obstacles and planner.HasInputPort("obstacles"):
        finder = AddObstacleFinder(builder, scenario, station, localizer)
        builder.Connect(finder.get_output_port(), planner.GetInputPort("obstacles"))
    builder.ExportOutput(localizer.GetOutputPort("blobs"), "localizer.blobs")
    return planner


def AddClearingPlanner(
    builder: DiagramBuilder, scenario: Scenario, station: Diagram
) -> System:
    """Add the planner that clears a scenario's table, and each arm's height mappers."""
    shares, make = {"": scenario}, MakeClearingPlanner
    if scenario.arms:
        make = MakeClearingPair
        shares = {f"{arm}.": own for arm, (own, _) in shares_of(scenario).items()}
    planner = builder.AddNamedSystem("planner", make(scenario))
    for prefix, share in shares.items():
        mapper = AddHeightMapper(builder, share, station)
        seen = labeled = mapper.GetOutputPort("height_map")
        if needs_labels(share):
            labeled = AddThingLabeler(builder, share, station, seen)
        destinations = AddDestinationMapper(builder, share, station)
        for source, target in (
            (labeled, "height_map"),
            (destinations.GetOutputPort("height_map"), "destination_map"),
        ):
            builder.Connect(source, planner.GetInputPort(f"{prefix}{target}"))
        builder.ExportOutput(seen, f"{prefix}height_mapper.height_map")
    ConnectSensors(builder, station, planner, robot_arms(scenario))
    return planner


def AddScriptedPlanner(
    builder: DiagramBuilder, scenario: Scenario, station: Diagram
) -> System:
    """Add the planner that plays a scenario's script."""
    planner = builder.AddNamedSystem("planner", MakeScriptedPlanner(scenario))
    if any(step.force_limit is not None for step in script_of(scenario)):
        builder.Connect(
            planner.GetOutputPort("force_limit"),
            station.GetInputPort("gripper.force_limit"),
        )
    return planner


# Adds a planner and its perception to a cell, and connects their inputs to the station.
AddPlanner: TypeAlias = Callable[[DiagramBuilder, Scenario, Diagram], System]
_PLANNERS: dict[type[PlannerConfig], AddPlanner] = {
    PickAndPlace: functools.partial(AddLocalizingPlanner, make_planner=MakePlanner),
    Servoing: functools.partial(AddLocalizingPlanner, make_planner=MakeServoingPlanner),
    Taught: functools.partial(AddLocalizingPlanner, make_planner=MakeTaughtPlanner),
    Insert: functools.partial(AddLocalizingPlanner, make_planner=MakeInsertionPlanner),
    Handover: functools.partial(AddLocalizingPlanner, make_planner=MakeHandoverPlanner),
    CarryTogether: functools.partial(
        AddLocalizingPlanner, make_planner=MakeCarryPlanner
    ),
    Clear: AddClearingPlanner,
    Script: AddScriptedPlanner,
}


def register_planner(config: type[PlannerConfig], add: AddPlanner) -> None:
    """Make a planner known to scenario files and to cells.

    Args:
        config: Class of its configuration; the class name is its tag.
        add: Adds the planner to a cell and connects its inputs. It takes the diagram's
            builder, the scenario and the station, which is in the diagram already, and
            returns the planner. The cell connects the outputs, which must be those of
            `PickAndPlacePlanner`.
    """
    accept_planner(config)
    _PLANNERS[config] = add


def _adder(config: PlannerConfig) -> AddPlanner:
    """Return the function that adds the planner of a configuration or its base class.

    Raises:
        ScenarioError: If no such function is registered.
    """
    for kind in type(config).__mro__:
        if kind in _PLANNERS:
            return _PLANNERS[kind]
    known = ", ".join(f"!{kind.__name__}" for kind in _PLANNERS)
    raise ScenarioError(
        f"planner: a cell does not know !{type(config).__name__}: give it to "
        f"register_planner (allowed: {known})"
    )


def AddDisturber(
    builder: DiagramBuilder, scenario: Scenario, station: Diagram, planner: System
) -> None:
    """Add the system that applies a scenario's disturbances, if it has any.

    The system is connected to the station and to the planner's `mode`.
    """
    if not scenario.disturbances:
        return
    plant = station.GetSubsystemByName("plant")
    disturbances = []
    for disturbance in scenario.disturbances:
        name = disturbance.object or scenario.task.pick
        config = scenario.objects[name]
        if config.present:
            body = object_body(plant, plant.GetModelInstanceByName(name))
            # A copy, because the plant's own object would keep the diagram alive.
            inertia = copy.copy(plant.get_body(body).default_spatial_inertia())
            target = Target(name, body, inertia, simple_shape(name, config))
            disturbances.append((disturbance, target))
    if not disturbances:
        return
    # With CENIC, a power of two; see `drake_srg.scenario.checks`.
    period = scenario.plant_config.time_step or 1.0 / 256.0
    disturber = builder.AddNamedSystem("disturber", Disturber(disturbances, period))
    builder.Connect(planner.GetOutputPort("mode"), disturber.GetInputPort("mode"))
    builder.Connect(
        station.GetOutputPort("object_poses_cheat"),
        disturber.GetInputPort("object_poses"),
    )
    builder.Connect(
        disturber.GetOutputPort("object_forces"),
        station.GetInputPort("object_forces_cheat"),
    )


def ConnectPlanner(
    builder: DiagramBuilder, station: Diagram, localizer: System, planner: System
) -> None:
    """Connect one arm's planner to a station and a localizer.

    The planner has ports of `PickAndPlacePlanner`. Measurements are connected only if
    it has an input for them.

    Args:
        builder: Builder of the diagram that contains all three.
        station: A station with the ports of `MakeStation`'s.
        localizer: A system with the output port `blobs`.
        planner: The planner.
    """
    builder.Connect(localizer.GetOutputPort("blobs"), planner.GetInputPort("blobs"))
    ConnectSensors(builder, station, planner)
    ConnectCommands(builder, station, planner)


def ConnectSensors(
    builder: DiagramBuilder,
    station: Diagram,
    planner: System,
    arms: Sequence[RobotArm] = _ONE_ARM,
) -> None:
    """Connect a station's measurements to the planner's inputs for them."""
    for arm in arms:
        for source, target in (
            (f"{arm.arm_model}.state_measured", "arm_state"),
            (f"{arm.gripper_model}.state_measured", "gripper_state"),
            (f"{arm.gripper_model}.grasped", "grasped"),
            (f"{arm.gripper_model}.contact_force", "contact_force"),
            (f"{arm.gripper_model}.proximity", "proximity"),
            (f"{arm.arm_model}.external_torque", "external_torque"),
        ):
            name = f"{arm.prefix}{target}"
            if station.HasOutputPort(source) and planner.HasInputPort(name):
                port = planner.GetInputPort(name)
                builder.Connect(station.GetOutputPort(source), port)


def ConnectCommands(
    builder: DiagramBuilder,
    station: Diagram,
    planner: System,
    arms: Sequence[RobotArm] = _ONE_ARM,
) -> None:
    """Connect a planner's commands to a station.

    Raises:
        ScenarioError: If a gripper counts messages, but the planner has no such port.
    """
    for source, target in command_ports(arms):
        builder.Connect(planner.GetOutputPort(source), station.GetInputPort(target))
    for arm in arms:
        counted = f"{arm.gripper_model}.{_MESSAGES}"
        if not station.HasInputPort(counted):
            continue
        if not planner.HasOutputPort(_MESSAGES):
            raise ScenarioError(
                f"{arm.key}gripper.underactuation.evaluate: per_message needs planner: "
                "!Script (allowed without: periodic)"
            )
        builder.Connect(planner.GetOutputPort(_MESSAGES), station.GetInputPort(counted))
