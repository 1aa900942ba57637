"""Configurations: dataclasses that check the types and bounds of their fields.

The metadata of a field can have these bounds:

* `gt`, `ge`, `le`: limits of a number, or of each number in a list;
* `among`: allowed values of the field, or of each entry of a list;
* `length`, `nonempty`: limits on the length of a list or a text.

The same bounds hold for scenario files; see drake_srg/scenario/typed_yaml.py.
"""

from __future__ import annotations

import contextlib
import contextvars
import dataclasses as dc
import functools
import math
import numbers
import operator
import sys
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

_COMPARISONS = {
    "gt": (operator.gt, "greater than"),
    "ge": (operator.ge, "at least"),
    "le": (operator.le, "at most"),
}
_SCALARS = (bool, int, float, str)


class ScenarioError(ValueError):
    """Bad input. The message says what is wrong, where, and what is allowed."""


def positive(**metadata: object) -> Mapping[str, object]:
    """Return the metadata of a dataclass field that must be greater than zero."""
    return {"gt": 0.0, **metadata}


def names(allowed: Iterable[object]) -> str:
    """Return names, or other choices, sorted as text for a message."""
    return ", ".join(sorted(map(str, allowed)))


def kind_problem(
    value: object, kind: type, describe: Callable[[Any], str] = repr
) -> str | None:
    """Return why a value does not have a scalar type, or None if it does.

    Args:
        value: Any value.
        kind: `bool`, `int`, `float` or `str`. Whole numbers count as `float`.
        describe: Returns the text of a value, for the message.
    """
    if type(value) is kind is not float:
        return None
    if kind in (bool, str):
        wanted = "text" if kind is str else "true or false"
        return (
            None
            if isinstance(value, kind)
            else f"must be {wanted}, got {describe(value)}"
        )
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return f"must be a number, got {describe(value)}"
    number = float(value)
    if math.isnan(number):
        return "must be a number, got NaN"
    if kind is int and not number.is_integer():
        wanted = "finite" if math.isinf(number) else "a whole number"
        return f"must be {wanted}, got {value}"
    return None


def bounds_problem(value: Any, bounds: Mapping[str, Any]) -> str | None:
    """Return why a value, or an entry of a list, is out of bounds, or None.

    Args:
        value: A value of the right type. None is always within bounds.
        bounds: The metadata of its field.
    """
    if value is None:
        return None
    length = bounds.get("length")
    if length is not None and len(value) != length:
        return f"needs {length} numbers, got {len(value)}"
    if bounds.get("nonempty") and not value:
        return "must not be empty"
    items = value if isinstance(value, list) else [value]
    return next(filter(None, (_item_problem(item, bounds) for item in items)), None)


def _item_problem(item: Any, bounds: Mapping[str, Any]) -> str | None:
    if item not in bounds.get("among", (item,)):
        return f"must be one of {names(bounds['among'])}; got {item!r}"
    if isinstance(item, float) and math.isinf(item):
        return f"must be finite, got {item}"
    for name, (holds, words) in _COMPARISONS.items():
        if name in bounds and not holds(item, bounds[name]):
            return f"must be {words} {bounds[name]}, got {item}"
    return None


_unchecked = contextvars.ContextVar("unchecked", default=False)


@contextlib.contextmanager
def unchecked() -> Iterator[None]:
    """Let configurations take any value, for `yaml_load_typed`.

    Up to Drake 1.58, that function sets an optional number to 0 before it sets the
    value from the file.
    """
    token = _unchecked.set(True)
    try:
        yield
    finally:
        _unchecked.reset(token)


class Config:
    """Base class of configurations; checks a field whenever it is set.

    Derive a dataclass from it. Fields that hold a number or text, or a list of these,
    are checked against their annotation and bounds.

    Raises:
        ScenarioError: If a value has the wrong type or is out of bounds.
    """

    def __setattr__(self, name: str, value: object) -> None:
        kind: type = type(self)
        check = _checks(kind).get(name)
        if check is not None and (problem := check(value)) and not _unchecked.get():
            raise ScenarioError(f"{kind.__name__}.{name}: {problem}")
        super().__setattr__(name, value)


@functools.cache
def _checks(config: type) -> Mapping[str, Callable[[Any], str | None]]:
    """Return the check of each field that has one; see `_check`."""
    kinds = typing.get_type_hints(config)
    checks = {
        field.name: _check(kinds[field.name], field) for field in dc.fields(config)
    }
    return {name: check for name, check in checks.items() if check is not None}


def _check(kind: Any, field: dc.Field[Any]) -> Callable[[Any], str | None] | None:
    """Return a function that returns a value's problem, or None for an unchecked field.

    The function returns None if the value is fine.
    """
    optional = False
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        options = typing.get_args(kind)
        optional = type(None) in options
        kind = options[0] if len(options) == 1 + optional else None
    is_list = typing.get_origin(kind) is list
    item_kind = typing.get_args(kind)[0] if is_list else kind
    if item_kind not in _SCALARS:
        return None
    if is_list:
        return functools.partial(_list_problem, item_kind, optional, field.metadata)
    least = field.metadata.get("ge", -sys.float_info.max)
    if "gt" in field.metadata:
        least = math.nextafter(field.metadata["gt"], math.inf)
    most = field.metadata.get("le", sys.float_info.max)
    in_range = item_kind is float and "among" not in field.metadata

    def check(value: Any) -> str | None:
        # A fast path: most values are floats within their bounds.
        if in_range and type(value) is float and least <= value <= most:
            return None
        if value is None and optional:
            return None
        return kind_problem(value, item_kind) or bounds_problem(value, field.metadata)

    return check


def _list_problem(
    kind: type, optional: bool, bounds: Mapping[str, Any], value: Any
) -> str | None:
    """Return the problem of a list, an array or a tuple."""
    if value is None and optional:
        return None
    if hasattr(value, "tolist"):
        value = value.tolist()
    if not isinstance(value, (list, tuple)):
        return f"must be a list, got {value!r}"
    problems = (kind_problem(item, kind) for item in value)
    return next(filter(None, problems), None) or bounds_problem([*value], bounds)
