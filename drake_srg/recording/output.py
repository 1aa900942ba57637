"""What recorders share: files that appear when complete, and logs."""

from __future__ import annotations

import contextlib
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
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
    """Make a folder for results; remove it again if nothing is written into it.

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
            with contextlib.suppress(OSError):  # the folder is not empty
                path.rmdir()
        raise


class OutputFile:
    """A file that appears under its name only when it is complete.

    It is written as `path`, in a hidden folder beside `target`, so that `commit` is a
    rename. The folder disappears with the object, whether the file is complete or not.

    Attributes:
        target: The final path.
        path: The path to write to until `commit`.

    Raises:
        OSError: If nothing can be written beside `target`; it names the folder.
    """

    def __init__(self, target: Path | str):
        self.target = Path(target)
        try:
            self.target.parent.mkdir(parents=True, exist_ok=True)
            self._folder = tempfile.TemporaryDirectory(
                prefix=f".{self.target.name}.", dir=self.target.parent
            )
        except OSError as error:
            folder = str(self.target.parent)
            raise OSError(error.errno, error.strerror, folder) from error
        self.path = Path(self._folder.name) / self.target.name

    def commit(self) -> Path:
        """Move the file to `target`, replacing what was there; returns `target`."""
        self.path.replace(self.target)
        self.discard()
        return self.target

    def discard(self) -> None:
        """Delete what was written."""
        self._folder.cleanup()


class Recorder(LeafSystem):
    """A system that writes a file until it is closed; use it as a context manager.

    An error or the user's interrupt ends the recording, which is kept as a complete
    file, because it shows what led there.
    """

    _output: OutputFile
    _closed = False
    _failed = False  # an error ended the recording

    @property
    def path(self) -> Path:
        """The file's path after `close()`."""
        return self._output.target

    def close(self) -> None:
        """Complete the file and move it to `path`, unless there is nothing to keep.

        Raises:
            OSError: If the file cannot be completed; an earlier one stays in place.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if self._finish():
                self._output.commit()
        finally:
            self._output.discard()

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
        self._failed = kind is not None and issubclass(kind, Exception)
        try:
            self.close()
        except Exception:
            if kind is None:
                raise
            # Otherwise the first error is raised: a full disk causes both.


# The oldest date that a zip file can hold: equal logs must not differ by their date.
_DATE = (1980, 1, 1, 0, 0, 0)


def write_log(path: Path | str, arrays: Mapping[str, npt.ArrayLike]) -> Path:
    """Write arrays so that `numpy.load` and `read_log` can read them.

    The file is replaced in one step, never half written. Names are stored in
    alphabetical order and with a fixed date, so equal arrays give equal files.

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
    except Exception as error:  # whatever damaged archives raise: a dozen kinds
        raise ValueError(f"{path}: {one_line(error)}") from error
