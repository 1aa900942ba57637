"""Exceptions with messages for users, and the check of types read from a file.

This module must not import Drake: the command line needs it even where importing Drake
fails.
"""

from __future__ import annotations

import contextlib
import difflib
import types
import typing
from collections.abc import Iterable, Iterator
from typing import TypeVar

from drake_srg.config import ScenarioError as ScenarioError  # noqa: PLC0414 (re-export)


@contextlib.contextmanager
def scenario_errors(name: str = "") -> Iterator[None]:
    """Turn exceptions raised while a scenario's systems are built into ScenarioErrors.

    Drake and our systems check many settings only then. Use this in a `with` statement
    or as a decorator.

    Args:
        name: Start of the message, such as the scenario's name; empty for none.
    """
    try:
        yield
    except (RuntimeError, ValueError, FileNotFoundError, SystemExit) as error:
        if isinstance(error, ScenarioError) and not name:
            raise
        message = one_line(error)
        raise ScenarioError(f"{name}: {message}" if name else message) from error


def suggest(name: str, allowed: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: a guess, and all valid names.

    Returns:
        Text such as `(did you mean 'count'? allowed: count, flag)`.
    """
    allowed = sorted(allowed)
    close = difflib.get_close_matches(name, allowed, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"({hint}allowed: {', '.join(allowed)})"


def one_line(error: BaseException) -> str:
    """Return the message of an exception in one line of at most 300 characters.

    Pydrake turns a failed assertion of Drake's into a SystemExit with a text. Any other
    SystemExit is not about a scenario and is raised again.
    """
    if isinstance(error, SystemExit) and not isinstance(error.code, str):
        raise error
    return " ".join(str(error).split())[:300]


T = TypeVar("T")


def checked_types(read: T) -> T:
    """Return a dataclass after checking its values against its annotations.

    Entries of lists and mappings are not checked.

    Raises:
        TypeError: If a value has another type.
    """
    for name, hint in typing.get_type_hints(type(read)).items():
        union = isinstance(hint, types.UnionType)
        kind = hint if union else typing.get_origin(hint) or hint
        value = getattr(read, name)
        if not isinstance(value, kind):
            raise TypeError(f"{name}: must be {kind}, got {value!r}")
    return read
