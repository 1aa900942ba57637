"""The status line of a long-running command."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable
from typing import TextIO

# Time between lines without a terminal, and between changes on a terminal [s].
_LINES, _CHANGES = 60.0, 0.1


class StatusLine:
    """A status line: updated in place on a terminal, one line a minute anywhere else.

    Thread-safe. Use it as a context manager, or call `close`.

    Args:
        stream: Stream to write to; None: standard error.
        shown: Whether to show anything.
        at_once: Without a terminal: whether to print the first status at once, not
            after a minute.
        clock: Returns the time [s].
    """

    def __init__(
        self,
        stream: TextIO | None = None,
        *,
        shown: bool = True,
        at_once: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._stream = sys.stderr if stream is None else stream
        dumb = os.environ.get("TERM") == "dumb"  # it cannot erase
        self._terminal = self._stream.isatty() and not dumb
        self._shown, self._clock = shown, clock
        self._start = clock()
        self._due = self._start + (0.0 if self._terminal or at_once else _LINES)
        self._text = ""  # the text on the terminal's line
        self._lock = threading.Lock()

    def __enter__(self) -> StatusLine:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def show(self, text: str, *, last: bool = False) -> None:
        """Show a new status, unless the previous one is recent.

        Args:
            text: The status, one line.
            last: Whether to show it on a terminal even if the previous one is recent.
        """
        now = self._clock()
        with self._lock:
            if not self._shown or (now < self._due and not (last and self._terminal)):
                return
            self._due = now + (_CHANGES if self._terminal else _LINES)
            if self._terminal:
                self._text = text
                self._write(f"\r{_fitting(text)}\x1b[K")
            else:
                self._write(f"{text}\n")

    def count(self, done: int, total: int, words: str, begun: int = 0) -> None:
        """Show how many parts of equal length are done, and the time that is left.

        Args:
            done: Number of parts that are done.
            total: Number of all parts.
            words: Text after the count.
            begun: Number of parts that were done when this line was made.
        """
        elapsed = self._clock() - self._start
        times = f"{_minutes(elapsed)} elapsed"
        if begun < done < total:
            left = elapsed * (total - done) / (done - begun)
            times += f", {_minutes(left)} left"
        self.show(f"{done}/{total} {words} [{times}]", last=done == total)

    def interrupt(self, text: str, tell: Callable[[str], None] | None = None) -> None:
        """Print a message on a line of its own.

        Args:
            text: The message.
            tell: Function that prints it; None prints to standard error.
        """
        with self._lock:
            if self._text:
                self._write("\r\x1b[K")
            if tell is None:
                with contextlib.suppress(OSError):
                    print(text, file=sys.stderr, flush=True)
            else:
                tell(text)
            if self._text:
                self._write(_fitting(self._text))

    def close(self) -> None:
        """Leave the line as it is and move on to the next one."""
        with self._lock:
            if self._text:
                self._write("\n")
            self._text = ""

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except BrokenPipeError:  # the reader is gone
            raise
        except OSError:  # such as a full disk: losing a status does no harm
            pass


def _minutes(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02}"


def _fitting(text: str) -> str:
    """Return as much of a text as fits on a line, leaving the last column free."""
    return text[: shutil.get_terminal_size().columns - 1]
