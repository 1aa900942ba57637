"""Base class of recorders, files that appear only when complete, and logs."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import warnings
import weakref
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from drake_srg.common import installing
from drake_srg.common.exceptions import one_line
from drake_srg.lifetime import LeafSystem

_Self = TypeVar("_Self", bound="Recorder")


def require(module: str) -> ModuleType:
    """Import a module that recording needs.

    Raises:
        ImportError: If it is missing; the message says how to install it.
    """
    return installing.require(module, "", "Recording needs")


@contextlib.contextmanager
def output_folder(out: Path | None) -> Iterator[None]:
    """Make a folder for results; after an exception, remove it if it is empty.

    Args:
        out: The folder; None: no folder.

    Raises:
        OSError: On entry, if nothing can be written there.
    """
    made: list[Path] = []
    try:
        if out is not None:
            made = [path for path in (out, *out.parents) if not path.exists()]
            out.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=out).close()
        yield
    except BaseException:
        for path in made:
            with contextlib.suppress(OSError):  # if the folder is not empty
                path.rmdir()
        raise


def count_phrase(number: int, thing: str) -> str:
    """Return a number with its noun: `1 attempt`, `2 attempts`."""
    return f"{number} {thing}" + "s" * (number != 1)


def verdict(metrics: Mapping[str, Any]) -> str:
    """Return a phrase about the end of a run with these contents of metrics.json."""
    tries = metrics["attempts"]
    if metrics.get("claimed"):
        word = "done, by the planner's word"
    else:
        word = "success" if metrics["success"] else f"failure: {metrics['failure']}"
    if metrics.get("objects_total") is None:
        return f"{word}, {count_phrase(tries, 'attempt')}"
    cleared, total = metrics["objects_cleared"], metrics["objects_total"]
    return (
        f"{word}, {cleared} of {total} objects cleared, {count_phrase(tries, 'pick')}"
    )


class OutputFile:
    """A file that appears under its name only when it is complete.

    Until then, it is `path`, in a hidden folder beside `target`, so `commit` is a
    rename.

    Args:
        target: The final path.
        owned: Whether the owner always calls `commit` or `discard`. Otherwise, the
            folder disappears with the object, even with a complete file.

    Attributes:
        target: The final path.
        path: The path to write to until `commit`.

    Raises:
        OSError: If nothing can be written beside `target`; it names the folder.
    """

    def __init__(self, target: Path | str, *, owned: bool = False):
        self.target = Path(target)
        try:
            self.target.parent.mkdir(parents=True, exist_ok=True)
            self._folder = tempfile.mkdtemp(
                prefix=f".{self.target.name}.", dir=self.target.parent
            )
        except OSError as error:
            folder = str(self.target.parent)
            raise OSError(error.errno, error.strerror, folder) from error
        self.path = Path(self._folder) / self.target.name
        if not owned:
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)

    def commit(self) -> Path:
        """Move the file to `target`, replacing any older one; return `target`."""
        self.path.replace(self.target)
        self.discard()
        return self.target

    def discard(self) -> None:
        """Delete the file."""
        shutil.rmtree(self._folder, ignore_errors=True)


def close_at_exit(owner: Any, close: Callable[[Any], str]) -> None:
    """Complete a file at the end of the program, unless that has already happened.

    Args:
        owner: Owner of the file; it is not kept alive.
        close: Called with `owner`; completes its file and returns a description of it,
            or "" if there was nothing to do.
    """
    weakref.finalize(owner, close_late, weakref.ref(owner), close)


def close_late(owner: Callable[[], Any], close: Callable[[Any], str]) -> None:
    """Complete a forgotten file, and warn; see `close_at_exit`."""
    forgotten = owner()
    if forgotten is None:
        return
    try:
        name = close(forgotten)
        what = f"{name}: completed only now" if name else ""
    except Exception as error:  # no caller could catch it here
        what = f"a recording is lost: {error}"
    if what:
        warnings.warn(
            f"{what}, because nothing closed its recorder. Use the recorder as a "
            "context manager around the simulation: `with recorder:`",
            RuntimeWarning,
            stacklevel=2,
        )


class Recorder(LeafSystem):
    """A system that writes a file until it is closed; use it as a context manager.

    After an error or the user's interrupt, the file is completed too, because it shows
    the cause. A recorder that is never closed completes its file, with a warning, when
    it is deleted or the program ends.
    """

    _output: OutputFile
    _closed = True  # until `_begin`
    _failed = False  # an error ended the recording

    def _begin(self, path: Path | str) -> None:
        """Begin the file that `close()` completes.

        Raises:
            OSError: If nothing can be written there.
        """
        # Otherwise, the garbage collector could remove the folder before `__del__`
        # completes the file.
        self._output = OutputFile(path, owned=True)
        self._closed = False
        close_at_exit(self, Recorder._close_forgotten)

    @property
    def path(self) -> Path:
        """The file's path after `close()`."""
        return self._output.target

    def close(self) -> None:
        """Complete the file and move it to `path`, unless it is not worth keeping.

        Raises:
            OSError: If the file cannot be completed; an older file then stays in place.
        """
        self._close()

    def _close(self) -> bool:
        """Close like `close`, and return whether this has written a file."""
        if self._closed:
            return False
        self._closed = True
        try:
            kept = self._finish()
            if kept:
                self._output.commit()
            return kept
        finally:
            self._output.discard()

    def _close_forgotten(self) -> str:
        self._failed = True  # so that an empty file is not kept
        return str(self.path) if self._close() else ""

    def __del__(self) -> None:
        close_late(lambda: self, Recorder._close_forgotten)

    def note_failure(self, kind: type[BaseException] | None) -> None:
        """Record the exception type that ended the recording; None: no exception."""
        self._failed = kind is not None and issubclass(kind, Exception)

    def _finish(self) -> bool:
        """Complete the file, and return whether it is worth keeping."""
        raise NotImplementedError

    def __enter__(self: _Self) -> _Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.note_failure(kind)
        try:
            self.close()
        except Exception:
            if kind is None:
                raise
            # Otherwise, the first error is raised, because a full disk causes both.


# The oldest date that a zip file can hold: with a fixed date, equal logs are equal.
_DATE = (1980, 1, 1, 0, 0, 0)


def write_log(path: Path | str, arrays: Mapping[str, npt.ArrayLike]) -> Path:
    """Write arrays so that `numpy.load` and `read_log` can read them.

    The file is replaced in one step. Entries are in alphabetical order and have a fixed
    date, so equal arrays give equal files.

    Args:
        path: The .npz file.
        arrays: Arrays of numbers or strings, by name.

    Returns:
        The path.

    Raises:
        ValueError: If an array holds Python objects.
        OSError: If the file cannot be written.
    """
    output = OutputFile(path)
    with zipfile.ZipFile(output.path, "w") as archive:
        for name in sorted(arrays):
            array = np.asarray(arrays[name])
            if array.dtype.hasobject:
                raise ValueError(
                    f"log array {name!r} must hold numbers or strings, got dtype "
                    f"{array.dtype}"
                )
            entry = zipfile.ZipInfo(f"{name}.npy", _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)
    return output.commit()


def read_log(path: Path | str) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of a log, by name.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is not a log.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            return dict(archive)
    except OSError:
        raise
    except Exception as error:  # damaged archives raise a dozen kinds
        raise ValueError(f"{path}: {one_line(error)}") from error
