"""Runs: a scenario simulated to its end, logged, recorded and judged."""

import contextlib
import dataclasses as dc
import functools
import sys
import time as wall
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, System

from drake_srg.common.exceptions import ScenarioError, one_line, scenario_errors
from drake_srg.common.status_line import StatusLine
from drake_srg.common.systems import MakeSimulator
from drake_srg.lifetime import my_context
from drake_srg.planning.planner_machine import planning_clock
from drake_srg.recording.output import Recorder, output_folder, verdict
from drake_srg.recording.recording import FILES, Recording
from drake_srg.recording.replay import write_page
from drake_srg.recording.video import CaptionedRecorder
from drake_srg.scenario import Scenario, perception_cameras, servo_of
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.metrics import Metrics, RunTimes, calc_metrics
from drake_srg.simulation.recorders import AddRecorders
from drake_srg.simulation.run_log import Samples
from drake_srg.station import AddCell, MakeCell
from drake_srg.station.perception import needs_labels
from drake_srg.station.sleeping import MakeAdvance
from drake_srg.station.video_process import VideoProcess, can_render_apart
from drake_srg.types import Failure, Mode, PlannerStatus, Vector, mode_words

# Experiments differ in how and how deep they call `Simulate`. A parameter would have to
# go through the signature of every trial function between the runner and there, only
# for a by-product. The variable belongs to one context (PEP 567): it does not reach
# workers or other threads, and ends with the `with` block.
_folder: ContextVar[Path | None] = ContextVar("folder", default=None)


@contextlib.contextmanager
def keep_first_replay(folder: Path | None) -> Iterator[None]:
    """Make the first `Simulate` without `out` write its replay and log to a folder.

    Args:
        folder: The folder; None: keep none.
    """
    token = _folder.set(folder)
    try:
        yield
    finally:
        _folder.reset(token)


def take_replay_folder() -> Path | None:
    """Return the folder for this run's replay, and None from then on."""
    folder = _folder.get()
    _folder.set(None)
    return folder


# A run continues for this time after the planner has ended, to let objects settle, and
# up to the greatest time while objects that are to be cleared still move [s].
_SETTLE, _MOST_SETTLE = 0.5, 5.0
STOPPED_BY_USER = "stopped by the user"  # the message of a run that was interrupted


@dc.dataclass(frozen=True)
class Result:
    """The result of a run."""

    metrics: Metrics
    log: dict[str, Vector]  # arrays with one row per sample; see `Simulate`
    status: PlannerStatus


def _warn(text: str) -> None:
    print(f"drake-srg: warning: {text}", file=sys.stderr)


def Simulate(
    scenario: Scenario,
    *,
    name: str = "scenario",
    out: Path | None = None,
    record: bool = True,
    make_cell: Callable[[Scenario], Diagram] = MakeCell,
    make_planner: Callable[[Scenario], System] | None = None,
    progress: bool = False,
    video_process: bool = True,
    warm_up: bool = True,
    tell: Callable[[str], None] = _warn,
) -> Result:
    """Simulate a cell until its planner has ended, and judge the result.

    The log is sampled every `recording.period`. Its arrays are `time` (K) [s], `mode`
    (K), the index into `Mode`, `mode_name` (K) of a planner with modes of its own, the
    cell's vector ports by name, `object_pose.NAME` (K, 7), position [m] before
    quaternion w, x, y, z, and `contact_force` (K), the largest force of the gripper on
    a picked object [N].

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
        make_planner: Makes a planner for our own cell; see `MakeCell`.
        progress: Whether to show progress on standard error.
        video_process: Whether a process of its own renders the video of our own cells
            while the simulation goes on. It pays unless all cores are busy.
        warm_up: Whether to render one unused image first, so that metrics do not count
            the time in which cameras set themselves up.
        tell: Receives warnings, one line each.

    Raises:
        ScenarioError: If the models do not fit the scenario, or Drake aborts the run.
        OSError: If `out` cannot be written.
    """
    recorded = record and out is not None
    kept = take_replay_folder() if out is None else None
    own = make_cell is not MakeCell
    built = scenario if own else _without_unused_cameras(scenario, recorded)
    with contextlib.ExitStack() as stack:
        process = None
        with scenario_errors(name):
            # Fails now if the folder cannot be written, not after the run.
            stack.enter_context(output_folder(out))
            if recorded and video_process and not own and can_render_apart(scenario):
                process = stack.enter_context(VideoProcess(scenario, tell))
        make, add = make_cell, None
        if not own:
            make = functools.partial(MakeCell, make_planner=make_planner)
            add = functools.partial(AddCell, make_planner=make_planner)
        builder, cell = MakeRoot("cell", make, add, built, name)
        recording = stack.enter_context(Recording(out))
        with scenario_errors(name):
            recorders: dict[str, Recorder] = {}
            if out is not None and recorded:
                recorders = AddRecorders(builder, cell, scenario, out, process)
                recording.record(recorders)
            diagram = builder.Build()
            diagram.set_name("simulation")
            simulator = MakeSimulator(diagram, scenario.simulator_config)
        recording.begin()
        replayed = recorded or kept is not None
        if warm_up:
            _warm_up(simulator, cell, built, own or replayed or _needs_color(scenario))
        samples = Samples(name, scenario, diagram, cell, replayed)
        recording.write_samples = samples.write
        status, times = _run(simulator, cell, scenario, name, samples, progress)
        arrays = samples.log.arrays()
        touching = samples.log.touching
        metrics = calc_metrics(scenario, name, arrays, status, touching, times, {})
        video = recorders.get("video")
        if isinstance(video, CaptionedRecorder):
            video.judge(metrics.success, verdict(vars(metrics)))
        with StatusLine(shown=progress and recorded) as line:
            line.show(f"{name}: completing video and replay", last=True)
        written = recording.complete()
        if out is not None and recorded:
            written["replay"] = str(out / FILES["replay"])
        if kept is not None:
            samples.write(kept)
            write_page(kept)
        metrics.artifacts = {kind: written.get(kind) for kind in FILES}
        if out is not None:
            metrics.write(out / "metrics.json")  # which the page shows
    return Result(metrics, arrays, status)


@contextlib.contextmanager
def failure_time(name: str, simulator: Simulator) -> Iterator[None]:
    """Turn Drake's exceptions during a step into ScenarioErrors with the time."""
    try:
        yield
    except (RuntimeError, SystemExit) as error:
        time = simulator.get_context().get_time()
        raise ScenarioError(
            f"{name}: the simulation failed at t = {time:.3f} s: {one_line(error)}"
        ) from error


def _without_unused_cameras(scenario: Scenario, recorded: bool) -> Scenario:
    """Return the scenario without unused cameras, to save time."""
    used = set(perception_cameras(scenario))
    servo = servo_of(scenario)
    if servo is not None:
        used.add(servo.camera)
    if recorded:
        config = scenario.recording
        used |= {config.video_camera, config.inset_camera, *config.bag_cameras}
    seen = {name: c for name, c in scenario.cameras.items() if name in used}
    return dc.replace(scenario, cameras=seen)


def _needs_color(scenario: Scenario) -> bool:
    """Return whether the planner of our own cell needs colour images."""
    return scenario.task.clear is None or needs_labels(scenario)


def _warm_up(
    simulator: Simulator, cell: Diagram, scenario: Scenario, color: bool
) -> None:
    """Render once, so that no run includes the cameras' setup time."""
    root = simulator.get_mutable_context()
    images = ["color_image", "depth_image"] if color else ["depth_image"]
    for camera in perception_cameras(scenario):
        for image in images:
            name = f"camera_{camera}.{image}"
            if cell.HasOutputPort(name):
                cell.GetOutputPort(name).Eval(my_context(cell, root))
    root.SetTime(root.get_time())  # so that the first image of the run is rendered anew


def _run(
    simulator: Simulator,
    cell: Diagram,
    scenario: Scenario,
    name: str,
    samples: Samples,
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
    start, planned = wall.perf_counter(), planning_clock()
    with failure_time(name, simulator):
        simulator.Initialize()
    samples.add(root)
    status, step = PlannerStatus(), 0
    latest: float | None = None  # until when objects may settle [s]; None: no end yet
    try:
        with StatusLine(shown=progress) as line:
            while root.get_time() < end - 1e-9:
                step += 1
                time = min(start_time + step * scenario.recording.period, end)
                with failure_time(name, simulator):
                    advance(time)
                samples.add(root)
                status = status_port.Eval(context)
                if latest is None:
                    if status.ended:
                        end = min(limit, time + _SETTLE)
                        latest = time + _MOST_SETTLE
                elif end - 1e-9 <= time < latest and samples.log.clearing_moves:
                    end = time + scenario.recording.period
                mode = mode_words(status.mode)
                line.show(f"{name}: {time:6.2f} s simulated, {mode}", last=time == end)
    except KeyboardInterrupt:
        status = dc.replace(
            status,
            mode=Mode.FAILED,
            failure=Failure.STOPPED,
            message=STOPPED_BY_USER,
        )
    elapsed = wall.perf_counter() - start
    planning = planning_clock() - planned
    return status, RunTimes(root.get_time() - start_time, elapsed, planning)
