"""What the commands share as processes: exit codes, signals and files to write."""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from drake_srg.common.exceptions import ScenarioError, one_line

# Exit codes.
SUCCESS, TASK_FAILED, BAD_INPUT = 0, 1, 2
INTERRUPTED = 130  # the shells' code for Ctrl-C


def end_on_sigterm() -> None:
    """Make a request to terminate end the command as Ctrl-C does."""
    if threading.current_thread() is threading.main_thread():  # Python's own limit
        signal.signal(signal.SIGTERM, signal.default_int_handler)


@contextlib.contextmanager
def writing(
    option: str, path: Path, advise: Callable[[], str] | None = None
) -> Iterator[None]:
    """Report an OSError as bad input that names an option and its path.

    Args:
        option: As on the command line: `--out`.
        path: Its value.
        advise: Returns what to do about it, or nothing; called only if it is needed.

    Raises:
        ScenarioError: In place of the OSError.
    """
    try:
        yield
    except BrokenPipeError:  # nobody reads the output any more; nothing to report
        raise
    except OSError as error:
        # PyArrow's own messages are several sentences long.
        reason = os.strerror(error.errno) if error.errno else one_line(error)
        message = f"{option} {path}: cannot be written: {reason}"
        advice = advise() if advise is not None else ""
        raise ScenarioError(f"{message}; {advice}" if advice else message) from error


@contextlib.contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C, SIGTERM and SIGHUP (a closed terminal) set.

    A second signal of the same kind has its usual effect.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():  # Python's own limit
        yield stop
        return
    # A handler may interrupt the main thread while that holds the event's lock. Setting
    # the event there would deadlock; SimpleQueue.put is reentrant.
    signals: SimpleQueue[bool] = SimpleQueue()

    def set_once() -> None:
        if signals.get():
            stop.set()

    setter = threading.Thread(target=set_once, daemon=True)
    setter.start()

    def end(number: int, _: object) -> None:
        signals.put(True)
        signal.signal(number, before[number])

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before: dict[int, Any] = {number: signal.getsignal(number) for number in numbers}
    try:
        for each in numbers:
            signal.signal(each, end)
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signals.put(False)
        setter.join()
