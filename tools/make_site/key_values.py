"""Words for the types, defaults and bounds of scenario keys."""

from __future__ import annotations

import dataclasses as dc
import types
import typing
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pydrake.common import schema
from pydrake.common.schema import Transform

from make_site.markdown import code

_SCALARS = {
    float: "number",
    int: "whole number",
    str: "text",
    bool: "true or false",
    np.ndarray: "list of number",
}
# Any number may be one of these, so no key says so.
_DISTRIBUTIONS = ("Deterministic", "Gaussian", "Uniform", "UniformDiscrete")


def is_schema(kind: Any) -> bool:
    """Whether a class has keys: a dataclass, or one of Drake's schema classes."""
    return isinstance(kind, type) and (
        dc.is_dataclass(kind) or hasattr(kind, "__fields__")
    )


def schema_name(kind: Any) -> str:
    """Return the name of a class as tags spell it."""
    return str(getattr(kind, "__name__", kind)).split("𝓣")[0]


def inner_classes(hint: Any, path: str) -> Iterator[tuple[Any, str]]:
    """Yield the classes with keys in a type, and the paths of their instances.

    Poses are left out: they have a section of their own.
    """
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is list:
        yield from inner_classes(arguments[0], f"{path}[i]")
    elif origin is dict:
        yield from inner_classes(arguments[1], f"{path}.NAME")
    elif options := _options(hint):
        for option in options:
            yield from inner_classes(option, path)
    elif is_schema(hint) and hint is not Transform:
        yield hint, path


def type_words(hint: Any) -> str:
    """Return the words for a type."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is list:
        return f"list of {type_words(arguments[0])}"
    if origin is dict:
        return f"NAME: {type_words(arguments[1])}"
    if options := _options(hint):
        tagged = sum(map(is_schema, options)) > 1
        words = [type_words(option) for option in options]
        if tagged:
            words = [code(f"!{schema_name(option)}") for option in options]
        null = ["null"] if types.NoneType in arguments else []
        return ", ".join([*words, *null])
    if hint is Transform:
        return "pose"
    return _SCALARS.get(hint, "mapping")


def _options(hint: Any) -> list[Any]:
    """Return the choices of a union; [] for another type."""
    if typing.get_origin(hint) not in (typing.Union, types.UnionType):
        return []
    options = [o for o in typing.get_args(hint) if o is not types.NoneType]
    # Drake pads its unions with classes that only report an invalid choice.
    options = [o for o in options if not schema_name(o).startswith("_Invalid")]
    plain = [option for option in options if not _is_distribution(option)]
    return plain or options


def _is_distribution(kind: Any) -> bool:
    name = schema_name(kind).removesuffix("Vector")
    return name in _DISTRIBUTIONS and hasattr(schema, name) and not _turns(kind)


def _turns(kind: Any) -> bool:
    """Whether a class is a choice of `Rotation`, one of which is named Uniform."""
    return "Rotation" in getattr(kind, "__qualname__", "")


def show_value(value: Any) -> str:
    """Return a default as YAML; "" where the keys below have defaults of their own."""
    if value is dc.MISSING:
        return "required"
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if is_schema(type(value)):
        return ""
    if isinstance(value, list):
        if any(is_schema(type(item)) for item in value):
            return ""
        return code(f"[{', '.join(map(_scalar, value))}]")
    if isinstance(value, dict):
        return "" if value else code("{}")
    return code(_scalar(value))


def _scalar(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value) if value != "" else '""'


def bounds_words(metadata: Mapping[str, Any]) -> str:
    """Return the words for the bounds that `check_tree` checks."""
    words = []
    if "length" in metadata:
        words.append(f"{metadata['length']} entries")
    if metadata.get("nonempty"):
        words.append("not empty")
    if "among" in metadata:
        words.append(", ".join(code(str(item)) for item in metadata["among"]))
    for name, sign in (("gt", ">"), ("ge", "≥"), ("le", "≤")):
        if name in metadata:
            words.append(f"{sign} {metadata[name]:g}")
    return ", ".join(words)
