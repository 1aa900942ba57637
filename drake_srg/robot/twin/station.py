"""The diagram of a twin: a station that follows a robot."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
    DiscreteValues,
)
from pydrake.systems.primitives import PassThrough

from drake_srg.arm.external_torque import ExternalTorqueObserver
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.systems import export_outputs, input_ports, model_actuators
from drake_srg.lifetime import LeafSystem
from drake_srg.robot.twin.comparison import (
    ObjectComparison,
    TorqueComparison,
    TwinMonitor,
)
from drake_srg.scenario import Scenario
from drake_srg.scenario.schema import check_single_arm
from drake_srg.station import MakeStation
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector

# Over this time the lag is averaged [s].
_MEMORY = 2.0
# Mean square of the speed at which half of the lag is made up for [rad²/s² or m²/s²]:
# a resting arm reveals nothing about it.
_SLOW = 1e-3
# A driver that lags by more is not made up for [s].
_LARGEST = 0.3


class LagCompensation(LeafSystem):
    """Commands an arm so that it is where another arm is measured.

    .. pydrake_system::

        name: LagCompensation
        input_ports:
        - state_measured
        - state
        output_ports:
        - position_commanded

    `state_measured` (2N), [q; v], is the arm to follow, `state` (2N) the one that is
    commanded [rad, rad/s or m, m/s]. A driver follows a steady motion with a constant
    lag L. So the command (N) is ahead by that: q + L v. The system finds L as the
    least-squares solution of `position_commanded - q = L v` over the last seconds of
    the commanded arm's own motion.

    Args:
        size: Number N of joints.
        period: Time between samples [s].
    """

    def __init__(self, size: int, period: float) -> None:
        super().__init__()
        self._n, self._share = size, float(-np.expm1(-period / _MEMORY))
        self._measured, self._own = (
            self.DeclareVectorInputPort(name=name, size=2 * size)
            for name in ("state_measured", "state")
        )
        # Means of (command - q) v and of v².
        self._means = int(self.DeclareDiscreteState(np.zeros(2)))
        self.DeclareVectorOutputPort(
            name="position_commanded", size=size, calc=self._calc_position
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def lag(self, context: Context) -> float:
        """Return the lag as it is known now [s]."""
        product, square = context.get_discrete_state(self._means).value()
        return float(np.clip(product / (square + _SLOW), 0.0, _LARGEST))

    def _command(self, context: Context) -> Vector:
        q, v = np.split(self._measured.Eval(context), 2)
        command: Vector = q + self.lag(context) * v
        return command

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._command(context))

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        q, v = np.split(self._own.Eval(context), 2)
        now = np.array([(self._command(context) - q) @ v, v @ v])
        means = context.get_discrete_state(self._means).value()
        discrete_state.set_value(self._means, means + self._share * (now - means))


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
    check_single_arm(scenario, "a twin")
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
        # The robot may not publish its fingers' angles; the twin's weigh as much.
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
    # With any limit, the station reports the torques that its contacts cause.
    planner = dc.replace(scenario.planner, max_external_torque=[1e9] * n)
    return dc.replace(
        scenario, cameras={}, safety=None, disturbances=[], arm=arm, planner=planner
    )
