"""A cell whose robot takes its commands from outside, beside the planner's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    InputPort,
    OutputPort,
    System,
)
from pydrake.systems.primitives import PassThrough

from drake_srg.common.systems import export_outputs, output_ports
from drake_srg.scenario import Scenario
from drake_srg.station import MakeStation
from drake_srg.station.cell import AddDisturber, AddScenarioPlanner

# The station's inputs that are commanded from outside, and the planner's outputs.
COMMANDS = {
    "arm.position_commanded": "position_commanded",
    "gripper.closure_commanded": "closure_commanded",
}


def MakeDrivenCell(
    scenario: Scenario,
    make_station: Callable[[Scenario], Diagram] = MakeStation,
    make_planner: Callable[[Scenario], System] | None = None,
) -> Diagram:
    """Build a cell in which the planner watches and proposes, but does not command.

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

    The planner senses what the robot does, and plans from there, as in `MakeCell`.

    Args:
        scenario: The scenario of the cell.
        make_station: See `MakeCell`.
        make_planner: See `MakeCell`.

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
    sinks = {}
    for name, output in COMMANDS.items():
        port = station.GetInputPort(name)
        builder.ExportInput(port, name)
        sink = builder.AddNamedSystem(f"{output}_unused", PassThrough(port.size()))
        sinks[name] = sink.get_input_port()
    listener = cast(Diagram, _Listening(station, sinks))
    planner = AddScenarioPlanner(builder, scenario, listener, make_planner)
    AddDisturber(builder, scenario, station, planner)
    for name in ("mode", "status", *COMMANDS.values()):
        builder.ExportOutput(planner.GetOutputPort(name), f"planner.{name}")


class _Listening:
    """A station that does not do what it is commanded.

    Args:
        station: The station.
        sinks: Inputs that take the place of the station's, by name.
    """

    def __init__(self, station: Diagram, sinks: dict[str, InputPort]) -> None:
        self.station, self._sinks = station, sinks

    def __getattr__(self, name: str) -> Any:
        return getattr(self.station, name)

    def GetInputPort(self, name: str) -> InputPort:
        """Return an input of the station, or what takes its place."""
        return self._sinks.get(name) or self.station.GetInputPort(name)


@output_ports.register
def _(system: _Listening) -> dict[str, OutputPort]:
    return output_ports(system.station)
