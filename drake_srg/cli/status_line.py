"""The status line of a long-running command."""

from __future__ import annotations

import shutil
import sys
import threading
from typing import TextIO


class StatusLine:
    """A status line: updated in place on a terminal, printed once anywhere else.

    Any thread may call.

    Args:
        stream: Where to write it.
    """

    def __init__(self, stream: TextIO):
        self._stream = stream
        self._terminal = stream.isatty()
        self._text = ""
        self._lock = threading.Lock()

    def show(self, text: str) -> None:
        """Show a new status."""
        with self._lock:
            if self._terminal:
                self._write(f"\r{_fitting(text)}\x1b[K")
            elif not self._text:
                self._write(f"{text}\n")
            self._text = text

    def interrupt(self, text: str) -> None:
        """Print a message on standard error, on a line of its own."""
        with self._lock:
            if self._terminal and self._text:
                self._write("\r\x1b[K")
            print(text, file=sys.stderr, flush=True)
            if self._terminal and self._text:
                self._write(_fitting(self._text))

    def close(self) -> None:
        """Leave the line as it is and move on to the next one."""
        with self._lock:
            if self._terminal and self._text:
                self._write("\n")
            self._text = ""

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


def _fitting(text: str) -> str:
    """Return as much of a text as fits on a line, leaving the last column free."""
    return text[: shutil.get_terminal_size().columns - 1]
