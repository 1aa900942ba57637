"""Values that all copies of a Context share."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any, Self

import numpy as np


class Shared:
    """A value in a Context that all copies of the Context share.

    Drake copies contexts at every step, and a deep copy of a large value costs more
    than the step. Derive a frozen dataclass from this class, and replace the value
    instead of changing it. Its arrays become read-only, so code that writes to one
    raises a ValueError instead of changing other contexts.
    """

    def __post_init__(self) -> None:
        for part in vars(self).values():
            make_read_only(part)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


def make_read_only(value: object, earlier: object = None) -> None:
    """Make all arrays in a value read-only.

    Args:
        value: An array, or a dataclass, a mapping, a list or a tuple with arrays at any
            depth. Arrays in a `Shared` value are read-only already.
        earlier: A value whose arrays are read-only. Parts that `value` shares with it
            are skipped: at each update of a planner, nearly all of them.
    """
    if value is earlier or value is None or isinstance(value, float | int | str):
        return  # the most frequent case first, to save time
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, tuple | list):
        for part in value:
            make_read_only(part)
    elif isinstance(value, Mapping):
        for part in value.values():
            make_read_only(part)
    elif dc.is_dataclass(value) and not isinstance(value, type | Shared):
        before = vars(earlier) if type(earlier) is type(value) else {}
        for name, part in vars(value).items():
            make_read_only(part, before.get(name))
