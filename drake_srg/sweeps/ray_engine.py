"""Runs trials on a Ray cluster, whose nodes send their results and share no files.

Every node needs the same version and the same files of drake_srg.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any, TypeVar

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.sweeps.engines import THREADS, usable_cores
from drake_srg.sweeps.info import current_versions, version_difference
from drake_srg.sweeps.rows import require_sweep

T = TypeVar("T")

_PATIENCE = 5.0  # for a cluster that does not answer [s]


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
            errors.ObjectLostError,  # when the node that held the result has gone
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
        # "local" starts a cluster of our own: without any address, Ray would connect to
        # whatever cluster runs on this machine.
        options: dict[str, Any] = {"address": address or "local"}
        if not address:
            options |= {"num_cpus": usable_cores(), "include_dashboard": False}
        try:
            if address:
                _reach(address)
            with _own_signals():
                self._ray.init(**options, log_to_driver=False, logging_level="ERROR")
        except (ConnectionError, RuntimeError, ValueError, OSError) as error:
            raise ScenarioError(
                f"--address {address or '(none)'}: cannot connect to Ray: "
                f"{one_line(error)}"
            ) from error

    def _check_versions(self) -> None:
        """Fail before the first trial if it could not run."""
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
    """Raise an OSError if nothing listens there; Ray would wait for a long time."""
    _, _, place = address.rpartition("://")
    host, colon, port = place.partition(":")
    if colon and port.isdigit():
        socket.create_connection((host, int(port)), _PATIENCE).close()


def call_on_node(
    versions: dict[str, str], function: Callable[..., T], *arguments: Any
) -> T:
    """Call a function on a node, if the node has the same versions as the sweep.

    Every call checks, because nodes may join later.

    Raises:
        ScenarioError: If the versions differ, which could change rows.
    """
    different = version_difference(current_versions(), versions)
    if different:
        name, there, here = different
        raise ScenarioError(
            f"--engine ray: {name} {there} on {socket.gethostname()}, {here} here; "
            "install the same on all nodes"
        )
    return function(*arguments)


@contextlib.contextmanager
def _own_signals() -> Iterator[None]:
    """Restore the handler of SIGTERM, which Ray replaces."""
    if threading.current_thread() is not threading.main_thread():  # Python's own limit
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
