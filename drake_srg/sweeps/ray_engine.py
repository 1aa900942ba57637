"""Trials on a cluster, by Ray. The nodes share no files: what comes of a trial is sent.

drake_srg must be installed on every node, in the same version.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any, TypeVar

from drake_srg.errors import ScenarioError, one_line
from drake_srg.sweeps.engines import THREADS, usable_cores
from drake_srg.sweeps.rows import require_sweep

T = TypeVar("T")


class RayEngine:
    """A Ray cluster, one core a trial.

    Args:
        address: Of the cluster, as for `ray.init`; None: $RAY_ADDRESS, and without
            that Ray is started on this machine, and stopped in the end.
    """

    name = "ray"
    jobs: int | None = None

    def __init__(self, address: str | None = None):
        self._address = address
        self._ray = require_sweep("ray", extra="sweep,ray")
        errors = self._ray.exceptions
        self.deaths: tuple[type[BaseException], ...] = (
            errors.WorkerCrashedError,
            errors.NodeDiedError,
            errors.OutOfMemoryError,
            errors.ObjectLostError,  # with the node that held the result
            errors.LocalRayletDiedError,
        )
        self._ours = False
        self._running: set[Any] = set()
        self._call: Any = None

    def __enter__(self) -> RayEngine:
        ray = self._ray
        self._ours = not ray.is_initialized()
        if self._ours:
            address = self._address or os.environ.get("RAY_ADDRESS")
            own = {} if address else {"num_cpus": usable_cores()}
            try:
                with _own_signals():
                    ray.init(
                        address=address,
                        include_dashboard=None if address else False,
                        log_to_driver=False,
                        logging_level="ERROR",
                        **own,
                    )
            except (ConnectionError, RuntimeError, ValueError, OSError) as error:
                raise ScenarioError(
                    f"--address {address or '(none)'}: no Ray there: {one_line(error)}"
                ) from error
        # A trial whose worker dies is given out anew by the sweep, which counts.
        self._call = ray.remote(num_cpus=1, max_retries=0)(_call)
        return self

    def __exit__(self, *_: object) -> None:
        if self._ours:
            self._ray.shutdown()
            return
        for reference in self._running:
            self._ray.cancel(reference, force=True)

    def slots(self) -> int:
        """Return the number of cores that the cluster has now."""
        return max(1, int(self._ray.cluster_resources().get("CPU", 1)))

    def submit(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Let a function run on some node."""
        reference = self._call.remote(function, *arguments)
        self._running.add(reference)
        future: Future[T] = reference.future()
        future.add_done_callback(lambda _: self._running.discard(reference))
        return future


def _call(function: Callable[..., T], *arguments: Any) -> T:
    os.environ.update(THREADS)  # read when the first image is rendered
    return function(*arguments)


@contextlib.contextmanager
def _own_signals() -> Iterator[None]:
    """Keep what SIGTERM does here, which Ray would replace."""
    if threading.current_thread() is not threading.main_thread():  # Python's own limit
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
