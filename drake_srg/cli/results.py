"""Folders for results, which never overwrite a user's files silently.

Without `-o`, results go to a new folder: `out/kitchen`, then `out/kitchen-2`. With
`-o`, a folder that already has results is refused unless `--replace` is given.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import itertools
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from drake_srg.cli.command import Adds, all_of, argument, flag, writing
from drake_srg.common.exceptions import ScenarioError

# Patterns of result files.
RUN = (
    *("metrics.json", "log.npz", "video.mp4", "recording.mcap", "timeline.png"),
    *("replay.html", "replay.glb"),
)
SWEEP = (
    *("sweep.json", "trials.parquet", "trials/*.parquet*", "report.html"),
    *(f"recordings/*/{name}" for name in RUN),
)
TRAINING = ("training.json", "policy.npz", "policy.onnx", "checkpoint.pt", "events.*")
CALIBRATION = ("calibration.yaml", "images/*")
DATASET = (
    *("meta", "data", "videos"),
    *("meta/**/*", "data/**/*", "videos/**/*"),
)


def folder(contents: str, default: str) -> Adds:
    """Return a function that adds `--out`, a folder for results, and `--replace`.

    Args:
        contents: Contents of the folder, in words.
        default: The default folder, in words.
    """
    where = f"{default}, with -2 and so on if that has results"
    return all_of(
        argument(
            *("-o", "--out"),
            type=Path,
            metavar="DIR",
            help=f"folder for {contents} (default: {where})",
        ),
        REPLACE,
    )


REPLACE = flag("--replace", "replace earlier results in the same place")


@contextlib.contextmanager
def results_folder(
    options: argparse.Namespace,
    default: Path,
    names: Sequence[str],
    advise: Callable[[], str] | None = None,
) -> Iterator[Path]:
    """Yield the folder of a command's results, locked against other processes.

    The folder is made if necessary, and removed if an error occurs before anything is
    written. An OSError is reported as bad input that names `--out`.

    Args:
        options: Options of the command: `out`, `replace` and perhaps `resume`.
        default: The folder without `-o`; it gets a number if it is taken.
        names: Patterns of the command's output files, as for `Path.glob`.
        advise: See `writing`.

    Raises:
        ScenarioError: If the folder already has results, if another process is writing
            there, or if it cannot be written.
    """
    from drake_srg.recording.output import output_folder

    resume, replace = (getattr(options, key, False) for key in ("resume", "replace"))
    for out in _choices(options, default):
        with writing("--out", out, advise), contextlib.ExitStack() as stack:
            stack.enter_context(output_folder(out))
            lock = _lock(out)
            if lock is not None:
                stack.callback(os.close, lock)
            if replace and not resume and lock is not None:
                remove(out, names)
            if lock is not None and (resume or not find(out, names)):
                yield out
                return
            if options.out is None and not resume:
                continue
            if lock is None:
                raise ScenarioError(f"--out {out}: another process is writing there")
            raise taken(options, out, names)


@contextlib.contextmanager
def new_folder(
    options: argparse.Namespace, default: Path, names: Sequence[str]
) -> Iterator[Path]:
    """Yield the path of a folder that the command itself makes, in one step at its end.

    A folder to be replaced is kept until then, and restored after an error.

    Args:
        options: Options of the command: `out` and `replace`.
        default: The path without `-o`; it gets a number if it is taken.
        names: Patterns of the command's output files. Only these may be replaced.

    Raises:
        ScenarioError: If the folder has files that must not be replaced.
    """
    for out in _choices(options, default):
        results = {path for name in names for path in out.glob(name)}
        others = [path for path in sorted(out.rglob("*")) if path not in results]
        if not out.exists() or (out.is_dir() and not results and not others):
            yield out
            return
        if options.replace and out.is_dir() and not others:
            aside = out.with_name(f".{out.name}.replaced")
            with writing("--out", out):
                out.rename(aside)
            try:
                yield out
            except BaseException:
                aside.rename(out)
                raise
            shutil.rmtree(aside, ignore_errors=True)
            return
        if options.out is not None or options.replace:
            raise taken(options, out, [path.name for path in others] or ("*",))


def taken(
    options: argparse.Namespace, out: Path, names: Sequence[str]
) -> ScenarioError:
    """Return an error that says that a folder has results, and the remedy."""
    found = find(out, names)
    there = f" ({found.relative_to(out)})" if found is not None else ""
    more = "continue them with --resume, " if hasattr(options, "resume") else ""
    has = f"has results{there}" if out.is_dir() else "exists"
    return ScenarioError(
        f"--out {out}: already {has}; {more}choose another, or add --replace"
    )


def find(out: Path, names: Sequence[str]) -> Path | None:
    """Return the first file of a folder that matches one of the patterns."""
    return next((path for name in names for path in sorted(out.glob(name))), None)


def remove(out: Path, names: Sequence[str]) -> None:
    """Remove the files that match the patterns, and folders that become empty.

    Raises:
        OSError: If a file cannot be removed.
    """
    found = {path for name in names for path in out.glob(name)}
    folders = {parent for path in found for parent in path.parents if parent != out}
    folders = {path for path in folders if out in path.parents}
    for path in found:
        if path.is_dir() and not path.is_symlink():
            folders.add(path)
        else:
            path.unlink()
    for path in sorted(folders, reverse=True):  # inner ones first
        if not any(path.iterdir()):
            path.rmdir()


def _choices(options: argparse.Namespace, default: Path) -> Iterator[Path]:
    """Yield the folder of `-o`; without `-o`, the default folder and numbered ones.

    With `--resume`, yield only the last one that exists.
    """
    if options.out is not None:
        yield options.out
        return
    numbered = (
        default if n == 1 else default.with_name(f"{default.name}-{n}")
        for n in itertools.count(1)
    )
    if not getattr(options, "resume", False):
        yield from numbered
        return
    there = list(itertools.takewhile(Path.exists, numbered))
    yield there[-1] if there else default


def _lock(out: Path) -> int | None:
    """Lock a folder until the returned descriptor is closed; None if already locked."""
    descriptor = os.open(out, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    except OSError:  # a file system without locks
        pass
    return descriptor
