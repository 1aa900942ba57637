"""The error of bad input, and what makes it of the errors that Drake raises.

Nothing of Drake is imported here: the command needs this where Drake fails.
"""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Iterable, Iterator


class ScenarioError(ValueError):
    """Bad input; the message says what, where, and what is allowed."""


@contextlib.contextmanager
def scenario_errors(name: str = "") -> Iterator[None]:
    """Make a ScenarioError of what is raised while a scenario's systems are built.

    Drake and our systems check many settings only then. Use it with `with`, or as a
    decorator.

    Args:
        name: Of the scenario, to stand before the message; empty: not known here.
    """
    try:
        yield
    except (RuntimeError, ValueError, SystemExit) as error:
        if isinstance(error, ScenarioError) and not name:
            raise
        message = one_line(error)
        raise ScenarioError(f"{name}: {message}" if name else message) from error


def suggest(name: str, allowed: Iterable[str]) -> str:
    """Return what somebody who wrote `name` may have meant, and all that is allowed."""
    allowed = sorted(allowed)
    close = difflib.get_close_matches(name, allowed, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"{hint}allowed: {', '.join(allowed)}"


def one_line(error: BaseException) -> str:
    """Return the message of an error in one line, not too long.

    Pydrake makes a SystemExit with a text of a failed assertion of Drake's. Any other
    SystemExit is no error of a scenario and is raised again.
    """
    if isinstance(error, SystemExit) and not isinstance(error.code, str):
        raise error
    return " ".join(str(error).split())[:300]
