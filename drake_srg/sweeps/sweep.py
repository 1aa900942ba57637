"""Runs many trials of a scenario, each exactly once, also across interruptions.

DIR/sweep.json           identifies the sweep; see `info`
DIR/trials.parquet       one row per trial; see `rows`
DIR/recordings/000017/   recording of a trial: the files of `drake-srg run`
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from drake_srg.cell import MakeCell
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.lifetime import free_diagrams
from drake_srg.recording.output import require
from drake_srg.scenario import draw_scenario, load_tree
from drake_srg.sweeps.engines import Engine
from drake_srg.sweeps.info import RECORD, SweepInfo, current_versions, dump_tree
from drake_srg.sweeps.rows import require_sweep
from drake_srg.sweeps.trial import TrialResult, empty_row, run_trial, with_contents
from drake_srg.sweeps.trials import run_missing_trials

TrialFunction = Callable[[Mapping[str, Any], str, int, int, str], TrialResult]


def run_sweep(
    scenario: str,
    trials: int,
    *,
    out: Path,
    engine: Engine,
    seed: int | None = None,
    overrides: Iterable[str] = (),
    record: str = "none",
    resume: bool = False,
    progress: bool = False,
    tell: Callable[[str], None] = print,
    trial_function: TrialFunction = run_trial,
) -> Any:
    """Run trials 0 .. `trials` - 1 of a scenario that have not run yet.

    Trial k has the seed `seed` + k and gives the same row on any engine, except for
    `rows.TIMING_COLUMNS`. Each row is written when its trial ends. After an
    interruption, `resume` continues with the remaining trials.

    Args:
        scenario: Name of a scenario of the package, or path of a YAML file.
        trials: Number of trials; resuming a sweep may raise it.
        out: Folder of the sweep.
        engine: Runs the trials; entered here.
        seed: Seed of trial 0; None: the scenario's `random_seed`.
        overrides: `KEY=VALUE` each; see `load_scenario`.
        record: Which trials keep a recording: `none`, `failures` or `all`.
        resume: Whether `out` may already contain trials of this sweep.
        progress: Whether to show progress on standard error.
        tell: Receives warnings, one line each.
        trial_function: Replaces `run_trial`; workers must be able to import it.

    Returns:
        All rows, a pyarrow.Table.

    Raises:
        ScenarioError: For bad input, before any trial runs, or if workers keep dying.
        OSError: If the folder cannot be written.
        ImportError: If a package is missing.
    """
    if trials < 1:
        raise ScenarioError(f"--trials {trials}: must be at least 1")
    if record not in RECORD:
        raise ScenarioError(f"--record {record}: allowed: {', '.join(RECORD)}")
    overrides = list(overrides)
    tree = load_tree(scenario, overrides)
    require_sweep("pyarrow.parquet")
    seed = check_scenario(tree, scenario, seed, record)
    info = SweepInfo(
        scenario=scenario,
        seed=seed,
        trials=trials,
        record=record,
        overrides=overrides,
        tree=dump_tree(tree),
        versions=current_versions(),
        engine=engine.name,
        jobs=engine.jobs,
        started=datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
    )

    def lost(trial: int, reason: str) -> TrialResult:
        values = draw_scenario(tree, scenario, seed + trial).values
        return TrialResult({**empty_row(seed, trial, reason), **values})

    def submit(trial: int) -> Future[TrialResult]:
        arguments = (trial_function, tree, scenario, seed, trial, record)
        if engine.shares_files:
            return engine.submit(*arguments)
        return engine.submit(with_contents, *arguments)

    return run_missing_trials(
        info, engine, submit, lost, out=out, resume=resume, progress=progress, tell=tell
    )


def check_scenario(
    tree: Mapping[str, Any], scenario: str, seed: int | None, record: str
) -> int:
    """Build the cell of trial 0, and return its seed.

    Args:
        tree: The scenario, from `load_tree`.
        scenario: Its name or path.
        seed: Seed of trial 0; None: the scenario's `random_seed`.
        record: Which trials keep a recording.

    Raises:
        ScenarioError: If the cell cannot be built, so that every trial would fail.
        ImportError: If recording needs a package that is missing.
    """
    if record != "none":
        for module in ("av", "rosbags.rosbag2", "matplotlib.figure"):
            require(module)
    drawn = draw_scenario(tree, scenario, seed).scenario
    with scenario_errors(Path(scenario).stem):
        MakeCell(drawn)
    free_diagrams()
    return drawn.random_seed
