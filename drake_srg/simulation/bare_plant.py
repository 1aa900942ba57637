"""The bare plant of a scenario, on the inputs that a run of its cell gave it."""

import math
from collections.abc import Mapping

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    EventStatus,
    PortDataType,
)
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.cell import AddCell, MakeCell
from drake_srg.common.exceptions import scenario_errors
from drake_srg.common.ports import input_ports
from drake_srg.common.simulator import MakeSimulator
from drake_srg.lifetime import my_context
from drake_srg.scenario import Scenario
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.simulate import failure_time
from drake_srg.station.sleeping import Advance, MakeAdvance
from drake_srg.station.station import AddStation
from drake_srg.types import Mode, PlannerStatus, Vector

# What is left of a station as its bare plant.
_BARE = ("plant", "scene_graph", "sleep_monitor")


class InputRecorder:
    """Runs a scenario's cell and records its plant's inputs at each step.

    It records the input ports that are connected, without forces on objects
    (`disturbances`).

    Args:
        scenario: The scenario to run.
        name: Its name, for error messages.

    Raises:
        ScenarioError: If the models do not fit the scenario.
    """

    def __init__(self, scenario: Scenario, name: str) -> None:
        self._scenario, self._name = scenario, name
        builder, self._cell = MakeRoot("cell", MakeCell, AddCell, scenario, name)
        with scenario_errors(name):
            self._simulator = MakeSimulator(builder.Build(), scenario.simulator_config)
        self._advance = MakeAdvance(self._simulator, self._cell, scenario)
        station = self._cell.GetSubsystemByName("station")
        plant = station.GetSubsystemByName("plant")
        context = plant.GetMyContextFromRoot(self._simulator.get_context())
        ports = {
            key: port
            for key, port in input_ports(plant).items()
            if port.get_data_type() == PortDataType.kVectorValued
            and port.HasValue(context)
        }
        times: list[float] = []
        rows: dict[str, list[Vector]] = {key: [] for key in ports}
        self._times, self._rows = times, rows

        mark_outdated = self._simulator.get_monitor()

        def monitor(root: Context) -> EventStatus:
            if mark_outdated is not None:
                mark_outdated(root)
            times.append(root.get_time())
            context = plant.GetMyContextFromRoot(root)
            for key, port in ports.items():
                rows[key].append(np.array(port.Eval(context)))
            return EventStatus.Succeeded()

        self._simulator.set_monitor(monitor)

    def advance(self, time: float) -> None:
        """Advance to a time [s].

        Raises:
            ScenarioError: If Drake aborts the run.
        """
        with failure_time(self._name, self._simulator):
            self._advance(max(time, self._simulator.get_context().get_time()))

    def run_task(self) -> None:
        """Advance until the planner has ended.

        Raises:
            ScenarioError: If Drake aborts the run.
        """
        scenario = self._scenario
        limit = scenario.task.repeat * scenario.planner.time_budget + 1.0
        period = scenario.recording.period
        context = my_context(self._cell, self._simulator.get_context())
        port = self._cell.GetOutputPort("planner.status")
        for step in range(1, math.ceil(limit / period) + 1):
            self.advance(min(step * period, limit))
            status: PlannerStatus = port.Eval(context)
            if status.mode in (Mode.DONE, Mode.FAILED):
                return

    def trajectories(self) -> dict[str, PiecewisePolynomial]:
        """Return what the plant's input ports got, by their names."""
        # The last step can be shorter than the plant's. Keep one sample per time.
        unique = np.unique(np.round(self._times, 9), return_index=True)[1]
        breaks = np.array(self._times)[unique]
        return {
            key: PiecewisePolynomial.ZeroOrderHold(breaks, np.array(values)[unique].T)
            for key, values in self._rows.items()
        }


def MakeBarePlant(
    scenario: Scenario, inputs: Mapping[str, PiecewisePolynomial], name: str
) -> tuple[Simulator, Advance]:
    """Make a simulation of a scenario's plant alone, on the inputs of a run.

    The inputs are held constant between their samples. So the plant makes the same
    contacts; a discrete one moves the same to the last bit, unless the scenario has
    `disturbances`. None of our systems is attached but one: objects that sleep in the
    run sleep here, too, so time spent here includes finding them.

    Args:
        scenario: The scenario of the run.
        inputs: The trajectories of an `InputRecorder`.
        name: The scenario's name, for error messages.

    Returns:
        The simulator, initialized, and the function that advances it to a time [s].

    Raises:
        ScenarioError: If the inputs do not fit the scenario.
    """
    builder = DiagramBuilder()
    with scenario_errors(name):
        AddStation(builder, scenario)
        for system in builder.GetSystems():
            if system.get_name() not in _BARE:
                builder.RemoveSystem(system)
        plant = builder.GetSubsystemByName("plant")
        for key, trajectory in inputs.items():
            source = builder.AddSystem(TrajectorySource(trajectory))
            builder.Connect(source.get_output_port(), plant.GetInputPort(key))
        diagram = builder.Build()
        simulator = MakeSimulator(diagram, scenario.simulator_config)
        simulator.Initialize()
    return simulator, MakeAdvance(simulator, diagram, scenario)
