"""Runs many trials of a scenario, each once, whatever happens in between.

DIR/sweep.json           what the sweep is; see `info`
DIR/trials.parquet       a row a trial; see `rows`
DIR/recordings/000017/   recording of a trial: files of `drake-srg run`
"""

from __future__ import annotations

import contextlib
import datetime
import gc
import sys
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from tqdm import tqdm

from drake_srg.cell import MakeCell
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.recording.output import require
from drake_srg.scenario import draw_scenario, load_tree
from drake_srg.sweeps.dispatch import dispatch
from drake_srg.sweeps.engines import Engine
from drake_srg.sweeps.folder import SweepFolder
from drake_srg.sweeps.info import RECORD, SweepInfo, current_versions, dump_tree
from drake_srg.sweeps.rows import require_sweep
from drake_srg.sweeps.trial import TrialResult, empty_row, run_trial, with_contents

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
    """Run trials 0 .. `trials` - 1 of a scenario, or those of them that are missing.

    Trial k has the seed `seed` + k and gives the same row on any engine, up to
    `rows.TIMING_COLUMNS`. A row is written as its trial ends. Where this is
    interrupted, what is written stays, and `resume` goes on from there.

    Args:
        scenario: Name of a scenario of the package, or path of a YAML file.
        trials: How many; a sweep that is resumed may get more.
        out: Folder of the sweep.
        engine: Where they run; it is entered here.
        seed: Of trial 0; None: the scenario's `random_seed`.
        overrides: `KEY=VALUE` each; see `load_scenario`.
        record: Whose recordings are kept: `none`, `failures` or `all`.
        resume: Whether `out` may have trials of this sweep already.
        progress: Whether to show a progress bar, on standard error.
        tell: Gets warnings, a line each.
        trial_function: In place of `run_trial`; of a module that workers can import.

    Returns:
        All rows, a pyarrow.Table.

    Raises:
        ScenarioError: For bad input, before any trial runs; or if workers keep dying.
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
    seed = _check(tree, scenario, seed, record)
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

    with contextlib.closing(SweepFolder(out)) as folder:
        rows = folder.begin(info, resume, tell)
        done = set(rows["trial"].to_pylist())
        missing = [trial for trial in range(trials) if trial not in done]
        with contextlib.ExitStack() as stack:
            if missing:
                stack.enter_context(engine)
            bar = stack.enter_context(
                _Bar(trials, len(done), sum(rows["success"].to_pylist()), progress)
            )
            for result in dispatch(engine, missing, submit, lost):
                folder.add(result)
                if result.warning:
                    bar.write(result.warning, tell)
                bar.count(result.row["success"])
        return folder.finish()


def _check(
    tree: Mapping[str, Any], scenario: str, seed: int | None, record: str
) -> int:
    """Look for what no trial could do with, and return the seed of trial 0."""
    if record != "none":
        for module in ("av", "rosbags.rosbag2", "matplotlib.figure"):
            require(module)
    drawn = draw_scenario(tree, scenario, seed).scenario
    with scenario_errors(Path(scenario).stem):
        MakeCell(drawn)
    gc.collect()
    return drawn.random_seed


class _Bar:
    """A progress bar: trials, how many succeeded, time left."""

    def __init__(self, trials: int, done: int, succeeded: int, show: bool):
        self._succeeded = succeeded
        self._bar = tqdm(
            desc=self._description(done),
            total=trials,
            initial=done,
            disable=not show,
            file=sys.stderr,
            smoothing=0.05,  # trials last differently; workers end out of step
            bar_format="{n_fmt}/{total_fmt} trials |{bar:20}| {desc} "
            "[{elapsed} elapsed, {remaining} left]",
        )

    def __enter__(self) -> _Bar:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def count(self, success: bool) -> None:
        """Count a trial."""
        self._succeeded += success
        words = self._description(self._bar.n + 1)
        self._bar.set_description_str(words, refresh=False)  # which `update` shows
        self._bar.update()

    def _description(self, done: int) -> str:
        return f"{self._succeeded / done:.1%} succeeded" if done else ""

    def write(self, text: str, tell: Callable[[str], None]) -> None:
        """Say something beside the bar."""
        with self._bar.external_write_mode(file=sys.stderr):
            tell(text)
