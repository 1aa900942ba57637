"""The commands `drake-srg sweep`, `report` and `dataset`."""

import argparse
import dataclasses as dc
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli.command import (
    CELL,
    INTERRUPTED,
    SCENARIO,
    SUCCESS,
    all_of,
    argument,
    command,
    flag,
    name_of,
    resuming,
    warn,
    writing,
)
from drake_srg.cli.results import (
    DATASET,
    SWEEP,
    folder,
    new_folder,
    results_folder,
)
from drake_srg.common.exceptions import ScenarioError

if TYPE_CHECKING:
    from drake_srg.sweeps.engines import Engine

# Options that `make_engine` reads.
ENGINE = all_of(
    argument(
        "--jobs",
        type=int,
        metavar="N",
        help="number of trials that run at the same time (default: one per core)",
    ),
    argument(
        "--engine",
        choices=("joblib", "ray"),
        default="joblib",
        metavar="NAME",
        help="where trials run: joblib: in processes on this machine; ray: on a Ray "
        "cluster (default: %(default)s)",
    ),
    argument(
        "--address",
        metavar="ADDRESS",
        help="address of the Ray cluster (default: $RAY_ADDRESS; if it is not set, Ray "
        "starts on this machine)",
    ),
)


A_SWEEP = argument("folder", type=Path, metavar="DIR", help="folder of the sweep")


@command(
    "run many trials of a scenario, one row each",
    "Trial k is `drake-srg run SCENARIO --seed S+k`. Exit code: 0 once all trials "
    "have run, whatever their outcome; 2 bad input; 130 interrupted.",
    SCENARIO,
    CELL,
    argument("--trials", type=int, required=True, metavar="N", help="number of trials"),
    ENGINE,
    folder("the results", "out/sweeps/SCENARIO"),
    flag("--resume", "continue the sweep in DIR"),
    argument(
        "--record",
        choices=("none", "failures", "all"),
        default="none",
        metavar="WHICH",
        help="trials that keep video, rosbag and log: none, failures or all "
        "(default: %(default)s)",
    ),
)
def sweep(options: argparse.Namespace) -> int:
    """Run a sweep, and print its summary and the paths of its files.

    Returns:
        The exit code, which does not depend on the outcome of the trials.

    Raises:
        ScenarioError: For bad input, or if the folder cannot be written.
    """
    if options.trials < 1:
        raise ScenarioError(f"--trials {options.trials}: must be at least 1")
    engine = make_engine(options)
    from drake_srg.sweeps.rows import all_rows_path
    from drake_srg.sweeps.statistics import summary
    from drake_srg.sweeps.sweep import run_sweep

    out = resume = None

    def advise() -> str:
        begun = out is not None and (out / "sweep.json").exists()
        return f"finished trials are kept; to continue: {resume}" if begun else ""

    default = Path("out") / "sweeps" / name_of(options)
    try:
        with results_folder(options, default, SWEEP, advise) as out:
            resume = resuming(options, out)
            rows = run_sweep(
                options.scenario,
                options.trials,
                out=out,
                engine=engine,
                seed=options.seed,
                overrides=options.set,
                record=options.record,
                resume=options.resume,
                progress=options.console.progress,
                tell=warn,
                cell=options.cell,
            )
    except KeyboardInterrupt:
        options.console.complain(f"stopped; to continue: {resume}")
        return INTERRUPTED
    files = [all_rows_path(out), *filter(Path.exists, [out / "recordings"])]
    options.console.say(summary(rows), "", *files)
    succeeded = sum(rows["success"].to_pylist())
    options.console.answer(
        {"trials": rows.num_rows, "succeeded": succeeded, "files": files}
    )
    return SUCCESS


@command(
    "turn a sweep into an HTML page",
    "The page shows how often trials succeed, why they fail, and what both depend on.",
    A_SWEEP,
    argument(
        *("-o", "--out"),
        type=Path,
        metavar="FILE",
        help="the page (default: DIR/report.html)",
    ),
)
def report(options: argparse.Namespace) -> int:
    """Write the page of a sweep, and print its path; return the exit code.

    Raises:
        ScenarioError: If no trial has finished, or the page cannot be written.
    """
    from drake_srg.sweeps.report.write import write_report

    output: Path = options.out or options.folder / "report.html"
    with writing("-o", output):
        path = write_report(options.folder, output)
    options.console.say(path)
    options.console.answer({"report": path})
    return SUCCESS


@command(
    "turn a sweep's recordings into a LeRobot data set",
    "Each recorded trial becomes an episode: `drake-srg sweep ... --record all`.",
    A_SWEEP,
    folder("the data set", "DIR/dataset"),
    argument(
        "--fps",
        type=int,
        metavar="N",
        help="frames per second, a divisor of the image rate (default: every image)",
    ),
    flag("--only-success", "leave out trials that failed"),
)
def dataset(options: argparse.Namespace) -> int:
    """Make a data set from a sweep's recordings, and print its size and path.

    Returns:
        The exit code.

    Raises:
        ScenarioError: If no recordings fit, or the data set cannot be written.
    """
    from drake_srg.sweeps.rows import require_sweep

    require_sweep("pyarrow")
    from drake_srg.sweeps.dataset.make import make_dataset

    default = options.folder / "dataset"
    with (
        new_folder(options, default, DATASET) as output,
        writing("--out", output),
    ):
        made = make_dataset(
            options.folder,
            output,
            fps=options.fps,
            only_success=options.only_success,
            progress=options.console.progress,
        )
    options.console.say(
        f"{made.episodes} episodes ({made.successes} successful), {made.frames} frames "
        f"at {made.fps} per second"
    )
    if made.left_out:
        options.console.say(f"recorded trials left out: {made.left_out}")
    options.console.say(made.path)
    options.console.answer(dc.asdict(made))
    return SUCCESS


def make_engine(options: argparse.Namespace) -> "Engine":
    """Return the engine that the options choose.

    Raises:
        ScenarioError: If options exclude each other or a number is out of range.
        ImportError: If a package is missing.
    """
    if options.engine == "ray":
        if options.jobs is not None:
            raise ScenarioError(
                "--jobs: needs --engine joblib; Ray runs one trial per core"
            )
        from drake_srg.sweeps.engines import RayEngine

        return RayEngine(options.address)
    if options.address is not None:
        raise ScenarioError("--address: needs --engine ray")
    from drake_srg.sweeps.engines import JoblibEngine, usable_cores

    jobs = usable_cores() if options.jobs is None else options.jobs
    if jobs < 1:
        raise ScenarioError(f"--jobs {jobs}: must be at least 1")
    return JoblibEngine(jobs)
