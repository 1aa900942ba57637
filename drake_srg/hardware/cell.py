"""The cell that runs on hardware: a station, and a planner in another process."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.cell.cell import ConnectCommands
from drake_srg.common.ports import export_outputs, input_ports, output_ports
from drake_srg.hardware.exchange import PlannerLink
from drake_srg.hardware.remote_planner import RemotePlanner
from drake_srg.scenario import Scenario

# Outputs of the station that are about commands, not about the robot.
_OURS = ("safety.", "arm.position_")


def measurements(station: Diagram) -> dict[str, int]:
    """Return the sizes of a hardware station's measurements, by output port."""
    return {
        name: port.size()
        for name, port in output_ports(station).items()
        if not name.startswith(_OURS)
    }


def MakeHardwareCell(
    scenario: Scenario, station: Diagram, planner: PlannerLink, patience: float
) -> Diagram:
    """Build the diagram of a hardware station and the planner that commands it.

    .. pydrake_system::

        name: HardwareCell
        input_ports:
        - safety.estop (optional)
        - safety.release (optional)
        - safety.speed_override (optional)
        output_ports:
        - ROOM.OUTPUT (all of the station's)
        - planner.mode
        - planner.status
        - arm.position_commanded
        - gripper.closure_commanded

    The subsystems are named `station` and `planner`.

    Args:
        scenario: That runs on the hardware.
        station: Of `MakeHardwareStation`, without cameras.
        planner: The connection to the planner.
        patience: Longest time for a plan [s].
    """
    assert scenario.arm is not None
    builder = DiagramBuilder()
    builder.AddNamedSystem("station", station)
    export_outputs(builder, station)
    for name, port in input_ports(station).items():
        if name.startswith("safety."):
            builder.ExportInput(port, name)
    sizes = measurements(station)
    remote = builder.AddNamedSystem(
        "planner",
        RemotePlanner(
            planner,
            np.array(scenario.arm.home),
            sizes,
            scenario.arm.period,
            scenario.planner.period,
            patience,
        ),
    )
    for name in sizes:
        builder.Connect(station.GetOutputPort(name), remote.GetInputPort(name))
    for name in ("safety.state", "arm.position_held"):
        builder.Connect(station.GetOutputPort(name), remote.GetInputPort(name))
    ConnectCommands(builder, station, remote)
    for name, exported in (
        ("mode", "planner.mode"),
        ("status", "planner.status"),
        ("position_commanded", "arm.position_commanded"),
        ("closure_commanded", "gripper.closure_commanded"),
    ):
        builder.ExportOutput(remote.GetOutputPort(name), exported)
    diagram = builder.Build()
    diagram.set_name("hardware_cell")
    return diagram
