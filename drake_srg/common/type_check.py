"""Checks the types of what was read from a file."""

from __future__ import annotations

import types
import typing
from typing import TypeVar

T = TypeVar("T")


def checked_types(read: T) -> T:
    """Return a dataclass if its values have the types of its annotations.

    Entries of lists and mappings are not checked.

    Raises:
        TypeError: If one has not.
    """
    for name, hint in typing.get_type_hints(type(read)).items():
        union = isinstance(hint, types.UnionType)
        kind = hint if union else typing.get_origin(hint) or hint
        value = getattr(read, name)
        if not isinstance(value, kind):
            raise TypeError(f"{name}: must be {kind}, got {value!r}")
    return read
