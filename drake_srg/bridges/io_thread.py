"""A thread of its own for the sockets of a bridge."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from concurrent import futures
from typing import Any, TypeVar

_T = TypeVar("_T")
_PATIENCE = 5.0  # with a task that does not end when it is cancelled [s]


class IoThread:
    """An asyncio event loop that runs in a thread until it is stopped.

    Args:
        name: Of the thread, for people who debug.
    """

    def __init__(self, name: str):
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def call(self, coroutine: Coroutine[Any, Any, _T], timeout: float = 5.0) -> _T:
        """Run a coroutine there and return its result, waiting `timeout` [s] at most.

        Raises:
            TimeoutError: If it takes longer; it is cancelled then.
        """
        future = asyncio.run_coroutine_threadsafe(coroutine, self.loop)
        try:
            return future.result(timeout)
        except futures.TimeoutError:  # up to Python 3.10 not the one of builtins
            future.cancel()
            raise TimeoutError(f"not done within {timeout:g} s") from None

    def post(self, function: Callable[..., object], *arguments: Any) -> None:
        """Call a function there soon, without waiting for it."""
        self.loop.call_soon_threadsafe(function, *arguments)

    def stop(self) -> None:
        """Cancel what still runs there and end the thread, if it lets itself."""
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
