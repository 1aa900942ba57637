"""The diagram that `Serve` runs: a station with smoothed arm targets."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import PassThrough

from drake_srg.arm.driver import AddJerkLimits
from drake_srg.arm.jerk_limited import JerkLimitedReference
from drake_srg.arm.trajectory_follower import TrajectoryFollower
from drake_srg.common.ports import export_outputs, input_ports, output_ports
from drake_srg.scenario import Scenario
from drake_srg.station import MakeStation


def MakeServedStation(scenario: Scenario) -> Diagram:
    """Build the diagram of a station that external clients command.

    .. pydrake_system::

        name: ServedStation
        input_ports:
        - (all of the station's except arm.position_commanded)
        - arm.position_desired (with `arm.limits`)
        - arm.trajectory_desired (without)
        output_ports:
        - (all of the station's except the cameras')
        - arm.position_commanded
        - gripper.closure_commanded

    `arm.position_desired` (N) [rad or m] reaches the arm through a
    `JerkLimitedReference` that starts at the arm's home position, and again wherever a
    safety monitor has stopped the arm. Without `arm.limits`, a `TrajectoryFollower`
    takes its place, and `arm.trajectory_desired` that of the port. The subsystem
    `station` is the station without cameras; `MakeRemoteCameras` renders its plant's
    state in another process.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    builder = DiagramBuilder()
    AddServedStation(builder, scenario)
    diagram = builder.Build()
    diagram.set_name("served_station")
    return diagram


def AddServedStation(
    builder: DiagramBuilder,
    scenario: Scenario,
    make_station: Callable[[Scenario], Diagram] = MakeStation,
) -> None:
    """Add the systems of `MakeServedStation` to a diagram, and export their ports.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    without_cameras = dc.replace(scenario, cameras={})
    station = builder.AddNamedSystem("station", make_station(without_cameras))
    export_outputs(builder, station)
    inputs = input_ports(station)
    if scenario.arm is not None:
        commanded = inputs.pop("arm.position_commanded")
        reference: JerkLimitedReference | TrajectoryFollower
        if scenario.arm.limits is None:
            follower = TrajectoryFollower(
                np.array(scenario.arm.home), scenario.arm.period
            )
            reference = builder.AddNamedSystem("arm_reference", follower)
        else:
            reference = AddJerkLimits(builder, scenario.arm)
        builder.Connect(reference.get_output_port(), commanded)
        if "arm.position_held" in output_ports(station):
            builder.Connect(
                station.GetOutputPort("arm.position_held"),
                reference.GetInputPort("position_held"),
            )
        desired = reference.get_input_port(0)
        builder.ExportInput(desired, f"arm.{desired.get_name()}")
        builder.ExportOutput(reference.get_output_port(), "arm.position_commanded")
    if scenario.gripper is not None:
        closure = inputs.pop("gripper.closure_commanded")
        command = builder.AddNamedSystem("closure_commanded", PassThrough(1))
        builder.Connect(command.get_output_port(), closure)
        builder.ExportInput(command.get_input_port(), "gripper.closure_commanded")
        builder.ExportOutput(command.get_output_port(), "gripper.closure_commanded")
    for name, port in inputs.items():
        builder.ExportInput(port, name)
