"""Speed of a scenario, of its bare plant, and of robosuite for comparison."""

import dataclasses as dc
import json
import math
import subprocess
import sys
import time as wall
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    EventStatus,
    PortDataType,
)
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.systems import MakeSimulator, input_ports
from drake_srg.lifetime import my_context
from drake_srg.scenario import Scenario, list_scenarios
from drake_srg.simulation import robosuite_cycle
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.simulate import Simulate, failure_time
from drake_srg.station import AddCell, MakeCell
from drake_srg.station.sleeping import Advance, MakeAdvance
from drake_srg.station.station import AddStation
from drake_srg.types import Failure, PlannerStatus, Vector

# Systems of a station that the simulation of its bare plant keeps.
_BARE = ("plant", "scene_graph", "sleep_monitor")


class InputRecorder:
    """Runs a scenario's cell and records the plant's vector inputs at each step.

    Forces on objects (`disturbances`) are not recorded.

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
            if status.ended:
                return

    def trajectories(self) -> dict[str, PiecewisePolynomial]:
        """Return the recorded inputs of the plant, by port name."""
        # Two samples may have the same time, because the last step can be shorter than
        # the plant's.
        unique = np.unique(np.round(self._times, 9), return_index=True)[1]
        breaks = np.array(self._times)[unique]
        return {
            key: PiecewisePolynomial.ZeroOrderHold(breaks, np.array(values)[unique].T)
            for key, values in self._rows.items()
        }


def MakeBarePlant(
    scenario: Scenario, inputs: Mapping[str, PiecewisePolynomial], name: str
) -> tuple[Simulator, Advance]:
    """Make a simulation of a scenario's plant alone, with the inputs of a run.

    The inputs are held constant between their samples, so the plant makes the same
    contacts. A discrete plant moves identically, unless the scenario has
    `disturbances`. One of our systems remains: objects that sleep in the run also sleep
    here, and the search for them takes time here, too.

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


# Only planners that use toppra import it.
_IMPORTS = """
from drake_srg import Simulate, load_scenario
from drake_srg.planning.motion.time_parameterization import load_toppra
load_toppra()
"""


@dc.dataclass(frozen=True)
class Benchmark:
    """Wall-clock times of a run, and of its bare plant with the same inputs [s]."""

    result: str  # success, or the failure's name
    placement_error: list[float] | None  # final position minus goal [m]
    simulated: float
    total: float
    plant: float
    planning: float
    rendering: float
    setup: float  # building the cell, and judging and freeing the run

    @property
    def other(self) -> float:
        """The remaining time: our systems in Python, and logging."""
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
    """Return the package's scenarios with a fast variant, and that after each."""
    names = list_scenarios()
    return [
        name
        for base in names
        if f"{base}_fast" in names
        for name in (base, f"{base}_fast")
    ]


def run_benchmark(scenario: Scenario, name: str = "scenario") -> Benchmark:
    """Measure a run of a scenario, its bare plant, and looks of the planner.

    The bare plant gets the recorded inputs of a run; see `MakeBarePlant`.

    Raises:
        ScenarioError: If the models do not fit the scenario, or Drake aborts the run.
        KeyboardInterrupt: If the user stops the run.
    """
    recorder = InputRecorder(scenario, name)
    recorder.run_task()  # first, so that the measured run needs no more imports
    start = wall.perf_counter()
    result = Simulate(scenario, name=name)
    elapsed = wall.perf_counter() - start
    if result.status.failure is Failure.STOPPED:
        raise KeyboardInterrupt
    times = result.metrics
    recorder.advance(times.sim_time_s)  # objects settle
    simulator, advance = MakeBarePlant(scenario, recorder.trajectories(), name)
    with failure_time(f"{name}: bare plant", simulator):
        plant = _timed(lambda: advance(times.sim_time_s))
    with scenario_errors(name):
        rendering = _look_time(scenario, result.status.looks)
    return Benchmark(
        result=times.failure or "success",
        placement_error=times.placement_error_m,
        simulated=times.sim_time_s,
        total=times.wall_time_s,
        plant=plant,
        planning=times.planning_wall_s,
        rendering=rendering,
        setup=elapsed - times.wall_time_s,
    )


def import_times() -> dict[str, float]:
    """Return the durations of processes that only import something, by import [s]."""
    programs = {
        "python without imports": "",
        "import drake_srg": "import drake_srg",
        "all imports of a run": _IMPORTS,
    }

    def run(code: str) -> Callable[[], object]:
        return lambda: subprocess.run([sys.executable, "-c", code], check=True)

    return {what: _timed(run(code)) for what, code in programs.items()}


def _look_time(scenario: Scenario, looks: int) -> float:
    """Return the wall-clock time of a number of looks by the planner [s].

    A look evaluates the blobs or, if the scenario clears its table, the height map of
    the table. Looks into the bins count as looks at the table.

    The first look takes longer, because each context sets up its own renderer. The
    setup of a process's first renderer is not included, because a run does that before
    its clock starts.
    """
    if looks == 0:
        return 0.0
    cell: Diagram = MakeCell(scenario)
    planner = cell.GetSubsystemByName("planner")
    port = planner.GetInputPort("height_map" if scenario.task.clear else "blobs")
    port.Eval(planner.GetMyContextFromRoot(cell.CreateDefaultContext()))
    root = cell.CreateDefaultContext()
    context = planner.GetMyContextFromRoot(root)
    times = []
    for i in range(4):
        root.SetTime(float(i))  # so that the camera renders anew
        times.append(_timed(lambda: port.Eval(context)))
    return times[0] + (looks - 1) * float(np.mean(times[1:]))


def _timed(action: Callable[[], object]) -> float:
    start = wall.perf_counter()
    action()
    return wall.perf_counter() - start


@dc.dataclass(frozen=True)
class Peer:
    """Speed of robosuite: a cycle of PickPlaceCan, and control steps of Lift.

    Attributes:
        version: Version of robosuite.
        success: Whether the can is in its bin.
        simulated: Simulated time of the cycle [s].
        total: Its wall-clock time [s].
        lift_steps_per_s: Control steps of Lift per second of wall-clock time.
    """

    version: str
    success: bool
    simulated: float
    total: float
    lift_steps_per_s: float

    def lines(self) -> list[str]:
        """Return the figures as lines of text."""
        result = "success" if self.success else "failure"
        return [
            f"robosuite {self.version}, IIWA",
            f"PickPlaceCan          {result}, {self.simulated:.2f} s simulated, "
            f"{self.total:.2f} s wall clock",
            f"Lift                  {self.lift_steps_per_s:.0f} control steps per s",
        ]


def measure_robosuite(python: Path) -> Peer:
    """Measure robosuite, after a first cycle that loads everything.

    Args:
        python: The Python interpreter of an environment with robosuite.

    Raises:
        ScenarioError: If the interpreter cannot run, or lacks robosuite.
    """
    # Run the text, because Python would look for a script's imports in its folder.
    script = Path(robosuite_cycle.__file__).read_text(encoding="utf-8")
    try:
        done = subprocess.run(
            [python, "-c", script], capture_output=True, text=True, check=True
        )
        return Peer(**json.loads(done.stdout.splitlines()[-1]))
    except subprocess.CalledProcessError as error:
        said = error.stderr.strip().splitlines() or [f"exit code {error.returncode}"]
        reason = said[-1]
    except (OSError, ValueError, TypeError, IndexError) as error:
        reason = str(error)
    raise ScenarioError(
        f"--peers {python}: must be the Python of an environment with robosuite "
        f"(see docs/speed.md): {reason}"
    )
