"""What the recorders share: files that appear whole, and the optional packages."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, TracebackType
from typing import TypeVar

from drake_srg.common import installing
from drake_srg.lifetime import LeafSystem

_Self = TypeVar("_Self", bound="Recorder")


def require(module: str) -> ModuleType:
    """Import a module of the `recording` extra.

    Raises:
        ImportError: If it is missing; the message says how to install it.
    """
    return installing.require(module, "recording", "Recording needs")


@contextlib.contextmanager
def output_folder(out: Path | None) -> Iterator[None]:
    """Make a folder for results; one that is made for nothing does not stay.

    Args:
        out: The folder; None makes none.

    Raises:
        OSError: At the start, if nothing can be written there.
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
            with contextlib.suppress(OSError):  # of a folder with something in it
                path.rmdir()
        raise


class OutputFile:
    """A file that appears under its name only when it is complete.

    It is written as `path`, in a hidden folder beside its place, so that putting it
    there is a rename. The folder disappears with the object, complete or not.

    Attributes:
        target: The final place.
        path: Where to write until `commit`.

    Raises:
        OSError: If nothing can be written beside `target`; the message says why.
    """

    def __init__(self, target: Path | str):
        self.target = Path(target)
        try:
            self.target.parent.mkdir(parents=True, exist_ok=True)
            self._folder = tempfile.TemporaryDirectory(
                prefix=f".{self.target.name}.", dir=self.target.parent
            )
        except OSError as error:
            raise OSError(
                f"Cannot write {self.target}: {error.strerror} ({error.filename}). "
                "Choose a folder that exists, or can be made, and is writable."
            ) from error
        self.path = Path(self._folder.name) / self.target.name

    def commit(self) -> Path:
        """Put what was written in its place, over what was there; returns `target`."""
        self.path.replace(self.target)
        self.discard()
        return self.target

    def discard(self) -> None:
        """Forget what was written."""
        self._folder.cleanup()


class Recorder(LeafSystem):
    """A system that writes a file until it is closed, as a context manager.

    What was recorded before an error, or before the user interrupts, is kept: a whole
    file that ends there, as it shows what led to it.
    """

    _output: OutputFile
    _closed = False
    _failed = False  # an error ended what was to be recorded

    @property
    def path(self) -> Path:
        """Where the file is after `close()`."""
        return self._output.target

    def close(self) -> None:
        """Finish the file and put it in its place, if it is one with what was recorded.

        Raises:
            OSError: If it cannot be finished; what was there before stays.
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
        """Complete the file, and say whether it is worth keeping."""
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
            # Else the error that came first is told: a full disk has both.
