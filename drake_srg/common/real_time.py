"""Real-time loops, and processes that run beside them."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing as mp
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from multiprocessing import resource_tracker
from typing import Any

# Time after which a thread yields the interpreter to one that waits for it [s].
# Python's default of 5 ms adds up: to answer a message takes several such switches.
_SWITCH = 5e-4
_NICE = 10  # see nice(1)


@contextlib.contextmanager
def real_time_loop() -> Iterator[None]:
    """Keep garbage collection and thread switches from delaying a real-time loop.

    A full garbage collection visits every module and cache, which takes a tenth of a
    second. In this context, the collector visits only new objects. Waiting threads get
    the interpreter after 0.5 ms instead of 5 ms.
    """
    switch = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(_SWITCH)
    try:
        yield
    finally:
        sys.setswitchinterval(switch)
        gc.unfreeze()


def lower_priority() -> None:
    """Give this process less priority than the real-time loop or simulation."""
    os.nice(_NICE)


_FROM_A_TERMINAL = {signal.SIGINT, signal.SIGHUP}
_PATIENCE = 2.0  # how long to wait for the process and the thread to end [s]


class Companion:
    """A process to exchange messages with; a thread receives its replies.

    Ctrl-C in the terminal, or closing the terminal, does not end the process. Only the
    parent handles these signals, and then ends the process in an orderly way.

    Args:
        name: Name of the thread.
        run: Called in the process as `run(connection, *arguments)`.
        arguments: Picklable. Drake's schema objects are not, but their YAML is.
        receive: Called in the thread with each message of the process.
        ended: Called in the thread if the process ends before it is closed.
    """

    def __init__(
        self,
        name: str,
        run: Callable[..., None],
        arguments: tuple[Any, ...],
        receive: Callable[[Any], None],
        ended: Callable[[], None],
    ) -> None:
        self._receive, self._ended, self._closing = receive, ended, False
        context = mp.get_context("spawn")  # threads do not survive a fork
        self._connection, theirs = context.Pipe()
        self._process = context.Process(
            target=run, args=(theirs, *arguments), daemon=True
        )
        self._start()
        theirs.close()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def send(self, message: Any) -> None:
        """Send the process a message; do nothing if it has ended."""
        with contextlib.suppress(OSError):
            self._connection.send(message)

    def close(self) -> None:
        """End the process."""
        self._closing = True
        self._process.terminate()
        self._process.join(_PATIENCE)
        self._process.kill()  # in case it did not react
        self._process.join()
        self._thread.join(_PATIENCE)
        self._connection.close()

    def _start(self) -> None:
        """Start the process with signals masked: one may arrive before any handler."""
        # Otherwise `multiprocessing` starts its resource tracker with the first
        # process, and unblocks SIGINT.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _FROM_A_TERMINAL)
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _run(self) -> None:
        while True:
            try:
                message = self._connection.recv()
            except (EOFError, OSError):
                if not self._closing:
                    self._ended()
                return
            self._receive(message)
