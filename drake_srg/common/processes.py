"""Processes of our own that work beside this one."""

import contextlib
import multiprocessing as mp
import signal
import threading
from collections.abc import Callable
from multiprocessing import resource_tracker
from typing import Any

_FROM_A_TERMINAL = {signal.SIGINT, signal.SIGHUP}
_PATIENCE = 2.0  # how long to wait for the process and the thread to end [s]


class Companion:
    """A process that gets messages and sends others, which a thread receives.

    Ctrl-C in a terminal, or closing it, does not end it. These signals are meant for
    the parent alone, which ends the process in order.

    Args:
        name: Of the thread.
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
        """Send the process a message; does nothing if it has ended."""
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
        # With the first process, `multiprocessing` starts this one, and then unblocks
        # SIGINT.
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
