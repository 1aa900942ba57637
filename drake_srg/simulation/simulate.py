"""Runs of a scenario: simulated to the end, logged, recorded and judged."""

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

# Folder of `keep_first_replay`. A parameter would have to go through every function
# between an experiment's runner and its call of `Simulate`, only for a by-product. A
# context variable (PEP 567) does not reach workers or other threads, and it is reset at
# the end of the `with` block.
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
    """Return the folder of `keep_first_replay`; later calls return None."""
    folder = _folder.get()
    _folder.set(None)
    return folder


# A run continues for `_SETTLE` after the planner has ended, so that objects settle, and
# for up to `_MOST_SETTLE` while objects that are to be cleared still move [s].
_SETTLE, _MOST_SETTLE = 0.5, 5.0
STOPPED_BY_USER = "stopped by the user"  # message of an interrupted run


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

    The log is sampled every `recording.period`. Its arrays are `time` (K) [s]; `mode`
    (K), an index into `Mode`; `mode_name` (K), if the planner has modes of its own; the
    cell's vector ports by name; `object_pose.NAME` (K, 7), position [m] and quaternion
    w, x, y, z; and `contact_force` (K), the largest force of the gripper on a picked
    object [N].

    A KeyboardInterrupt ends the run as `stopped`; the run is judged and recorded up to
    that time. After any other exception, there are log and recordings up to that time,
    but no metrics.json.

    Args:
        scenario: The scenario to simulate.
        name: The scenario's name, for metrics.json and error messages.
        out: Folder for metrics.json, log.npz and the recordings; None writes nothing.
        record: Whether to write video, rosbag, timeline and replay, too.
        make_cell: Builds the cell: a diagram with ports like those of `MakeCell`. It
            needs `planner.mode`, `planner.status`, `arm.state_measured` and the ports
            whose names end in `_cheat`. Other ports are logged and recorded if they
            exist.
        make_planner: Makes the planner of the default cell; see `MakeCell`.
        progress: Whether to show progress on standard error.
        video_process: Whether a separate process renders the video of the default cell
            during the simulation. This saves time unless all cores are busy.
        warm_up: Whether to render one unused image first, so that metrics do not
            include the setup of the cameras.
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
            metrics.write(out / "metrics.json")  # before the page, which shows it
    return Result(metrics, arrays, status)


@contextlib.contextmanager
def failure_time(name: str, simulator: Simulator) -> Iterator[None]:
    """Turn Drake's exceptions into ScenarioErrors that name the simulated time."""
    try:
        yield
    except (RuntimeError, SystemExit) as error:
        time = simulator.get_context().get_time()
        raise ScenarioError(
            f"{name}: the simulation failed at t = {time:.3f} s: {one_line(error)}"
        ) from error


def _without_unused_cameras(scenario: Scenario, recorded: bool) -> Scenario:
    """Return the scenario without unused cameras, which would take time."""
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
    """Return whether the planner of the default cell needs colour images."""
    return scenario.task.clear is None or needs_labels(scenario)


def _warm_up(
    simulator: Simulator, cell: Diagram, scenario: Scenario, color: bool
) -> None:
    """Render once, so that the run does not include the setup of the cameras."""
    root = simulator.get_mutable_context()
    images = ["color_image", "depth_image"] if color else ["depth_image"]
    for camera in perception_cameras(scenario):
        for image in images:
            name = f"camera_{camera}.{image}"
            if cell.HasOutputPort(name):
                cell.GetOutputPort(name).Eval(my_context(cell, root))
    root.SetTime(root.get_time())  # discards the image: the run renders it anew


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
    latest: float | None = None  # time limit for settling [s]; None: not settling yet
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
