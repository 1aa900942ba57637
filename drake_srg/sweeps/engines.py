"""Where trials run: in processes of this machine; for a cluster see `ray_engine`.

An engine works in processes of its own, also where it is only one, so that nothing
depends on how many there are.
"""

from __future__ import annotations

import contextlib
import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future
from types import TracebackType
from typing import Any, Protocol, TypeVar

from tqdm import tqdm

from drake_srg.sweeps.rows import require_sweep

T = TypeVar("T")

# One thread a worker: software rendering would otherwise take the other workers' cores.
# 0: no threads besides.
THREADS = {
    "LP_NUM_THREADS": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}

_WATCH_PERIOD = 1.0  # of a worker, whether its parent is still there [s]
# For loky's thread to take a function, which it does within milliseconds; longer than
# this it is gone, and Ctrl-C must still end the sweep [s].
_TAKE_TIMEOUT = 1.0


class Engine(Protocol):
    """Runs functions in other processes, from `__enter__` to `__exit__`.

    Attributes:
        name: What `--engine` knows it by.
        jobs: How many functions run at a time; None: it depends.
        deaths: The errors of a future whose worker has died.
        shares_files: Whether what functions write to files can be read here.
    """

    name: str
    jobs: int | None
    deaths: tuple[type[BaseException], ...]
    shares_files: bool

    def __enter__(self) -> Engine:
        """Make ready.

        Raises:
            ScenarioError: If it cannot be reached.
        """

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop all that runs, at once."""

    def slots(self) -> int:
        """Return how many functions run at a time."""

    def submit(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Let a function of a module run; no more than `slots` at a time."""


class JoblibEngine:
    """Processes of this machine: the executor of joblib's `loky` backend.

    Used directly, as `joblib.Parallel` runs a single job in the caller's process.
    """

    name = "joblib"
    deaths: tuple[type[BaseException], ...] = (BrokenExecutor,)
    shares_files = True

    def __init__(self, jobs: int):
        self.jobs: int | None = jobs
        self._workers = jobs
        self._loky = require_sweep("joblib.externals.loky")
        self._executor: Any = None
        self._given: Future[Any] | None = None  # the last function
        self._scratch: tempfile.TemporaryDirectory[str] | None = None

    def __enter__(self) -> JoblibEngine:
        # For temporary files, which a worker that is killed leaves behind.
        self._scratch = tempfile.TemporaryDirectory(prefix="drake_srg_sweep_")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, *_: BaseException | TracebackType | None
    ) -> None:
        self._stop(kill=kind is not None)
        if self._scratch is not None:
            self._scratch.cleanup()

    def slots(self) -> int:
        """Return the number of processes."""
        return self._workers

    def submit(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Let a function run; where a worker has died, all of them are new."""
        with _interrupts_later():  # or the executor would be left torn
            if self._executor is not None:
                try:
                    return self._give(function, *arguments)
                except BrokenExecutor:
                    self._stop(kill=True)
            assert self._scratch is not None, "submit to an engine that is not entered"
            with _interrupts_ignored():
                self._executor = self._loky.ProcessPoolExecutor(
                    self._workers,
                    env={**THREADS, "TMPDIR": self._scratch.name},
                    initializer=_begin_worker,
                    initargs=(os.getpid(),),
                )
                return self._give(function, *arguments)

    def _give(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        future: Future[T] = self._executor.submit(function, *arguments)
        self._given = future
        return future

    def _stop(self, kill: bool) -> None:
        if self._executor is None:
            return
        # A kill, as of Ctrl-C, drops functions that loky's thread has yet to take, and
        # it would fall over what is no longer there, with a traceback.
        deadline = time.monotonic() + _TAKE_TIMEOUT
        while self._given and not (self._given.running() or self._given.done()):
            if time.monotonic() > deadline:
                break
            time.sleep(0.001)
        self._executor.shutdown(wait=True, kill_workers=kill)
        self._executor = None


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextlib.contextmanager
def _interrupts_later() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM wait until the end."""
    if not _in_main_thread():
        yield
        return
    came: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _: came.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        signal.raise_signal(came[0])


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignore Ctrl-C; processes that are started meanwhile do so for life."""
    if not _in_main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _in_main_thread() -> bool:
    """Whether signals can be handled here: Python's own limit."""
    return threading.current_thread() is threading.main_thread()


def _begin_worker(parent: int) -> None:
    """Prepare a worker, which ends once its parent is gone: nobody else tells it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of one that replaces another
    # A lock between processes, tqdm's own, would be left behind by a worker's end.
    tqdm.set_lock(threading.RLock())

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH_PERIOD)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
