"""The diagram of a twin: a station that follows a robot, and what compares the two."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import PassThrough

from drake_srg.arm.external_torque import ExternalTorqueObserver
from drake_srg.common.actuators import model_actuators
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.ports import export_outputs, input_ports
from drake_srg.scenario import Scenario
from drake_srg.station import MakeStation
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.twin.following import LagCompensation
from drake_srg.twin.monitor import TwinMonitor
from drake_srg.twin.object_comparison import ObjectComparison
from drake_srg.twin.torque_comparison import TorqueComparison


def MakeTwin(scenario: Scenario) -> Diagram:
    """Build the diagram of a station that follows a robot.

    .. pydrake_system::

        name: Twin
        input_ports:
        - gripper.closure_commanded
        - robot.arm_state
        - robot.arm_torque
        - robot.arm_torque_or_zero
        - robot.gripper_state
        - robot.sightings
        - robot.placed_at
        output_ports:
        - (all of the station's except the cameras')
        - arm.position_commanded
        - gripper.closure_commanded
        - arm.external_torque
        - twin.joint_error
        - twin.finger_error
        - twin.torque_expected
        - twin.torque_residual
        - twin.object_error
        - twin.difference
        - twin.parted

    The arm follows `robot.arm_state` by its own driver: within the limits of its
    motors, and as far as nothing is in its way. Fingers and objects are simulated:
    `gripper.closure_commanded` (1) moves the fingers, contact the objects. The inputs
    `robot.NAME` are measurements; see `TwinMonitor`, `TorqueComparison` and
    `ObjectComparison`. NaN is a measurement that nobody tells, but for the arm's state,
    and for `robot.arm_torque_or_zero` (N), which has zeros in its place. The subsystem
    `station` is the station, without cameras, safety monitor and disturbances.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    builder = DiagramBuilder()
    AddTwin(builder, scenario)
    diagram = builder.Build()
    diagram.set_name("twin")
    return diagram


def AddTwin(
    builder: DiagramBuilder,
    scenario: Scenario,
    make_station: Callable[[Scenario], Diagram] = MakeStation,
) -> None:
    """Add the systems of `MakeTwin` to a diagram, and export their ports.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """
    arm, gripper = scenario.arm, scenario.gripper
    if arm is None or gripper is None:
        raise ScenarioError("twin: the scenario needs an arm and a gripper")
    n, period = len(arm.home), twin_period(scenario)
    station = builder.AddNamedSystem("station", make_station(_followed(scenario, n)))
    export_outputs(builder, station)
    commands = input_ports(station)
    following = builder.AddNamedSystem("following", LagCompensation(n, period))
    closure = builder.AddNamedSystem("closure_commanded", PassThrough(1))
    builder.ExportInput(closure.get_input_port(), "gripper.closure_commanded")
    for system, name in (
        (following, "arm.position_commanded"),
        (closure, "gripper.closure_commanded"),
    ):
        builder.Connect(system.get_output_port(), commands[name])
        builder.ExportOutput(system.get_output_port(), name)
    models = MakeModelsPlant(scenario)
    observer = builder.AddNamedSystem(
        "external_torque_of_robot",
        ExternalTorqueObserver(models, ["arm", "gripper"], period),
    )
    torque = builder.AddNamedSystem("torque_comparison", TorqueComparison(n))
    names = [name for name, config in scenario.objects.items() if config.present]
    objects = builder.AddNamedSystem(
        "object_comparison", ObjectComparison(names, period)
    )
    efforts = [
        actuator.effort_limit()
        for actuator in model_actuators(models, models.GetModelInstanceByName("arm"))
    ]
    fingers = len(gripper.joint_names)
    monitor = builder.AddNamedSystem(
        "twin_monitor",
        TwinMonitor(scenario.twin, np.array(efforts), fingers, len(names), period),
    )
    for output, system, input in (
        (station.GetOutputPort("arm.state_measured"), monitor, "arm_state"),
        (station.GetOutputPort("arm.state_measured"), following, "state"),
        (station.GetOutputPort("gripper.state_measured"), monitor, "gripper_state"),
        # The robot may not tell its fingers, and the twin's weigh as much.
        (station.GetOutputPort("gripper.state_measured"), observer, "gripper_state"),
        (torque.GetOutputPort("torque_residual"), monitor, "torque_residual"),
        (objects.get_output_port(), monitor, "object_error"),
        (observer.get_output_port(), torque, "external_felt"),
        (station.GetOutputPort("arm.external_torque"), torque, "external_expected"),
        (station.GetOutputPort("object_poses_cheat"), objects, "object_poses"),
    ):
        builder.Connect(output, system.GetInputPort(input))
    for name, targets in (
        (
            "arm_state",
            [
                (following, "state_measured"),
                (monitor, "arm_state_measured"),
                (observer, "arm_state"),
            ],
        ),
        ("arm_torque", [(torque, "torque_measured")]),
        ("arm_torque_or_zero", [(observer, "torque")]),
        ("gripper_state", [(monitor, "gripper_state_measured")]),
        ("sightings", [(objects, "sightings")]),
        ("placed_at", [(objects, "placed_at")]),
    ):
        first, *others = [system.GetInputPort(input) for system, input in targets]
        builder.ExportInput(first, f"robot.{name}")
        for other in others:
            builder.ConnectInput(f"robot.{name}", other)
    for system, outputs in (
        (torque, ("torque_expected", "torque_residual")),
        (objects, ("object_error",)),
        (monitor, ("joint_error", "finger_error", "difference", "parted")),
    ):
        for name in outputs:
            builder.ExportOutput(system.GetOutputPort(name), f"twin.{name}")


def twin_period(scenario: Scenario) -> float:
    """Return the time between samples of the twin [s]."""
    assert scenario.arm is not None
    return scenario.twin.period or scenario.arm.period


def _followed(scenario: Scenario, n: int) -> Scenario:
    """Return the scenario of the twin's station."""
    assert scenario.arm is not None
    arm = dc.replace(scenario.arm, period=twin_period(scenario))
    # Any limit makes the station tell the torques that its contacts cause.
    planner = dc.replace(scenario.planner, max_external_torque=[np.inf] * n)
    return dc.replace(
        scenario, cameras={}, safety=None, disturbances=[], arm=arm, planner=planner
    )
