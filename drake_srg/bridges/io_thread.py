"""A thread with an event loop for the sockets of a bridge."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from concurrent import futures
from typing import Any, TypeVar

_T = TypeVar("_T")
_PATIENCE = 5.0  # how long to wait for cancelled tasks to end [s]


class IoThread:
    """An asyncio event loop that runs in a thread until it is stopped.

    Args:
        name: The thread's name, for debugging.

    Attributes:
        loop: The event loop.
    """

    def __init__(self, name: str):
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def call(self, coroutine: Coroutine[Any, Any, _T], timeout: float = 5.0) -> _T:
        """Run a coroutine in the thread and return its result.

        Raises:
            TimeoutError: If it takes longer than `timeout` [s]; it is cancelled.
        """
        future = asyncio.run_coroutine_threadsafe(coroutine, self.loop)
        try:
            return future.result(timeout)
        except futures.TimeoutError:  # a class of its own up to Python 3.10
            future.cancel()
            raise TimeoutError(f"not done within {timeout:g} s") from None

    def post(self, function: Callable[..., object], *arguments: Any) -> None:
        """Call a function in the thread soon, without waiting for it."""
        self.loop.call_soon_threadsafe(function, *arguments)

    def stop(self) -> None:
        """Cancel all tasks and end the thread, or give up after `_PATIENCE`."""
        if self._thread.is_alive():
            self.loop.call_soon_threadsafe(self.loop.stop)
            self._thread.join(_PATIENCE)

    def _run(self) -> None:
        asyncio.set_event_loop(self.loop)
        self.loop.run_forever()
        tasks = asyncio.all_tasks(self.loop)
        for task in tasks:
            task.cancel()
        self.loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        self.loop.close()
