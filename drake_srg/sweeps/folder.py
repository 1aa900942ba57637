"""The folder of a sweep, which one process at a time may write to."""

from __future__ import annotations

import dataclasses as dc
import fcntl
import itertools
import os
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.files import remove_folder, remove_partial, write_folder
from drake_srg.sweeps.info import FILE, SweepInfo, difference, read_sweep
from drake_srg.sweeps.rows import (
    BrokenRowsError,
    all_rows_path,
    read_file,
    row_path,
    row_paths,
    unique_rows,
    write_row,
    write_rows,
)
from drake_srg.sweeps.trial import TrialResult

RECORDINGS = "recordings"


class SweepFolder:
    """The rows and recordings of a sweep, locked from `begin` to `close`.

    A trial has finished when its row is there; its recording is written before that.

    Args:
        path: The folder.
    """

    def __init__(self, path: Path):
        self.path = path
        self._lock: IO[str] | None = None

    def begin(self, info: SweepInfo, resume: bool, tell: Callable[[str], None]) -> Any:
        """Prepare the folder for a new sweep, or to continue one.

        A single row whose content is broken is set aside, so that its trial runs again.

        Args:
            info: The sweep.
            resume: Whether the folder may contain trials of it.
            tell: Receives warnings, one line each.

        Returns:
            The rows that are there, a pyarrow.Table.

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
            remove_folder(recording)  # an earlier one, whose row was lost
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
        """Take the lock, which the system releases however this process ends."""
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
