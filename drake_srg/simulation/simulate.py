"""Runs a scenario to its end, logs and records the run, and judges the result."""

import contextlib
import dataclasses as dc
import sys
import time as wall
from collections.abc import Callable, Iterator
from pathlib import Path

from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Diagram
from tqdm import tqdm

from drake_srg.cell import AddCell, MakeCell
from drake_srg.common.exceptions import ScenarioError, one_line, scenario_errors
from drake_srg.lifetime import my_context
from drake_srg.recording.output import output_folder
from drake_srg.replay import ReplayRecorder, write_page
from drake_srg.scenario import Scenario
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.metrics import Metrics, RunTimes, calc_metrics
from drake_srg.simulation.recorders import FILES, AddRecorders, write_samples
from drake_srg.simulation.run_log import RunLog
from drake_srg.simulation.sleeping import MakeAdvance
from drake_srg.types import Failure, Mode, PlannerStatus, Vector

# A run continues for this time after the planner has ended, to let objects settle [s].
_SETTLE = 0.5


@dc.dataclass(frozen=True)
class Result:
    """The result of a run."""

    metrics: Metrics
    log: dict[str, Vector]  # arrays with one row per sample; see `Simulate`
    status: PlannerStatus


def Simulate(
    scenario: Scenario,
    *,
    name: str = "scenario",
    out: Path | None = None,
    record: bool = True,
    make_cell: Callable[[Scenario], Diagram] = MakeCell,
    progress: bool = False,
) -> Result:
    """Simulate a cell until its planner has ended, and judge the result.

    The log is sampled every `recording.period`. Its arrays are `time` (K) [s], `mode`
    (K), the index into `Mode`, the cell's vector ports by name, `object_pose.NAME`
    (K, 7), position [m] before quaternion w, x, y, z, and `contact_force` (K), the
    largest force of the gripper on the picked object [N].

    A KeyboardInterrupt ends the run as `stopped`; the run is judged and recorded up to
    that time. After any other exception, log and recordings up to that time remain, but
    there is no metrics.json.

    Args:
        scenario: The scenario to simulate.
        name: The scenario's name, for metrics.json and error messages.
        out: Folder for metrics.json, log.npz and the recordings; None writes nothing.
        record: Whether to write video, rosbag, timeline and replay too.
        make_cell: Builds the cell: any diagram with the ports of `MakeCell`'s. It needs
            `planner.mode`, `planner.status`, `arm.state_measured` and the ports that
            end in `_cheat`. Of the other ports, those that exist are logged and
            recorded.
        progress: Whether to show a progress bar.

    Raises:
        ScenarioError: If the models do not fit the scenario, or Drake aborts the run.
        OSError: If `out` cannot be written.
    """
    artifacts: dict[str, str | None] = dict.fromkeys(FILES)
    recorded = record and out is not None
    own = make_cell is not MakeCell
    built = scenario if own else _without_unused_cameras(scenario, recorded)
    with contextlib.ExitStack() as stack:
        add = None if own else AddCell
        builder, cell = MakeRoot("cell", make_cell, add, built, name)
        with scenario_errors(name):
            # Fails now if the folder cannot be written, not after the run.
            stack.enter_context(output_folder(out))
            if out is not None and recorded:
                added = AddRecorders(builder, cell, scenario, out)
                for kind, recorder in added.items():
                    stack.enter_context(recorder)
                    artifacts[kind] = str(recorder.path)
            diagram = builder.Build()
            diagram.set_name("simulation")
            simulator = Simulator(diagram)
            ApplySimulatorConfig(scenario.simulator_config, simulator)
        if out is not None:  # remove the files of earlier runs
            for file in (*FILES.values(), "metrics.json"):
                (out / file).unlink(missing_ok=True)
        _warm_up(simulator, cell)
        log = RunLog(scenario, cell)
        replay = None
        if recorded:
            cameras = scenario.localizer.cameras
            replay = ReplayRecorder(diagram, cell, scenario.objects, cameras)

        def sample() -> None:
            log.sample(my_context(cell, simulator.get_context()))
            if replay is not None:
                replay.sample(simulator.get_context())

        def write() -> dict[str, str]:
            if out is None or not log:
                return {}
            return write_samples(name, log.arrays(), scenario, out, replay)

        def write_all() -> None:
            if "replay_glb" in write() and out is not None:
                write_page(out)

        with _written_on_error(write_all):
            status, times = _run(simulator, cell, scenario, name, sample, progress)
    artifacts |= write()
    if out is not None and recorded:
        artifacts["replay"] = str(out / FILES["replay"])
    arrays = log.arrays()
    metrics = calc_metrics(
        scenario, name, arrays, status, log.touching, times, artifacts
    )
    if out is not None:
        metrics.write(out / "metrics.json")
        if recorded:
            write_page(out)  # last: it shows the other files
    return Result(metrics, arrays, status)


@contextlib.contextmanager
def failure_time(name: str, simulator: Simulator) -> Iterator[None]:
    """Turn Drake's exceptions during a step into ScenarioErrors that tell the time."""
    try:
        yield
    except (RuntimeError, SystemExit) as error:
        time = simulator.get_context().get_time()
        raise ScenarioError(
            f"{name}: the simulation failed at t = {time:.3f} s: {one_line(error)}"
        ) from error


@contextlib.contextmanager
def _written_on_error(write: Callable[[], object]) -> Iterator[None]:
    """Write the log so far if an exception is raised."""
    try:
        yield
    except Exception:
        # The first exception is the one to report: a full disk raises here as well.
        with contextlib.suppress(Exception):
            write()
        raise


def _without_unused_cameras(scenario: Scenario, recorded: bool) -> Scenario:
    """Return the scenario with only those cameras that are used, to save time."""
    used = set(scenario.localizer.cameras)
    if recorded:
        used |= {scenario.recording.video_camera, *scenario.recording.bag_cameras}
    seen = {name: c for name, c in scenario.cameras.items() if name in used}
    return dc.replace(scenario, cameras=seen)


def _warm_up(simulator: Simulator, cell: Diagram) -> None:
    """Let cameras and localizer set themselves up, so that no run includes the time."""
    root = simulator.get_mutable_context()
    for name in ("localizer.blobs", "height_mapper.height_map"):
        if cell.HasOutputPort(name):
            cell.GetOutputPort(name).Eval(my_context(cell, root))
    root.SetTime(root.get_time())  # so that the first image of the run is rendered anew


def _run(
    simulator: Simulator,
    cell: Diagram,
    scenario: Scenario,
    name: str,
    sample: Callable[[], None],
    progress: bool,
) -> tuple[PlannerStatus, RunTimes]:
    """Advance until the planner has ended and the objects have settled."""
    root = simulator.get_mutable_context()
    context = my_context(cell, root)
    advance = MakeAdvance(simulator, cell, scenario)
    status_port = cell.GetOutputPort("planner.status")
    start_time = root.get_time()
    # Planners end by themselves. The margin is for a planner that does not.
    budget = scenario.task.repeat * scenario.planner.time_budget
    limit = start_time + budget + 1.0
    end = limit
    start = wall.perf_counter()
    with failure_time(name, simulator):
        simulator.Initialize()
    sample()
    status, step = PlannerStatus(), 0
    try:
        with tqdm(
            total=budget,
            disable=not progress,
            file=sys.stderr,
            bar_format="{n:6.2f} s simulated  {desc} [{elapsed} elapsed]",
        ) as bar:
            while root.get_time() < end - 1e-9:
                step += 1
                time = min(start_time + step * scenario.recording.period, end)
                with failure_time(name, simulator):
                    advance(time)
                sample()
                status = status_port.Eval(context)
                if status.mode in (Mode.DONE, Mode.FAILED) and end == limit:
                    end = min(limit, time + _SETTLE)
                bar.set_description_str(f"{status.mode.value:10}", refresh=False)
                bar.update(scenario.recording.period)
    except KeyboardInterrupt:
        status = dc.replace(
            status,
            mode=Mode.FAILED,
            failure=Failure.STOPPED,
            message="stopped by the user",
        )
    elapsed = wall.perf_counter() - start
    return status, RunTimes(root.get_time() - start_time, elapsed)
