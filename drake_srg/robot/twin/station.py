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
    InputPort,
)
from pydrake.systems.primitives import PassThrough

from drake_srg.arm.driver import ArmDriver
from drake_srg.arm.external_torque import ExternalTorqueObserver
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.systems import (
    export_outputs,
    input_ports,
    model_actuators,
    output_ports,
)
from drake_srg.lifetime import LeafSystem
from drake_srg.robot.serve.loop import control_period
from drake_srg.robot.twin.comparison import ObjectComparison, TwinMonitor
from drake_srg.scenario import Scenario, robot_arms
from drake_srg.station import MakeStation
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector

# Time over which the lag is averaged [s].
_MEMORY = 2.0
# Mean square of the speed at which half of the lag is compensated [rad²/s² or m²/s²]: a
# resting arm does not reveal its lag.
_SLOW = 1e-3
# Largest lag that is compensated [s].
_LARGEST = 0.3


class LagCompensation(LeafSystem):
    """Commands an arm so that it follows the measured state of another arm.

    .. pydrake_system::

        name: LagCompensation
        input_ports:
        - state_measured
        - state
        output_ports:
        - position_commanded

    `state_measured` (2N), [q; v], is the state of the arm to follow, and `state` (2N)
    that of the commanded arm [rad, rad/s or m, m/s]. A driver follows a steady motion
    with a constant lag L. To make up for it, the command (N) is q + L v. The system
    finds L as the least-squares solution of `position_commanded - q = L v` over the
    last seconds of the commanded arm's own motion.

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
        """Return the present estimate of the lag [s]."""
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
    motors, and unless something is in its way. Fingers and objects are simulated:
    `gripper.closure_commanded` (1) moves the fingers, and contact moves the objects.
    The inputs `robot.NAME` are measurements, see `TwinMonitor` and `ObjectComparison`.
    A missing measurement is NaN, except that the arm's state must not be missing, and
    that `robot.arm_torque_or_zero` (N) has zeros instead. With `arms`, ports of an arm
    and its gripper have the names of their models, such as `robot.left_state` and
    `robot.left.gripper_state`; the outputs `twin.NAME` have values of all arms. The
    subsystem `station` is the station, without cameras, safety monitor and
    disturbances.

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
    robots, period = robot_arms(scenario), twin_period(scenario)
    arms = [robot.arm for robot in robots if robot.arm is not None]
    grippers = [robot.gripper for robot in robots if robot.gripper is not None]
    if not len(arms) == len(grippers) == len(robots):
        raise ScenarioError("twin: the scenario needs an arm and a gripper")
    station = builder.AddNamedSystem("station", make_station(_followed(scenario)))
    export_outputs(builder, station)
    commands, models = input_ports(station), MakeModelsPlant(scenario)
    names = [name for name, config in scenario.objects.items() if config.present]
    objects = builder.AddNamedSystem(
        "object_comparison", ObjectComparison(names, period)
    )
    efforts = {
        robot.arm_model: np.array(
            [
                actuator.effort_limit()
                for actuator in model_actuators(
                    models, models.GetModelInstanceByName(robot.arm_model)
                )
            ]
        )
        for robot in robots
    }
    fingers = {
        robot.gripper_model: len(robot.gripper.joint_names)
        for robot in robots
        if robot.gripper is not None
    }
    monitor = builder.AddNamedSystem(
        "twin_monitor",
        TwinMonitor(scenario.twin, efforts, fingers, len(names), period),
    )

    def take(name: str, first: InputPort, *others: InputPort) -> None:
        builder.ExportInput(first, f"robot.{name}")
        for other in others:
            builder.ConnectInput(f"robot.{name}", other)

    for robot in robots:
        arm, gripper = robot.arm_model, robot.gripper_model
        following = builder.AddNamedSystem(
            robot.system("following"), LagCompensation(len(efforts[arm]), period)
        )
        closure = builder.AddNamedSystem(
            robot.system("closure_commanded"), PassThrough(1)
        )
        name = f"{gripper}.closure_commanded"
        builder.ExportInput(closure.get_input_port(), name)
        for system, name in (
            (following, f"{arm}.position_commanded"),
            (closure, f"{gripper}.closure_commanded"),
        ):
            builder.Connect(system.get_output_port(), commands[name])
            builder.ExportOutput(system.get_output_port(), name)
        observer = builder.AddNamedSystem(
            robot.system("external_torque_of_robot"),
            ExternalTorqueObserver(models, [arm, gripper], period),
        )
        state = station.GetOutputPort(f"{arm}.state_measured")
        hand = station.GetOutputPort(f"{gripper}.state_measured")
        expected = station.GetOutputPort(f"{arm}.external_torque")
        for output, system, input in (
            (state, following, "state"),
            # The robot may not publish its fingers' angles, so take the twin's.
            (hand, observer, f"{gripper}_state"),
            (state, monitor, f"{arm}_state"),
            (hand, monitor, f"{gripper}_state"),
            (observer.get_output_port(), monitor, f"{arm}_external_felt"),
            (expected, monitor, f"{arm}_external_expected"),
        ):
            builder.Connect(output, system.GetInputPort(input))
        take(
            f"{arm}_state",
            following.GetInputPort("state_measured"),
            observer.GetInputPort(f"{arm}_state"),
            monitor.GetInputPort(f"{arm}_state_measured"),
        )
        take(f"{arm}_torque", monitor.GetInputPort(f"{arm}_torque_measured"))
        take(f"{arm}_torque_or_zero", observer.GetInputPort("torque"))
        take(f"{gripper}_state", monitor.GetInputPort(f"{gripper}_state_measured"))
    builder.Connect(objects.get_output_port(), monitor.GetInputPort("object_error"))
    poses = station.GetOutputPort("object_poses_cheat")
    builder.Connect(poses, objects.GetInputPort("object_poses"))
    for name in ("sightings", "placed_at"):
        take(name, objects.GetInputPort(name))
    for system in (objects, monitor):
        for name, output in output_ports(system).items():
            builder.ExportOutput(output, f"twin.{name}")


def twin_period(scenario: Scenario) -> float:
    """Return the time between samples of the twin [s]."""
    return scenario.twin.period or control_period(scenario)


def _followed(scenario: Scenario) -> Scenario:
    """Return the scenario of the twin's station."""
    period = twin_period(scenario)

    def timed(arm: ArmDriver | None) -> ArmDriver | None:
        return None if arm is None else dc.replace(arm, period=period)

    arms = {
        name: dc.replace(each, arm=timed(each.arm), safety=None)
        for name, each in scenario.arms.items()
    }
    # The station outputs the torques of its contacts only if there is a limit.
    first = robot_arms(scenario)[0].arm
    limits = [1e9] * (0 if first is None else len(first.home))
    planner = dc.replace(scenario.planner, max_external_torque=limits)
    return dc.replace(
        scenario,
        cameras={},
        safety=None,
        disturbances=[],
        arm=timed(scenario.arm),
        arms=arms,
        planner=planner,
    )
