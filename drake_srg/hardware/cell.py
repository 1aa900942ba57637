"""The cell that runs on hardware: a station, and a planner in another process."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import LinearSystem

from drake_srg.arm.driver import ArmDriver
from drake_srg.cell.servoing import MakeServo
from drake_srg.common.ports import export_outputs, input_ports, output_ports
from drake_srg.hardware.exchange import PlannerLink
from drake_srg.hardware.link import STAMP
from drake_srg.hardware.remote_planner import RemotePlanner
from drake_srg.scenario import Scenario, servo_of
from drake_srg.servoing.late_sightings import LateSightings
from drake_srg.servoing.visual_servo import VisualServo

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
    scenario: Scenario,
    station: Diagram,
    planner: PlannerLink,
    patience: float,
    lag: float = 0.0,
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
        - planner.servo_status (with a visual servo)

    The subsystems are named `station` and `planner` and, with a visual servo, `servo`,
    `late_sightings` and `command_hold`. The servo moves the arm at the period of its
    driver. What its camera shows comes from the planner.

    Args:
        scenario: That runs on the hardware.
        station: Of `MakeHardwareStation`, without cameras.
        planner: The connection to the planner.
        patience: Longest time for a plan [s].
        lag: How long after a command the robot is to be there [s].
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
    commanded = {
        "arm.position_commanded": remote.GetOutputPort("position_commanded"),
        "gripper.closure_commanded": remote.GetOutputPort("closure_commanded"),
    }
    if servo_of(scenario) is not None:
        servo = _AddServo(builder, scenario, station, remote, lag)
        hold = _AddHold(builder, scenario.arm, servo)
        commanded["arm.position_commanded"] = hold.get_output_port()
        builder.ExportOutput(servo.GetOutputPort("status"), "planner.servo_status")
    for name, output in commanded.items():
        builder.Connect(output, station.GetInputPort(name))
        builder.ExportOutput(output, name)
    for name in ("mode", "status"):
        builder.ExportOutput(remote.GetOutputPort(name), f"planner.{name}")
    diagram = builder.Build()
    diagram.set_name("hardware_cell")
    return diagram


def _AddServo(
    builder: DiagramBuilder,
    scenario: Scenario,
    station: Diagram,
    planner: RemotePlanner,
    lag: float,
) -> VisualServo:
    """Add a scenario's visual servo, and what dates its sightings."""
    assert scenario.arm is not None
    config, period = servo_of(scenario), scenario.arm.period
    assert config is not None
    # Its commands pass the safety monitor, which wants a new one every period; each
    # waits for one in `command_hold`.
    config = dc.replace(config, period=period, lag=config.lag + lag + period)
    servo = builder.AddNamedSystem("servo", MakeServo(scenario, config))
    late = builder.AddNamedSystem(
        "late_sightings", LateSightings(len(scenario.arm.home), period)
    )
    for output, system, input in (
        (planner.GetOutputPort("sighting"), late, "sighting"),
        (station.GetOutputPort("arm.state_measured"), late, "arm_state"),
        (station.GetOutputPort(STAMP), late, "arm_stamp"),
        (planner.GetOutputPort("servo_command"), servo, "command"),
        (planner.GetOutputPort("position_commanded"), servo, "position_planned"),
        (station.GetOutputPort("arm.state_measured"), servo, "arm_state"),
        (late.get_output_port(), servo, "sighting"),
        (servo.GetOutputPort("status"), planner, "servo_status"),
    ):
        builder.Connect(output, system.GetInputPort(input))
    return servo


def _AddHold(
    builder: DiagramBuilder, arm: ArmDriver, servo: VisualServo
) -> LinearSystem:
    """Add `command_hold`, which delays a servo's commands by a period.

    Drake updates the servo before the monitor at the same time, and others read the
    monitor before either. Without the delay, those would see it judge an old command.
    """
    eye = np.eye(len(arm.home))
    hold = builder.AddNamedSystem(
        "command_hold",
        LinearSystem(A=0.0 * eye, B=eye, C=eye, D=0.0 * eye, time_period=arm.period),
    )
    hold.configure_default_state(np.array(arm.home))
    builder.Connect(servo.GetOutputPort("position_commanded"), hold.get_input_port())
    return hold
