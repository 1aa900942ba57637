"""Keeps the replay of the first of many runs that are not recorded."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path

_folder: ContextVar[Path | None] = ContextVar("folder", default=None)


@contextlib.contextmanager
def keep_first_replay(folder: Path | None) -> Iterator[None]:
    """Have the first `Simulate` without `out` write its replay and log to a folder.

    Args:
        folder: The folder; None: keep none.
    """
    token = _folder.set(folder)
    try:
        yield
    finally:
        _folder.reset(token)


def take_folder() -> Path | None:
    """Return the folder for this run's replay, and None from then on."""
    folder = _folder.get()
    _folder.set(None)
    return folder
