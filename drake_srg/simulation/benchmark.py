"""Benchmarks a scenario: its speed beside the bare plant's, and where time goes."""

import dataclasses as dc
import subprocess
import sys
import time as wall
from collections.abc import Callable, Mapping

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, EventStatus
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.cell import AddCell, MakeCell
from drake_srg.common.exceptions import scenario_errors
from drake_srg.lifetime import my_context
from drake_srg.scenario import Scenario, list_scenarios
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.simulate import Simulate, failure_time
from drake_srg.station.plant import AddPlant
from drake_srg.types import Failure, Mode, PlannerStatus, Vector

# Inputs of the plant that a replay needs: subsystem of the station, output port, and
# the plant's input port with the model instance it belongs to.
_PLANT_INPUTS = (
    ("arm_driver", "desired_state", "arm", "get_desired_state_input_port"),
    ("arm_driver", "actuation", "arm", "get_actuation_input_port"),
    ("gripper_driver", "actuation", "gripper", "get_actuation_input_port"),
)

# Importing toppra is left to planners that use it.
_IMPORTS = """
from drake_srg import Simulate, load_scenario
from drake_srg.planning.motion.time_parameterization import MakeTimeParameterization
MakeTimeParameterization("toppra")
"""


@dc.dataclass(frozen=True)
class Benchmark:
    """Wall-clock times of a run and of its bare plant on the same inputs [s]."""

    result: str  # success, or the failure's name
    placement_error: list[float] | None  # final position minus goal [m]
    simulated: float
    total: float
    plant: float
    planning: float
    rendering: float
    setup: float  # building the cell before the run, judging and freeing it afterwards

    @property
    def other(self) -> float:
        """The rest: our systems in Python, and logging."""
        return self.total - self.plant - self.planning - self.rendering

    def rows(self) -> dict[str, str]:
        """Return the figures as text, by label."""
        error = self.placement_error

        def share(time: float) -> str:
            return f"{time:.2f} s, {time / self.total:.0%}"

        return {
            "result": self.result,
            "placement error x, y": (
                f"{1e3 * error[0]:.2f}, {1e3 * error[1]:.2f} mm" if error else "-"
            ),
            "simulated": f"{self.simulated:.2f} s",
            "wall clock": f"{self.total:.2f} s",
            "speed": f"{self.simulated / self.total:.2f} x real time",
            "bare plant": f"{self.simulated / self.plant:.2f} x real time",
            "speed : bare plant": f"{self.plant / self.total:.2f}",
            "plant": share(self.plant),
            "planning": share(self.planning),
            "rendering": share(self.rendering),
            "our systems": share(self.other),
            "before and after": f"{self.setup:.2f} s",
        }


def benchmark_table(benchmarks: Mapping[str, Benchmark]) -> str:
    """Return the figures of several scenarios side by side, as text."""
    columns = [benchmark.rows() for benchmark in benchmarks.values()]
    width = max(26, *(len(name) + 2 for name in benchmarks))
    lines = [("", *benchmarks)]
    lines += [(key, *(column[key] for column in columns)) for key in columns[0]]
    return "\n".join(
        f"{key:22}" + "".join(f"{cell:{width}}" for cell in cells).rstrip()
        for key, *cells in lines
    )


def scenarios_with_fast_variant() -> list[str]:
    """Return the package's scenarios that have a fast variant, each followed by it."""
    names = list_scenarios()
    return [
        name
        for base in names
        if f"{base}_fast" in names
        for name in (base, f"{base}_fast")
    ]


def run_benchmark(scenario: Scenario, name: str = "scenario") -> Benchmark:
    """Measure a run of a scenario, its plant alone, and single images.

    The bare plant gets the inputs recorded in a run, held constant between its steps.
    So it makes the same contacts, with none of our systems attached.

    Args:
        scenario: The scenario to measure.
        name: Its name, for error messages.

    Raises:
        ScenarioError: If the models do not fit the scenario, or Drake aborts the run.
        KeyboardInterrupt: If the user stops the run.
    """
    inputs = _record_inputs(scenario, name)
    start = wall.perf_counter()
    result = Simulate(scenario, name=name)
    elapsed = wall.perf_counter() - start
    if result.status.failure is Failure.STOPPED:
        raise KeyboardInterrupt
    times = result.metrics
    return Benchmark(
        result=times.failure or "success",
        placement_error=times.placement_error_m,
        simulated=times.sim_time_s,
        total=times.wall_time_s,
        plant=_replay(scenario, inputs, times.sim_time_s),
        planning=times.planning_wall_s,
        rendering=_look_time(scenario, result.status.looks),
        setup=elapsed - times.wall_time_s,
    )


def import_times() -> dict[str, float]:
    """Return how long processes take that only import, by what they import [s]."""
    programs = {
        "python without imports": "",
        "import drake_srg": "import drake_srg",
        "all imports of a run": _IMPORTS,
    }

    def run(code: str) -> Callable[[], object]:
        return lambda: subprocess.run([sys.executable, "-c", code], check=True)

    return {what: _timed(run(code)) for what, code in programs.items()}


def _record_inputs(scenario: Scenario, name: str) -> dict[int, PiecewisePolynomial]:
    """Return the plant's inputs at each of its steps in a run, as trajectories."""
    builder, cell = MakeRoot("cell", MakeCell, AddCell, scenario, name)
    with scenario_errors(name):
        diagram = builder.Build()
        simulator = Simulator(diagram)
        ApplySimulatorConfig(scenario.simulator_config, simulator)
    station = cell.GetSubsystemByName("station")
    cell_context = my_context(cell, simulator.get_context())
    times: list[float] = []
    rows: list[list[Vector]] = [[] for _ in _PLANT_INPUTS]
    ports = [
        (station.GetSubsystemByName(driver), output)
        for driver, output, *_ in _PLANT_INPUTS
    ]

    def monitor(root: Context) -> EventStatus:
        times.append(root.get_time())
        for (driver, output), values in zip(ports, rows, strict=True):
            context = driver.GetMyContextFromRoot(root)
            values.append(np.array(driver.GetOutputPort(output).Eval(context)))
        status: PlannerStatus = cell.GetOutputPort("planner.status").Eval(cell_context)
        if status.mode in (Mode.DONE, Mode.FAILED):
            return EventStatus.ReachedTermination(diagram, "the planner has ended")
        return EventStatus.Succeeded()

    simulator.set_monitor(monitor)
    with failure_time(name, simulator):
        simulator.AdvanceTo(scenario.task.repeat * scenario.planner.time_budget + 1.0)
    # The last step can be shorter than the plant's. Keep one sample per time.
    unique = np.unique(np.round(times, 9), return_index=True)[1]
    breaks = np.array(times)[unique]
    return {
        i: PiecewisePolynomial.ZeroOrderHold(breaks, np.array(values)[unique].T)
        for i, values in enumerate(rows)
    }


def _replay(
    scenario: Scenario, inputs: dict[int, PiecewisePolynomial], duration: float
) -> float:
    """Return the wall-clock time of the bare plant on recorded inputs [s]."""
    builder = DiagramBuilder()
    plant, _ = AddPlant(builder, scenario)
    for i, (*_, name, port) in enumerate(_PLANT_INPUTS):
        source = builder.AddSystem(TrajectorySource(inputs[i]))
        target = getattr(plant, port)(plant.GetModelInstanceByName(name))
        builder.Connect(source.get_output_port(), target)
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    simulator.Initialize()
    return _timed(lambda: simulator.AdvanceTo(duration))


def _look_time(scenario: Scenario, looks: int) -> float:
    """Return the wall-clock time of that many looks at the blobs [s].

    The first look costs more because each context sets up a renderer of its own. The
    setup of a process's very first renderer is excluded: a run does it before it starts
    its clock.
    """
    if looks == 0:
        return 0.0
    cell: Diagram = MakeCell(scenario)
    port = cell.GetOutputPort("localizer.blobs")
    port.Eval(cell.CreateDefaultContext())
    context = cell.CreateDefaultContext()
    times = []
    for i in range(4):
        context.SetTime(float(i))  # so that the camera renders anew
        times.append(_timed(lambda: port.Eval(context)))
    return times[0] + (looks - 1) * float(np.mean(times[1:]))


def _timed(action: Callable[[], object]) -> float:
    start = wall.perf_counter()
    action()
    return wall.perf_counter() - start
