"""Engines that run trials: processes on this machine, or a Ray cluster.

Trials never run in the caller's process, so even with one process, they behave as with
many. Every node of a cluster needs the same version and the same files of drake_srg.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Future
from types import TracebackType
from typing import Any, Protocol, TypeVar

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.sweeps.info import current_versions, version_difference
from drake_srg.sweeps.rows import require_sweep

T = TypeVar("T")

# One thread per worker, or software rendering would take the other workers' cores.
# LP_NUM_THREADS counts additional threads only.
THREADS = {
    "LP_NUM_THREADS": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}

_WATCH_PERIOD = 1.0  # time between a worker's checks that its parent is alive [s]
# Longest wait until loky's thread has accepted a function [s]. It needs milliseconds.
# If it takes longer, it has died, and Ctrl-C must still end the sweep.
_TAKE_TIMEOUT = 1.0


class Engine(Protocol):
    """Runs functions in other processes, from `__enter__` to `__exit__`.

    Attributes:
        name: Its name for `--engine`.
        jobs: Number of functions that run at a time; None: it varies.
        deaths: Exceptions that a future raises if its worker died.
        shares_files: Whether this process can read the files that functions write.
    """

    name: str
    jobs: int | None
    deaths: tuple[type[BaseException], ...]
    shares_files: bool

    def __enter__(self) -> Engine:
        """Get ready to run functions.

        Raises:
            ScenarioError: If the engine cannot be reached.
        """

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop all running functions at once."""

    def slots(self) -> int:
        """Return the number of functions that run at a time."""

    def submit(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Run a function of a module; at most `slots` at a time."""


class JoblibEngine:
    """Processes on this machine: the executor of joblib's `loky` backend.

    It is used directly, because `joblib.Parallel` would run a single job in the
    caller's process.

    Args:
        jobs: Number of processes.
    """

    name = "joblib"
    deaths: tuple[type[BaseException], ...] = (BrokenExecutor,)
    shares_files = True

    def __init__(self, jobs: int):
        self.jobs: int | None = jobs
        self._workers = jobs
        self._loky = require_sweep("joblib.externals.loky")
        self._executor: Any = None
        self._given: Future[Any] | None = None  # the last one submitted
        self._scratch: tempfile.TemporaryDirectory[str] | None = None

    def __enter__(self) -> JoblibEngine:
        # Receives temporary files, which a killed worker would leave behind.
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
        """Run a function; start new workers if one has died."""
        with _interrupts_later():  # an interrupted executor would be unusable
            if self._executor is not None:
                try:
                    return self._give(function, *arguments)
                except BrokenExecutor:
                    self._stop(kill=True)
            assert self._scratch is not None, "enter the engine before submitting"
            with _handling(_IGNORED):
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
        # If workers are killed, as by Ctrl-C, before loky's thread has accepted the
        # last function, the thread ends in a traceback. So wait for that.
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
def _handling(handlers: Mapping[signal.Signals, Any]) -> Iterator[None]:
    """Use these signal handlers until the block has ended."""
    if threading.current_thread() is not threading.main_thread():
        yield  # Python handles signals only in the main thread
        return
    before = {number: signal.signal(number, own) for number, own in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _interrupts_later() -> Iterator[None]:
    """Delay Ctrl-C, SIGTERM and SIGHUP until the block has ended."""
    came: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    with _handling(dict.fromkeys(numbers, lambda number, _: came.append(number))):
        yield
    if came:
        signal.raise_signal(came[0])


# Processes that are started with these handlers inherit them.
_IGNORED = {signal.SIGINT: signal.SIG_IGN, signal.SIGHUP: signal.SIG_IGN}


def _begin_worker(parent: int) -> None:
    """Prepare a worker, and let it end when its parent has died."""
    # A worker that replaces a dead one has not inherited these handlers.
    for number, handler in _IGNORED.items():
        signal.signal(number, handler)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH_PERIOD)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


_PATIENCE = 5.0  # longest wait for a cluster's answer [s]


class RayEngine:
    """A Ray cluster, with one core per trial.

    Args:
        address: The cluster's address, as for `ray.init`. None: $RAY_ADDRESS; if that
            is not set, Ray runs on this machine from `__enter__` to `__exit__`.
    """

    name = "ray"
    jobs: int | None = None
    shares_files = False

    def __init__(self, address: str | None = None):
        self._address = address
        self._ray = require_sweep("ray", extra="sweep,ray")
        errors = self._ray.exceptions
        self.deaths: tuple[type[BaseException], ...] = (
            errors.WorkerCrashedError,
            errors.NodeDiedError,
            errors.OutOfMemoryError,
            errors.ObjectLostError,  # if the node with the result has gone
            errors.LocalRayletDiedError,
        )
        self._ours = False
        self._running: set[Any] = set()
        self._call: Any = None
        self._versions = current_versions()

    def __enter__(self) -> RayEngine:
        self._ours = not self._ray.is_initialized()
        with contextlib.ExitStack() as stack:
            stack.callback(self._stop)
            if self._ours:
                self._connect()
            # No retries: the sweep runs such trials again, and counts the deaths.
            self._call = self._ray.remote(
                num_cpus=1, max_retries=0, runtime_env={"env_vars": THREADS}
            )(call_on_node)
            self._check_versions()
            stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()

    def _connect(self) -> None:
        address = self._address or os.environ.get("RAY_ADDRESS")
        # "local" starts a new cluster. Without an address, Ray would connect to any
        # cluster that runs on this machine.
        options: dict[str, Any] = {"address": address or "local"}
        if not address:
            options |= {"num_cpus": usable_cores(), "include_dashboard": False}
        try:
            if address:
                _reach(address)
            # Ray replaces the handler of SIGTERM.
            with _handling({signal.SIGTERM: signal.getsignal(signal.SIGTERM)}):
                self._ray.init(**options, log_to_driver=False, logging_level="ERROR")
        except (ConnectionError, RuntimeError, ValueError, OSError) as error:
            raise ScenarioError(
                f"--address {address or '(none)'}: cannot connect to Ray: "
                f"{one_line(error)}"
            ) from error

    def _check_versions(self) -> None:
        """Fail before the first trial if trials could not run."""
        try:
            self.submit(os.getpid).result()
        except self._ray.exceptions.RayError as error:
            cause = getattr(error, "cause", None)
            if isinstance(cause, ScenarioError):
                raise cause from error
            raise ScenarioError(
                "--engine ray: the cluster cannot run drake_srg; install it on all "
                f"nodes: {str(error).strip().splitlines()[-1]}"
            ) from error

    def _stop(self) -> None:
        if self._ours:
            self._ray.shutdown()
            return
        for reference in list(self._running):
            self._ray.cancel(reference, force=True)

    def slots(self) -> int:
        """Return the number of cores that the cluster has at the moment."""
        return max(1, int(self._ray.cluster_resources().get("CPU", 1)))

    def submit(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Run a function on any node."""
        reference = self._call.remote(self._versions, function, *arguments)
        self._running.add(reference)
        future: Future[T] = reference.future()
        future.add_done_callback(lambda _: self._running.discard(reference))
        return future


def _reach(address: str) -> None:
    """Raise an OSError if nothing listens at an address; Ray would wait much longer."""
    _, _, place = address.rpartition("://")
    host, colon, port = place.partition(":")
    if colon and port.isdigit():
        socket.create_connection((host, int(port)), _PATIENCE).close()


def call_on_node(
    versions: dict[str, str], function: Callable[..., T], *arguments: Any
) -> T:
    """Call a function on a node, if the node has the same versions as the sweep.

    Every call checks them, because nodes may join later.

    Raises:
        ScenarioError: If versions differ and could change rows.
    """
    different = version_difference(current_versions(), versions)
    if different:
        name, there, here = different
        raise ScenarioError(
            f"--engine ray: {name} {there} on {socket.gethostname()}, {here} here; "
            "install the same on all nodes"
        )
    return function(*arguments)
