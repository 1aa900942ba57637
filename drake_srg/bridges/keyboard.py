"""The keys of a terminal as an emergency stop."""

import contextlib
import os
import select
import signal
import termios
import threading
import tty

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox

# Topics and data by key.
_KEYS = {
    "e": [("/estop", True)],
    "r": [("/estop", False), ("/release", True)],
}


class KeyboardBridge(Bridge):
    """Commands a safety monitor by keys: `e` stops the arm, `r` releases it.

    The terminal shows no keys and hands them on one by one until the bridge is closed.
    Ctrl-C keeps its meaning.

    Args:
        inbox: Where the commands go.
        terminal: File descriptor of the terminal.
    """

    def __init__(self, inbox: CommandInbox, terminal: int) -> None:
        self._inbox, self._terminal = inbox, terminal
        self._before = termios.tcgetattr(terminal)
        tty.setcbreak(terminal)
        self._end, self._closing = os.pipe()
        self._lock, self._open = threading.Lock(), True
        self._thread = threading.Thread(target=self._run, name="keys", daemon=True)
        self._thread.start()

    @property
    def status(self) -> str:
        """The keys, as text for the status line."""
        return "keys e stop, r release"

    @property
    def closed(self) -> bool:
        """True, so that it keeps no station alive that clients have shut down."""
        return True

    def close(self) -> None:
        """Give the terminal back. A second call does nothing."""
        with self._lock:
            if not self._open:
                return
            self._open = False
        os.close(self._closing)
        self._thread.join()
        os.close(self._end)
        # In the background, the signal would stop the whole process.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTTOU])
        with contextlib.suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(self._terminal, termios.TCSADRAIN, self._before)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)

    def _run(self) -> None:
        while True:
            ready, _, _ = select.select([self._terminal, self._end], [], [])
            if self._end in ready:
                return
            try:
                typed = os.read(self._terminal, 64)
            except OSError:  # the terminal is gone
                return
            if not typed:
                return
            for key in typed.decode(errors="ignore"):
                for topic, data in _KEYS.get(key, ()):
                    self._inbox.receive(topic, data)


def own_terminal(stream: object) -> int | None:
    """Return the descriptor of a stream if this process may read keys from it."""
    try:
        descriptor: int = stream.fileno()  # type: ignore[attr-defined]  # or no file
        foreground = os.tcgetpgrp(descriptor) == os.getpgrp()
    except (AttributeError, OSError, ValueError):  # no file, or no terminal
        return None
    return descriptor if foreground else None
