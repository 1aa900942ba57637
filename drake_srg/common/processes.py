"""Processes of our own that a terminal's Ctrl-C must not end."""

import signal
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess

_FROM_A_TERMINAL = {signal.SIGINT, signal.SIGHUP}


def start_shielded(process: BaseProcess) -> None:
    """Start a process that Ctrl-C in a terminal, or closing it, does not end.

    These signals are meant for the parent alone, which ends the process in order. The
    process inherits a mask, because a signal may arrive before it could install a
    handler.
    """
    # With the first process, `multiprocessing` starts this one, and then unblocks
    # SIGINT.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _FROM_A_TERMINAL)
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
