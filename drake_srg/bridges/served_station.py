"""The diagram that `Serve` runs: a station with smoothed arm targets."""

from __future__ import annotations

import dataclasses as dc

from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import PassThrough

from drake_srg.arm.drivers import AddJerkLimits
from drake_srg.common.ports import Ports
from drake_srg.scenario import Scenario
from drake_srg.station import AddStation


def AddServedStation(builder: DiagramBuilder, scenario: Scenario) -> Ports:
    """Add a station that external clients command; return its ports.

    .. pydrake_system::

        name: ServedStation
        input_ports:
        - (all of the station's except arm.position_commanded)
        - arm.position_desired
        output_ports:
        - (all of the station's except the cameras')
        - plant.state
        - arm.position_commanded
        - gripper.closure_commanded

    `arm.position_desired` (N) [rad or m] reaches the arm through a
    `JerkLimitedReference` that starts at the arm's home position. `plant.state` feeds
    `AddRemoteCameras`.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    ports = AddStation(builder, dc.replace(scenario, cameras={}))
    plant = builder.GetSubsystemByName("plant")
    ports.outputs["plant.state"] = plant.get_state_output_port()
    if scenario.arm is not None:
        reference = AddJerkLimits(builder, scenario.arm)
        commanded = ports.inputs.pop("arm.position_commanded")
        builder.Connect(reference.get_output_port(), commanded)
        ports.inputs["arm.position_desired"] = reference.get_input_port()
        ports.outputs["arm.position_commanded"] = reference.get_output_port()
    closure = ports.inputs.get("gripper.closure_commanded")
    if closure is not None:
        command = builder.AddNamedSystem("closure_commanded", PassThrough(1))
        builder.Connect(command.get_output_port(), closure)
        ports.inputs["gripper.closure_commanded"] = command.get_input_port()
        ports.outputs["gripper.closure_commanded"] = command.get_output_port()
    return ports
