"""Runs a scenario to its end, with log, recordings and metrics."""

import contextlib
import dataclasses as dc
import sys
import time as wall
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Context, Diagram, PortDataType
from tqdm import tqdm

from drake_srg.cell import AddCell, MakeCell
from drake_srg.common.exceptions import ScenarioError, one_line, scenario_errors
from drake_srg.common.ports import output_ports
from drake_srg.lifetime import my_context
from drake_srg.objects.contact_reader import ContactReader
from drake_srg.recording.output import output_folder
from drake_srg.scenario import Scenario
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.metrics import (
    MODES,
    Metrics,
    RunTimes,
    calc_metrics,
    pose_to_row,
)
from drake_srg.simulation.recorders import FILES, AddRecorders, write_samples
from drake_srg.types import Failure, Mode, PlannerStatus, Vector

# How long a run goes on after the planner has ended, for things to settle [s].
_SETTLE = 0.5

_LOGGED = (
    "arm.state_measured",
    "arm.state_cheat",
    "arm.torque_measured",
    "arm.external_torque",
    "arm.position_commanded",
    "gripper.state_measured",
    "gripper.closure_commanded",
    "gripper.pwm",
    "gripper.proximity",
    "gripper.grasped",
)
# Other vector ports of a gripper are logged, too, such as those of a finger sensor of
# your own, except these: a rig's log has them.
_NOT_LOGGED = (
    "gripper.contact_force",
    "gripper.contact_wrench",
    "gripper.motor_state",
    "gripper.wire_force",
    "gripper.motor_temperature",
)


@dc.dataclass(frozen=True)
class Result:
    """What came of a run."""

    metrics: Metrics
    log: dict[str, Vector]  # arrays with one row a sample; see `Simulate`
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

    The log has the arrays `time` (K), `mode` (K, index into `Mode`), the vector ports
    of the cell by their names, `object_pose.NAME` (K, 7: position, then quaternion w,
    x, y, z) and `contact_force` (K, the largest force of the gripper on the picked
    object), sampled every `recording.period`.

    On a KeyboardInterrupt the run ends as `stopped`, judged and recorded up to there.
    An error leaves log and recordings up to there, too, but no metrics.json.

    Args:
        scenario: What to simulate.
        name: Its name, for metrics.json.
        out: Folder for metrics.json, log.npz and the recordings; None writes nothing.
        record: Whether to write video, rosbag and timeline, too.
        make_cell: Builds the cell: any diagram with the ports of `MakeCell`'s. Those
            that the planner's outcome and the object's fate are read from are needed
            (`planner.mode`, `planner.status`, `arm.state_measured` and those that end
            in `_cheat`); of the others, those that exist are logged and recorded.
        progress: Whether to show a progress bar.

    Raises:
        ScenarioError: If the models do not fit the scenario, or Drake gives up on it
            in the middle of the run.
        OSError: If `out` cannot be written.
    """
    artifacts: dict[str, str | None] = dict.fromkeys(FILES)
    whole = make_cell is not MakeCell
    built = scenario if whole else _with_eyes_only(scenario, record and out is not None)
    with contextlib.ExitStack() as stack:
        add = AddCell if make_cell is MakeCell else None
        builder, cell = MakeRoot("cell", make_cell, add, built, name)
        with scenario_errors(name):
            # Better now than after the run.
            stack.enter_context(output_folder(out))
            if out is not None and record:
                added = AddRecorders(builder, cell, scenario, out)
                for kind, recorder in added.items():
                    stack.enter_context(recorder)
                    artifacts[kind] = str(recorder.path)
            diagram = builder.Build()
            diagram.set_name("simulation")
            simulator = Simulator(diagram)
            ApplySimulatorConfig(scenario.simulator_config, simulator)
        if out is not None:  # what is there afterwards is of this run
            for file in (*FILES.values(), "metrics.json"):
                (out / file).unlink(missing_ok=True)
        _warm_up(simulator, cell)
        log = _Log(scenario, cell)

        def write() -> dict[str, str]:
            if out is None or not log:
                return {}
            return write_samples(name, log.arrays(), scenario, out, record)

        with _before_an_error_goes_on(write):
            status, times = _run(simulator, cell, scenario, name, log, progress)
    artifacts |= write()
    arrays = log.arrays()
    metrics = calc_metrics(
        scenario, name, arrays, status, log.touching, times, artifacts
    )
    if out is not None:
        metrics.write(out / "metrics.json")
    return Result(metrics, arrays, status)


@contextlib.contextmanager
def failure_time(name: str, simulator: Simulator) -> Iterator[None]:
    """Make a ScenarioError, which says when, of what Drake raises in a step."""
    try:
        yield
    except (RuntimeError, SystemExit) as error:
        time = simulator.get_context().get_time()
        raise ScenarioError(
            f"{name}: the simulation failed at t = {time:.3f} s: {one_line(error)}"
        ) from error


@contextlib.contextmanager
def _before_an_error_goes_on(write: Callable[[], object]) -> Iterator[None]:
    """Write what there is when an error comes up."""
    try:
        yield
    except Exception:
        # The error that came first is told: a full disk has both.
        with contextlib.suppress(Exception):
            write()
        raise


def _with_eyes_only(scenario: Scenario, recorded: bool) -> Scenario:
    """The scenario without cameras that nobody looks through: each is to be built."""
    used = set(scenario.localizer.cameras)
    if recorded:
        used |= {scenario.recording.video_camera, *scenario.recording.bag_cameras}
    seen = {name: c for name, c in scenario.cameras.items() if name in used}
    return dc.replace(scenario, cameras=seen)


def _warm_up(simulator: Simulator, cell: Diagram) -> None:
    """Let cameras and localizer prepare themselves, as they do when switched on."""
    root = simulator.get_mutable_context()
    if cell.HasOutputPort("localizer.blobs"):
        cell.GetOutputPort("localizer.blobs").Eval(my_context(cell, root))
        root.SetTime(root.get_time())  # what was seen before counts no more


def _run(
    simulator: Simulator,
    cell: Diagram,
    scenario: Scenario,
    name: str,
    log: "_Log",
    progress: bool,
) -> tuple[PlannerStatus, RunTimes]:
    """Advance until the planner has ended and things have settled."""
    root = simulator.get_mutable_context()
    context = my_context(cell, root)
    status_port = cell.GetOutputPort("planner.status")
    start_time = root.get_time()
    # The planner ends by itself; the margin is for a planner that does not.
    budget = scenario.task.repeat * scenario.planner.time_budget
    limit = start_time + budget + 1.0
    end = limit
    start = wall.perf_counter()
    with failure_time(name, simulator):
        simulator.Initialize()
    log.sample(context)
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
                    simulator.AdvanceTo(time)
                log.sample(context)
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


class _Log:
    """Samples of the cell's ports."""

    def __init__(self, scenario: Scenario, cell: Diagram) -> None:
        ports = output_ports(cell)
        others = [
            name
            for name, port in ports.items()
            if name.startswith("gripper.")
            and name not in (*_LOGGED, *_NOT_LOGGED)
            and port.get_data_type() == PortDataType.kVectorValued
        ]
        names = [name for name in _LOGGED if name in ports] + others
        self._ports = {name: ports[name] for name in names}
        self._mode = cell.GetOutputPort("planner.mode")
        self._poses = cell.GetOutputPort("object_poses_cheat")
        self._contacts = cell.GetOutputPort("contact_results_cheat")
        self._pick = scenario.task.pick
        self._reader: ContactReader | None = None
        self._present = scenario.objects[self._pick].present
        self._rows: list[dict[str, Vector | float]] = []
        self.touching: set[str] = set()

    def __len__(self) -> int:
        return len(self._rows)

    def sample(self, context: Context) -> None:
        """Add a row, whole or, where this is interrupted, not at all."""
        row: dict[str, Vector | float] = {
            "time": context.get_time(),
            "mode": float(MODES.index(self._mode.Eval(context))),
        }
        for name, port in self._ports.items():
            row[name] = np.array(port.Eval(context))
        for name, X_WO in self._poses.Eval(context).items():
            row[f"object_pose.{name}"] = pose_to_row(X_WO)
        forces = {}
        if self._present:
            contacts = self._contacts.Eval(context)
            if self._reader is None:
                self._reader = ContactReader(contacts.plant(), self._pick)
            forces = self._reader.forces(contacts)
        row["contact_force"] = forces.get("gripper", 0.0)
        self.touching = set(forces)
        self._rows.append(row)

    def arrays(self) -> dict[str, Vector]:
        """Return what was sampled, one array a quantity, one row a sample."""
        return {
            name: np.array([row[name] for row in self._rows]) for name in self._rows[0]
        }
