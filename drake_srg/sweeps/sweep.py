"""Sweeps: many trials of a scenario, each run exactly once despite interruptions.

DIR/sweep.json           identifies the sweep; see `info`
DIR/trials.parquet       one row per trial; see `rows`
DIR/recordings/000017/   recording of a trial: the files of `drake-srg run`
"""

from __future__ import annotations

import collections
import contextlib
import dataclasses as dc
import datetime
import fcntl
import functools
import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from pathlib import Path
from typing import IO, Any

from drake_srg.common.exceptions import ScenarioError, one_line, scenario_errors
from drake_srg.common.status_line import StatusLine
from drake_srg.lifetime import free_diagrams
from drake_srg.recording.output import require
from drake_srg.scenario import draw_scenario, load_tree
from drake_srg.station import MakeCell
from drake_srg.station.cell import load_make_cell
from drake_srg.sweeps.engines import Engine
from drake_srg.sweeps.files import remove_folder, remove_partial, write_folder
from drake_srg.sweeps.info import (
    FILE,
    RECORD,
    SweepInfo,
    current_versions,
    difference,
    dump_tree,
    hash_model_files,
    read_sweep,
)
from drake_srg.sweeps.rows import (
    BrokenRowsError,
    all_rows_path,
    read_file,
    require_sweep,
    row_path,
    row_paths,
    unique_rows,
    write_row,
    write_rows,
)
from drake_srg.sweeps.trial import (
    TrialResult,
    empty_row,
    run_cell_trial,
    run_trial,
    with_contents,
)

RECORDINGS = "recordings"


class SweepFolder:
    """The rows and recordings of a sweep, locked from `begin` to `close`.

    A trial has finished once its row exists. Its recording is written before the row.
    """

    def __init__(self, path: Path):
        self.path = path
        self._lock: IO[str] | None = None

    def begin(self, info: SweepInfo, resume: bool, tell: Callable[[str], None]) -> Any:
        """Prepare the folder for a new sweep, or to continue one.

        A single row whose content is broken is set aside, so that its trial runs again.

        Returns:
            The rows of finished trials, a pyarrow.Table.

        Raises:
            ScenarioError: If another process is writing there, the folder contains
                trials of another sweep, or of this one without `resume`, or rows
                cannot be read.
            OSError: If the folder cannot be written.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        self._take_lock()
        files = row_paths(self.path)
        if (self.path / FILE).exists() and files:
            if not resume:
                raise ScenarioError(
                    f"{self.path}: already contains trials of a sweep; continue it "
                    "with --resume, or choose another --out"
                )
            begun = read_sweep(self.path)
            different = difference(begun, info)
            info = dc.replace(info, started=begun.started)
            if different:
                raise ScenarioError(
                    f"{self.path}: contains another sweep: {different}; choose another "
                    "--out"
                )
        elif files:
            raise ScenarioError(
                f"{self.path}: contains trials but no {FILE}; choose another --out"
            )
        for folder in (self.path, self.path / "trials", self.path / RECORDINGS):
            remove_partial(folder)
        info.write(self.path)
        tables = []
        for file in files:
            try:
                tables.append(read_file(file, info))
            except BrokenRowsError as error:
                if file == all_rows_path(self.path):
                    raise
                aside = _set_aside(file)
                tell(f"{error.problem}; renamed to {aside.name}, its trial runs again")
        return unique_rows(tables)

    def add(self, result: TrialResult) -> None:
        """Write the result of a trial, its row last.

        Raises:
            OSError: If it cannot be written; the trial then counts as not run.
        """
        trial = result.row["trial"]
        recording = self.path / RECORDINGS / f"{trial:06}"
        if result.files:
            write_folder(recording, result.files)
        else:
            remove_folder(recording)  # of an earlier run, whose row was lost
        write_row(row_path(self.path, trial), result.row)

    def finish(self) -> Any:
        """Collect all rows in one file, and return them as a pyarrow.Table.

        Raises:
            OSError: If it cannot be written; the single rows then stay.
        """
        info = read_sweep(self.path)
        files = row_paths(self.path)
        rows = unique_rows([read_file(file, info) for file in files])
        whole = all_rows_path(self.path)
        if files != [whole]:
            write_rows(whole, rows)
        for file in files:
            if file != whole:
                file.unlink()
        single = self.path / "trials"
        if single.exists() and not any(single.iterdir()):
            single.rmdir()
        return rows

    def close(self) -> None:
        """Release the lock."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _take_lock(self) -> None:
        """Take the lock; the system releases it even if this process crashes."""
        lock = (self.path / "lock").open("a+", encoding="utf-8")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.seek(0)
            holder = lock.read().strip() or "another process"
            lock.close()
            raise ScenarioError(
                f"{self.path}: {holder} is running a sweep there; wait for it to end, "
                "or choose another --out"
            ) from None
        except BaseException:
            lock.close()
            raise
        lock.truncate(0)
        lock.write(f"process {os.getpid()}\n")
        lock.flush()
        self._lock = lock


def _set_aside(file: Path) -> Path:
    """Rename a file to a free name that ends in .broken; returns the new path."""
    for number in itertools.count(1):
        suffix = ".broken" if number == 1 else f".broken-{number}"
        aside = file.with_name(file.name + suffix)
        if not aside.exists():
            break
    return file.rename(aside)


# After this many deaths of its workers, a trial is to blame. The first two may be the
# fault of another trial that ran at the same time. The other two happen while it runs
# alone; a single one could be the worker's own fault.
TRIES = 4
# After this many deaths per slot without a single result, the trials are not to blame.
_DEATHS = 5


def dispatch(
    engine: Engine,
    trials: Iterable[int],
    submit: Callable[[int], Future[TrialResult]],
    lost: Callable[[int, str], TrialResult],
) -> Iterator[TrialResult]:
    """Run trials and yield their results as they arrive, each exactly once.

    A dying worker may take others with it, so their trials run again. A trial whose
    worker dies a second time waits until all others have finished, and then runs alone.
    So only the one to blame fails again.

    Args:
        engine: Runs the trials.
        trials: Their numbers.
        submit: Submits a trial to the engine.
        lost: Returns the result of a trial whose workers keep dying, given the reason.

    Raises:
        ScenarioError: If workers keep dying without a result, or a trial cannot read
            or write a file.
        Exception: Any other exception of a trial.
    """
    waiting = collections.deque(trials)
    suspects: collections.deque[int] = collections.deque()
    tries: collections.Counter[int] = collections.Counter()
    pending: dict[Future[TrialResult], int] = {}
    deaths = 0

    def fill() -> None:
        while waiting and len(pending) < engine.slots():
            trial = waiting.popleft()
            pending[submit(trial)] = trial
        if suspects and not pending:
            trial = suspects.popleft()
            pending[submit(trial)] = trial

    fill()
    while pending:
        for future in wait(pending, return_when=FIRST_COMPLETED).done:
            trial = pending.pop(future)
            try:
                result = future.result()
            except engine.deaths as error:
                deaths += 1
                tries[trial] += 1
                reason = one_line(error)
                if deaths >= _DEATHS * engine.slots():
                    raise ScenarioError(
                        f"workers keep dying, {deaths} times without a result: {reason}"
                    ) from error
                if tries[trial] < TRIES:
                    if tries[trial] == 1:
                        waiting.append(trial)
                    elif tries[trial] == 2:
                        suspects.append(trial)
                    else:
                        suspects.appendleft(trial)  # its result resets `deaths`
                    continue
                result = lost(trial, f"its worker died {TRIES} times: {reason}")
            except Exception as error:
                cause = _cause(error)
                # Callers would take an OSError for a failure to write the sweep.
                if isinstance(cause, OSError):
                    raise ScenarioError(
                        f"trial {trial}: {_words(cause)}; finished trials are kept, "
                        "--resume continues"
                    ) from error
                raise cause from error
            deaths = 0
            fill()  # before the caller takes time to write the result
            yield result
        fill()


def _words(error: OSError) -> str:
    """Return an error in one line, with its file."""
    if error.strerror is None:
        return one_line(error)
    return f"{error.filename}: {error.strerror}" if error.filename else error.strerror


def _cause(error: Exception) -> Exception:
    """Return a worker's own exception, unwrapped from Ray's."""
    inner: Any = getattr(error, "cause", None)
    return inner if isinstance(inner, Exception) else error


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
        submit: Submits a trial to the engine.
        lost: See `dispatch`.
        out: Folder of the sweep.
        resume: Whether `out` may already contain trials of this sweep.
        progress: Whether to show progress on standard error.
        tell: Receives warnings, one line each.
        noun: Word for the trials in the progress line.

    Returns:
        All rows, a pyarrow.Table.

    Raises:
        ScenarioError: If `out` contains another sweep, or workers keep dying.
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


def sweep_info(
    scenario: str,
    trials: int,
    seed: int,
    engine: Engine,
    overrides: Sequence[str],
    tree: Mapping[str, Any],
    *,
    record: str = "none",
    policy: str = "",
    cell: str = "",
) -> SweepInfo:
    """Return the identity of a sweep that begins now; see `SweepInfo`."""
    return SweepInfo(
        scenario=scenario,
        seed=seed,
        trials=trials,
        record=record,
        overrides=overrides,
        tree=dump_tree(tree),
        versions=current_versions(),
        files=hash_model_files(tree),
        engine=engine.name,
        jobs=engine.jobs,
        started=datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        policy=policy,
        cell=cell,
    )


def lost_trial(
    tree: Mapping[str, Any], scenario: str, seed: int, trial: int, reason: str
) -> TrialResult:
    """Return the result of a trial of a scenario that keeps killing its worker."""
    values = draw_scenario(tree, scenario, seed + trial).values
    return TrialResult({**empty_row(seed, trial, reason), **values})


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
    cell: str = "",
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
        record: Trials that keep a recording: `none`, `failures` or `all`.
        resume: Whether `out` may already contain trials of this sweep.
        progress: Whether to show progress on standard error.
        tell: Receives warnings, one line each.
        trial_function: Replaces `run_trial`; workers must be able to import it.
        cell: `module:function` that builds a cell of the user's own; empty: `MakeCell`.

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
    if cell:
        trial_function = functools.partial(run_cell_trial, cell)
    seed = check_scenario(tree, scenario, seed, record, cell)
    info = sweep_info(
        *(scenario, trials, seed, engine, overrides, tree), record=record, cell=cell
    )
    lost = functools.partial(lost_trial, tree, scenario, seed)

    def submit(trial: int) -> Future[TrialResult]:
        arguments = (trial_function, tree, scenario, seed, trial, record)
        if engine.shares_files:
            return engine.submit(*arguments)
        return engine.submit(with_contents, *arguments)

    return run_missing_trials(
        info, engine, submit, lost, out=out, resume=resume, progress=progress, tell=tell
    )


def check_scenario(
    tree: Mapping[str, Any],
    scenario: str,
    seed: int | None,
    record: str,
    cell: str = "",
) -> int:
    """Build the cell of trial 0, and return its seed; see `run_sweep`.

    Raises:
        ScenarioError: If the cell cannot be built: every trial would fail.
        ImportError: If recording needs a package that is missing.
    """
    if record != "none":
        for module in ("av", "rosbags.rosbag2", "matplotlib.figure"):
            require(module)
    drawn = draw_scenario(tree, scenario, seed).scenario
    with scenario_errors(Path(scenario).stem):
        (load_make_cell(cell) if cell else MakeCell)(drawn)
    free_diagrams()
    return drawn.random_seed
