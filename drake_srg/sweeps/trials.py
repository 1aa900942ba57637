"""Runs the trials that a folder lacks, and writes each row as its trial ends."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from drake_srg.common.status_line import StatusLine
from drake_srg.sweeps.dispatch import dispatch
from drake_srg.sweeps.engines import Engine
from drake_srg.sweeps.folder import SweepFolder
from drake_srg.sweeps.info import SweepInfo
from drake_srg.sweeps.trial import TrialResult


def run_missing_trials(
    info: SweepInfo,
    engine: Engine,
    submit: Callable[[int], Future[TrialResult]],
    lost: Callable[[int, str], TrialResult],
    *,
    out: Path,
    resume: bool,
    progress: bool,
    tell: Callable[[str], None],
    noun: str = "trials",
) -> Any:
    """Run the trials of a sweep that have no row yet.

    Args:
        info: Identifies the sweep.
        engine: Runs the trials; entered here, if any are missing.
        submit: Gives a trial to the engine.
        lost: Returns the result of a trial that keeps killing its worker, and why.
        out: Folder of the sweep.
        resume: Whether `out` may already contain trials of this sweep.
        progress: Whether to show progress on standard error.
        tell: Receives warnings, one line each.
        noun: What the trials are called in the progress.

    Returns:
        All rows, a pyarrow.Table.

    Raises:
        ScenarioError: If `out` has another sweep, or workers keep dying.
        OSError: If the folder cannot be written.
    """
    with contextlib.closing(SweepFolder(out)) as folder:
        rows = folder.begin(info, resume, tell)
        done = set(rows["trial"].to_pylist())
        missing = [trial for trial in range(info.trials) if trial not in done]
        with contextlib.ExitStack() as stack:
            if missing:
                stack.enter_context(engine)
            line = stack.enter_context(StatusLine(shown=progress))
            begun, succeeded = len(done), sum(rows["success"].to_pylist())
            for number, result in enumerate(
                dispatch(engine, missing, submit, lost), begun + 1
            ):
                folder.add(result)
                if result.warning:
                    line.interrupt(result.warning, tell)
                succeeded += result.row["success"]
                words = f"{noun}, {succeeded / number:.1%} succeeded"
                line.count(number, info.trials, words, begun)
        return folder.finish()
