"""Benchmarks a scenario: its speed beside the bare plant's, and where time goes."""

import dataclasses as dc
import subprocess
import sys
import time as wall
from collections.abc import Callable, Mapping

import numpy as np
from pydrake.systems.framework import Diagram

from drake_srg.cell import MakeCell
from drake_srg.common.exceptions import scenario_errors
from drake_srg.scenario import Scenario, list_scenarios
from drake_srg.simulation.bare_plant import InputRecorder, MakeBarePlant
from drake_srg.simulation.simulate import Simulate, failure_time
from drake_srg.types import Failure

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
    """Measure a run of a scenario, its plant alone, and single looks.

    The bare plant gets the inputs recorded in a run; see `MakeBarePlant`.

    Args:
        scenario: The scenario to measure.
        name: Its name, for error messages.

    Raises:
        ScenarioError: If the models do not fit the scenario, or Drake aborts the run.
        KeyboardInterrupt: If the user stops the run.
    """
    recorder = InputRecorder(scenario, name)
    recorder.run_task()  # before the measured run, which then finds all imports loaded
    start = wall.perf_counter()
    result = Simulate(scenario, name=name)
    elapsed = wall.perf_counter() - start
    if result.status.failure is Failure.STOPPED:
        raise KeyboardInterrupt
    times = result.metrics
    recorder.advance(times.sim_time_s)  # while objects settle
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
    """Return how long processes take that only import, by what they import [s]."""
    programs = {
        "python without imports": "",
        "import drake_srg": "import drake_srg",
        "all imports of a run": _IMPORTS,
    }

    def run(code: str) -> Callable[[], object]:
        return lambda: subprocess.run([sys.executable, "-c", code], check=True)

    return {what: _timed(run(code)) for what, code in programs.items()}


def _look_time(scenario: Scenario, looks: int) -> float:
    """Return the wall-clock time of that many looks of the planner [s].

    A look is at the blobs or, if the scenario clears its table, at the height map of
    the table. Looks into the bins count as looks at the table.

    The first look costs more because each context sets up a renderer of its own. The
    setup of a process's very first renderer is excluded: a run does it before it starts
    its clock.
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
