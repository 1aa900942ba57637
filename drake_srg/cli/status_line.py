"""One line that says how something goes that goes on for long."""

from __future__ import annotations

import shutil
import sys
import threading
from typing import TextIO


class StatusLine:
    """A line that a terminal shows anew each time; anything else gets it once.

    Any thread may call.
    """

    def __init__(self, stream: TextIO):
        self._stream = stream
        self._terminal = stream.isatty()
        self._text = ""
        self._lock = threading.Lock()

    def show(self, text: str) -> None:
        """Show what is new."""
        with self._lock:
            if self._terminal:
                self._write(f"\r{_fitting(text)}\x1b[K")
            elif not self._text:
                self._write(f"{text}\n")
            self._text = text

    def interrupt(self, text: str) -> None:
        """Say something else, on standard error, in a line of its own."""
        with self._lock:
            if self._terminal and self._text:
                self._write("\r\x1b[K")
            print(text, file=sys.stderr, flush=True)
            if self._terminal and self._text:
                self._write(_fitting(self._text))

    def close(self) -> None:
        """Leave the line as it is."""
        with self._lock:
            if self._terminal and self._text:
                self._write("\n")
            self._text = ""

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


def _fitting(text: str) -> str:
    """What of a text fits in one line, whose last place stays free."""
    return text[: shutil.get_terminal_size().columns - 1]
