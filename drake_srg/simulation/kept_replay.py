"""Keeps the replay of the first of many runs that are not recorded.

Experiments differ in how and how deep they call `Simulate`. A parameter would have to
go through the signature of every trial function between `run_experiment` and there,
to serve a by-product. The variable belongs to one context (PEP 567): it does not
reach workers or other threads, and ends with the `with` block.
"""

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
