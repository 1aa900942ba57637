"""The command `drake-srg sweep`, and those that make something of a sweep."""

import argparse
import contextlib
import os
import shlex
import signal
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.common.errors import ScenarioError, one_line

if TYPE_CHECKING:
    from drake_srg.sweeps.engines import Engine

INTERRUPTED = 130  # as shells say it of Ctrl-C


def end_on_sigterm() -> None:
    """Let a request to terminate end what runs as Ctrl-C does."""
    if threading.current_thread() is threading.main_thread():  # Python's own limit
        signal.signal(signal.SIGTERM, signal.default_int_handler)


def add_sweep_arguments(sweep: argparse.ArgumentParser) -> None:
    """Add what the command sweep takes, besides the scenario."""
    sweep.add_argument(
        "--trials", type=int, required=True, metavar="N", help="how many"
    )
    sweep.add_argument(
        "--jobs",
        type=int,
        metavar="J",
        help="trials at a time, a process each (default: the machine's cores)",
    )
    sweep.add_argument(
        "--engine",
        choices=("joblib", "ray"),
        default="joblib",
        help="processes of this machine, or a Ray cluster (default: %(default)s)",
    )
    sweep.add_argument(
        "--address",
        metavar="A",
        help="of the Ray cluster (default: $RAY_ADDRESS; without, this machine)",
    )
    sweep.add_argument(
        "--out", type=Path, metavar="DIR", help="results (default: out/sweeps/SCENARIO)"
    )
    sweep.add_argument(
        "--resume", action="store_true", help="go on with the sweep in DIR"
    )
    sweep.add_argument(
        "--record",
        choices=("none", "failures", "all"),
        default="none",
        help="trials whose video, rosbag and log are kept (default: %(default)s)",
    )


def sweep(options: argparse.Namespace) -> int:
    """Run a sweep to its end, whatever comes of its trials; returns the exit code.

    Raises:
        ScenarioError: For bad input, or where the folder cannot be written.
    """
    out: Path = options.out or Path("out") / "sweeps" / Path(options.scenario).stem
    if options.trials < 1:
        raise ScenarioError(f"--trials {options.trials}: must be at least 1")
    engine = _engine(options)
    from drake_srg.sweeps.rows import all_rows_path
    from drake_srg.sweeps.summary import summary
    from drake_srg.sweeps.sweep import run_sweep

    end_on_sigterm()
    again = _resume_line(options, out)
    try:
        rows = run_sweep(
            options.scenario,
            options.trials,
            out=out,
            engine=engine,
            seed=options.seed,
            overrides=options.set,
            record=options.record,
            resume=options.resume,
            progress=sys.stderr.isatty(),
            tell=_warn,
        )
    except KeyboardInterrupt:
        print(f"drake-srg: stopped; to go on: {again}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        raise
    except OSError as error:
        reason = error.strerror or one_line(error)
        raise ScenarioError(
            f"--out {out}: cannot be written: {reason}; what is done stays; to go on: "
            f"{again}"
        ) from error
    print(summary(rows))
    print()
    print(all_rows_path(out))
    recordings = out / "recordings"
    if recordings.exists():
        print(recordings)
    return 0


def _add_folders(parser: argparse.ArgumentParser, metavar: str, help: str) -> None:
    """Add the sweep's folder, and where what is made of it goes."""
    parser.add_argument(
        "folder", type=Path, metavar="DIR", help="of the sweep, its --out"
    )
    parser.add_argument("-o", "--output", type=Path, metavar=metavar, help=help)


def add_report_arguments(report: argparse.ArgumentParser) -> None:
    """Add what the command report takes."""
    _add_folders(report, "FILE.html", "the page (default: DIR/report.html)")


def report(options: argparse.Namespace) -> int:
    """Write the page of a sweep; returns the exit code.

    Raises:
        ScenarioError: If there is nothing to tell, or the page cannot be written.
    """
    from drake_srg.sweeps.report.write import write_report

    output: Path = options.output or options.folder / "report.html"
    try:
        path = write_report(options.folder, output)
    except OSError as error:
        reason = error.strerror and f"-o {output}: cannot be written: {error.strerror}"
        raise ScenarioError(reason or str(error)) from error
    print(path)
    return 0


def add_dataset_arguments(dataset: argparse.ArgumentParser) -> None:
    """Add what the command dataset takes."""
    _add_folders(dataset, "FOLDER", "the data set (default: DIR/dataset)")
    dataset.add_argument(
        "--fps",
        type=int,
        metavar="F",
        help="frames per second, a divisor of the images' (default: all images)",
    )
    dataset.add_argument(
        "--only-success", action="store_true", help="leave out trials that failed"
    )


def dataset(options: argparse.Namespace) -> int:
    """Make a data set of a sweep's recordings; returns the exit code.

    Raises:
        ScenarioError: If there are no recordings that fit, or nothing can be written.
    """
    from drake_srg.sweeps.rows import require_sweep

    require_sweep("pyarrow")
    from drake_srg.sweeps.dataset.make import make_dataset

    end_on_sigterm()
    output: Path = options.output or options.folder / "dataset"
    try:
        made = make_dataset(
            options.folder,
            output,
            fps=options.fps,
            only_success=options.only_success,
            progress=sys.stderr.isatty(),
        )
    except OSError as error:
        # PyArrow's messages are long ones.
        reason = os.strerror(error.errno) if error.errno else one_line(error)
        raise ScenarioError(f"-o {output}: cannot be written: {reason}") from error
    print(
        f"{made.episodes} episodes ({made.successes} successful), {made.frames} frames "
        f"at {made.fps} per second"
    )
    if made.left_out:
        print(f"left out, of the recorded trials: {made.left_out}")
    print(made.path)
    return 0


def _engine(options: argparse.Namespace) -> "Engine":
    if options.engine == "ray":
        if options.jobs is not None:
            raise ScenarioError("--jobs: goes with the engine joblib; Ray has its own")
        from drake_srg.sweeps.ray_engine import RayEngine

        return RayEngine(options.address)
    if options.address is not None:
        raise ScenarioError("--address: needs --engine ray")
    from drake_srg.sweeps.engines import JoblibEngine, usable_cores

    jobs = usable_cores() if options.jobs is None else options.jobs
    if jobs < 1:
        raise ScenarioError(f"--jobs {jobs}: must be at least 1")
    return JoblibEngine(jobs)


def _resume_line(options: argparse.Namespace, out: Path) -> str:
    """The command that goes on with what this one began."""
    words = ["drake-srg", "sweep", options.scenario, "--trials", str(options.trials)]
    if options.seed is not None:
        words += ["--seed", str(options.seed)]
    for override in options.set:
        words += ["--set", override]
    if options.engine == "ray":
        words += ["--engine", "ray"]
        words += ["--address", options.address] if options.address else []
    elif options.jobs is not None:
        words += ["--jobs", str(options.jobs)]
    if options.record != "none":
        words += ["--record", options.record]
    return shlex.join([*words, "--out", str(out), "--resume"])


def _warn(text: str) -> None:
    with contextlib.suppress(OSError):  # nobody reads it
        print(f"drake-srg: warning: {text}", file=sys.stderr, flush=True)
