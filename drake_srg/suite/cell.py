"""A cell that is commanded from outside, while its planner only proposes commands."""

from __future__ import annotations

from collections.abc import Callable

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from drake_srg.common.systems import export_outputs
from drake_srg.scenario import Scenario, robot_arms
from drake_srg.station import MakeStation
from drake_srg.station.cell import AddDisturber, AddScenarioPlanner, command_ports


def MakeDrivenCell(
    scenario: Scenario,
    make_station: Callable[[Scenario], Diagram] = MakeStation,
    make_planner: Callable[[Scenario], System] | None = None,
) -> Diagram:
    """Build a cell whose planner proposes commands that nothing executes.

    .. pydrake_system::

        name: DrivenCell
        input_ports:
        - arm.position_commanded
        - gripper.closure_commanded
        output_ports:
        - (all of the station's)
        - localizer.blobs (unless the planner is `!Clear` or `!Script`)
        - height_mapper.height_map (with the planner `!Clear`)
        - planner.mode
        - planner.status
        - planner.position_commanded
        - planner.closure_commanded

    With `arms`, the names of the commands of the arm NAME begin with `NAME.` in place
    of `arm.` and `NAME.gripper.` in place of `gripper.`; those of the planner begin
    with `planner.NAME.`.

    The planner senses the robot's motion, and plans from there. Arguments are those of
    `MakeCell`.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    builder = DiagramBuilder()
    AddDrivenCell(builder, scenario, make_station, make_planner)
    diagram = builder.Build()
    diagram.set_name("cell")
    return diagram


def AddDrivenCell(
    builder: DiagramBuilder,
    scenario: Scenario,
    make_station: Callable[[Scenario], Diagram] = MakeStation,
    make_planner: Callable[[Scenario], System] | None = None,
) -> None:
    """Add the systems of `MakeDrivenCell` to a diagram and export their ports."""
    station = builder.AddNamedSystem("station", make_station(scenario))
    export_outputs(builder, station)
    planner = AddScenarioPlanner(builder, scenario, station, make_planner)
    AddDisturber(builder, scenario, station, planner)
    proposed, commanded = zip(*command_ports(robot_arms(scenario)), strict=True)
    for name in commanded:
        builder.ExportInput(station.GetInputPort(name), name)
    for name in ("mode", "status", *proposed):
        builder.ExportOutput(planner.GetOutputPort(name), f"planner.{name}")
