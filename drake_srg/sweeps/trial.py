"""One trial of a sweep, with the same outcome in any process."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import functools
import gc
import os
import shutil
import socket
import tempfile
import time as wall
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from drake_srg.common.exceptions import one_line
from drake_srg.lifetime import free_diagrams
from drake_srg.scenario import draw_scenario
from drake_srg.simulation import Result, Simulate
from drake_srg.station.cell import load_make_cell
from drake_srg.sweeps.rows import TIMING_COLUMNS, metric_columns

# `failure` of a trial that raised an error; the error is in `message`.
ERROR = "error"


@dc.dataclass(frozen=True)
class TrialResult:
    """The result of a trial, ready to be sent and written.

    Attributes:
        row: Its row; see `rows`.
        files: Its recording: a folder whose files are to be moved, or contents by name.
        warning: A line for the user, or "".
    """

    row: dict[str, Any]
    files: Path | Mapping[str, bytes] = dc.field(default_factory=dict)
    warning: str = ""


def run_trial(
    tree: Mapping[str, Any],
    origin: str,
    seed: int,
    trial: int,
    record: str = "none",
    simulate: Callable[..., Result] | None = None,
) -> TrialResult:
    """Run a trial and judge it; an error during the trial counts as an outcome.

    Args:
        tree: The scenario, from `load_tree`.
        origin: Its name or path.
        seed: Seed of the sweep; the trial's own is `seed` + `trial`.
        trial: Number of the trial, from 0.
        record: `none`, `all`, or `failures`, which runs a failed trial a second time to
            record it.
        simulate: Runs and judges a scenario in place of `Simulate`.

    Raises:
        ImportError: If a package is missing.
        OSError: If a file cannot be read, or recordings cannot be written into the
            folder for temporary files.
    """
    start = wall.perf_counter()
    result = _run(tree, origin, seed, trial, record == "all", simulate)
    if record == "failures" and not result.row["success"]:
        again = _run(tree, origin, seed, trial, True, simulate)
        result = dc.replace(
            result, files=again.files, warning=_different(result.row, again.row)
        )
    free_diagrams()
    # Modules and caches stay until the worker ends, so the garbage collector need not
    # visit them again.
    gc.freeze()
    result.row["trial_time_s"] = wall.perf_counter() - start
    result.row["memory_mb"] = resident_memory()
    result.row["worker"] = f"{socket.gethostname()}:{os.getpid()}"
    return result


def run_cell_trial(cell: str, *arguments: Any) -> TrialResult:
    """Run a trial like `run_trial`, in a cell that `load_make_cell` finds."""
    make_cell = load_make_cell(cell)
    simulate = functools.partial(Simulate, warm_up=False, make_cell=make_cell)
    return functools.partial(run_trial, simulate=simulate)(*arguments)


def with_contents(function: Callable[..., TrialResult], *arguments: Any) -> TrialResult:
    """Run a trial and return the contents of its files, for use on another machine."""
    result = function(*arguments)
    if isinstance(result.files, Path):
        files = {path.name: path.read_bytes() for path in result.files.iterdir()}
        shutil.rmtree(result.files)
        result = dc.replace(result, files=files)
    return result


def empty_row(seed: int, trial: int, message: str) -> dict[str, Any]:
    """Return the row of a trial that ended in an error, with a message of one line."""
    return {
        "trial": trial,
        "seed": seed + trial,
        **dict.fromkeys(metric_columns()),
        "success": False,
        "failure": ERROR,
        "message": message,
        "claimed": False,
    }


def resident_memory() -> float | None:
    """Return the resident memory of this process [MB]; None: unknown on this system."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _run(
    tree: Mapping[str, Any],
    origin: str,
    seed: int,
    trial: int,
    record: bool,
    simulate: Callable[..., Result] | None,
) -> TrialResult:
    row = empty_row(seed, trial, "")
    out = Path(tempfile.mkdtemp(prefix="drake_srg_")) if record else None
    with contextlib.ExitStack() as stack:
        if out is not None:
            stack.callback(shutil.rmtree, out)
        try:
            drawn = draw_scenario(tree, origin, seed + trial)
            row |= drawn.values
            result = (simulate or functools.partial(Simulate, warm_up=False))(
                drawn.scenario,
                name=Path(origin).stem,
                out=out,
                record=record,
                video_process=False,  # the other cores run other trials
            )
            row |= _outcome(result)
        except (ImportError, OSError) as error:  # other trials would fail, too
            if isinstance(error, OSError) and error.errno and out is not None:
                error.filename = error.filename or str(out)
            raise
        except (Exception, SystemExit) as error:  # SystemExit: see `one_line`
            row["message"] = f"{type(error).__name__}: {one_line(error)}"
        if out is not None and any(out.iterdir()):  # also after an error
            stack.pop_all()
            return TrialResult(row, out)
    return TrialResult(row)


def _outcome(result: Result) -> dict[str, Any]:
    metrics = dc.asdict(result.metrics)
    return {
        **{name: metrics[name] for name in metric_columns()},
        "message": result.status.message or None,
        "claimed": result.status.done,
    }


def _different(row: Mapping[str, Any], again: Mapping[str, Any]) -> str:
    """Return a warning if a trial had another outcome when it was recorded."""
    changed = [n for n in row if n not in TIMING_COLUMNS and row[n] != again[n]]
    if not changed:
        return ""
    return (
        f"trial {row['trial']}: its recording differs from its row "
        f"({', '.join(changed)}): with an error-controlled integrator, "
        "1 / recording.video_fps and recording.bag_camera_period must be multiples of "
        "recording.period"
    )
