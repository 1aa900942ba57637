"""YAML files into dataclasses: bases, overrides, draws, and errors that name the key.

`yaml_load_typed` does the conversion. It says neither which file nor which key is
wrong and lets mistyped tags pass, so `check_tree` looks at everything first.
"""

from __future__ import annotations

import dataclasses as dc
import math
import operator
import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_dump, yaml_load, yaml_load_typed

from drake_srg.common.exceptions import ScenarioError, suggest

# Where a number is expected, one of these may stand; see `distributions.py`.
DISTRIBUTION_TAGS = (
    "!Deterministic",
    "!Gaussian",
    "!Uniform",
    "!UniformDiscrete",
    "!DeterministicVector",
    "!GaussianVector",
    "!UniformVector",
)


def parse_yaml(text: str, origin: str) -> Any:
    """Parse YAML text; tags of mappings become the key `_tag`.

    Raises:
        ScenarioError: If the text is not YAML, naming `origin`, line and problem, or
            has keys that are not text or a part that contains itself.
    """
    try:
        tree = yaml_load(data=text or "null")
    except AttributeError:  # of Drake's look at the top level's keys
        raise ScenarioError(f"{origin}: keys must be text") from None
    except Exception as error:
        lines = " ".join(part.strip() for part in str(error).splitlines())
        raise ScenarioError(f"{origin}: not valid YAML: {lines[:200]}") from None
    _check_is_tree(tree, origin)
    return tree


def merge(base: Any, override: Any, origin: str = "", key: str = "") -> Any:
    """Return `base` with `override` laid over it, mapping by mapping.

    A mapping with another tag than the base's replaces it as a whole. A mapping over a
    list of named entries is laid over those that its keys name; see `entry_names`.

    Args:
        base: A parsed tree. It is not changed.
        override: Another one. It is not changed.
        origin: File or option to name in errors.
        key: Dotted path of both.

    Raises:
        ScenarioError: If a list has no entry of that name.
    """
    if not isinstance(override, Mapping):
        return override
    if isinstance(base, list) and override and "_tag" not in override:
        merged = list(base)
        for name, value in override.items():
            i = _entry_index(base, name, origin, key)
            merged[i] = merge(base[i], value, origin, join(key, name))
        return merged
    if not isinstance(base, Mapping):
        return override
    if override.get("_tag", base.get("_tag")) != base.get("_tag"):
        return override
    return {
        **base,
        **{
            k: merge(base[k], v, origin, join(key, k)) if k in base else v
            for k, v in override.items()
        },
    }


def set_key(tree: dict[str, Any], key: str, value: Any) -> None:
    """Merge `value` into `tree` at the dotted `key`, making mappings on the way.

    A list's entry goes by its name, `directives.gripper.add_model.file`, or, in a list
    without names, by its index, `script.0.duration`. An empty mapping replaces what is
    there: nothing would be merged into it.

    Raises:
        ScenarioError: If the key leads through something that is neither a mapping nor
            a list, or to an entry that a list does not have.
    """
    node: Any = tree
    origin, path = f"--set {key}", key.split(".")
    for i, name in enumerate(path):
        above = ".".join(path[:i])
        entry: str | int = name
        if isinstance(node, list):
            entry = _entry_index(node, name, origin, above, indices=True)
        elif not isinstance(node, dict):
            raise ScenarioError(f"{origin}: {above} is a value without keys")
        elif node.get(name) is None and i < len(path) - 1:
            node[name] = {}
        if i < len(path) - 1:
            node = node[entry]
            continue
        old = node[entry] if isinstance(entry, int) else node.get(entry)
        node[entry] = merge(old, value, origin, key) if value != {} else value


def entry_names(items: Sequence[Any]) -> list[str]:
    """Return the names of a list's entries; none unless all of them have one.

    An entry's name is its `name`. That of a model directive is its model's or frame's
    `name`, a weld's `child`, or the stem of an included `file`.
    """
    found = []
    for item in items:
        inner = item
        if isinstance(item, Mapping) and "name" not in item:  # a model directive?
            inner = next(iter(item.values()), None)
        if not isinstance(inner, Mapping):
            return []
        stem = str(inner.get("file", "")).rpartition("/")[2].partition(".")[0]
        name = inner.get("name") or inner.get("child") or stem
        if not name:
            return []
        found.append(str(name))
    return found


def _entry_index(
    items: Sequence[Any], name: str, origin: str, key: str, *, indices: bool = False
) -> int:
    """Return which entry of a list a key means.

    Args:
        items: The list.
        name: The key: a name, or an index of a list without names.
        origin: File or option to name in errors.
        key: Dotted path of the list.
        indices: Whether an index will do where there are no names.
    """
    allowed = entry_names(items)
    if allowed:
        if name in allowed:
            return allowed.index(name)
        hint = ""
        if name.isdecimal() and int(name) < len(items):
            hint = f"write {allowed[int(name)]!r} instead of {name!r}; "
        fail(
            origin,
            key,
            f"entries are overridden by name, got {name!r} ({hint}allowed: "
            f"{', '.join(allowed)})",
        )
    if not indices:
        fail(origin, key, "entries have no names: override the list as a whole")
    if not (name.isdecimal() and int(name) < len(items)):
        choices = f"0 .. {len(items) - 1}" if items else "none, the list is empty"
        fail(origin, key, f"unknown index {name!r} (allowed: {choices})")
    return int(name)


def check_tree(value: Any, schema: Any, origin: str, key: str = "") -> Any:
    """Check parsed YAML against a schema and return it normalised.

    Checks keys, types, tags, finiteness and the metadata `gt`, `ge`, `le`, `among`,
    `length`, `nonempty` of dataclass fields. Drake's own classes are checked by their
    fields, too.

    Args:
        value: What `parse_yaml` returned, distributions drawn.
        schema: A type: dataclass, Drake schema class, list, dict, Union, scalar.
        origin: File or option to name in errors.
        key: Dotted path of `value`.

    Raises:
        ScenarioError: On the first thing that is wrong.
    """
    generic = typing.get_origin(schema)
    if generic in (typing.Union, types.UnionType):
        return _check_union(value, typing.get_args(schema), origin, key)
    if generic is list or schema is np.ndarray:
        (item,) = typing.get_args(schema) or (float,)
        if not isinstance(value, list):
            fail(origin, key, f"must be a list, got {_describe(value)}")
        return [check_tree(v, item, origin, f"{key}[{i}]") for i, v in enumerate(value)]
    if generic is dict:
        if not isinstance(value, Mapping):
            fail(origin, key, f"must be a mapping, got {_describe(value)}")
        item = typing.get_args(schema)[1]
        return {k: check_tree(v, item, origin, join(key, k)) for k, v in value.items()}
    if schema in (bool, int, float, str):
        return _check_scalar(value, schema, origin, key)
    if _fields(schema) is not None:
        return _check_fields(value, schema, origin, key)
    return value


def load_typed(schema: type[Any], tree: Any, origin: str) -> Any:
    """Check a parsed tree and return an instance of the dataclass `schema`."""
    checked = check_tree(tree, schema, origin)
    try:
        return yaml_load_typed(schema=schema, data=yaml_dump(checked))
    except Exception as error:
        line = " ".join(str(error).split())
        fail(origin, _misfit(schema, checked), f"cannot be read: {line[:200]}")


def _misfit(schema: type[Any], tree: Mapping[str, Any]) -> str:
    """Name the key of a dataclass that `yaml_load_typed` does not take."""
    for key, value in tree.items():
        try:
            yaml_load_typed(schema=schema, data=yaml_dump({key: value}))
        except Exception:
            return key
    return ""


def _check_is_tree(node: Any, origin: str, above: tuple[int, ...] = ()) -> None:
    if not isinstance(node, (dict, list)):
        return
    if id(node) in above:
        raise ScenarioError(f"{origin}: an anchored part contains itself")
    for key in node if isinstance(node, dict) else ():
        if not isinstance(key, str):
            raise ScenarioError(f"{origin}: keys must be text, got {_describe(key)}")
    for child in node.values() if isinstance(node, dict) else node:
        _check_is_tree(child, origin, (*above, id(node)))


def _fields(schema: Any) -> dict[str, tuple[Any, Mapping[str, Any]]] | None:
    if dc.is_dataclass(schema):
        hints = typing.get_type_hints(schema)
        return {f.name: (hints[f.name], f.metadata) for f in dc.fields(schema)}
    if hasattr(schema, "__fields__"):
        return {f.name: (f.type, {}) for f in schema.__fields__}
    return None


def _check_fields(value: Any, schema: Any, origin: str, key: str) -> Any:
    ours = dc.is_dataclass(schema)
    if value is None:
        value = {}
    if not isinstance(value, Mapping):
        fail(origin, key, f"must be a mapping, got {_describe(value)}")
    tag = value.get("_tag")
    name = _base_name(schema)
    if ours and tag not in (None, f"!{name}"):
        fail(origin, key, f"must have the tag !{name} or none, got {tag}")
    if not ours and tag is not None and tag != f"!{name}":
        return value  # A tagged short form of a Drake class, such as !Rpy {deg: ...}.
    fields = _fields(schema) or {}
    # A tag chooses within a union (`_check_union`); elsewhere it says nothing new.
    result: dict[str, Any] = {}
    for field, item in value.items():
        if field == "_tag":
            continue
        if field not in fields:
            fail(origin, key, f"unknown key {field!r} {suggest(field, fields)}")
        field_type, bounds = fields[field]
        result[field] = check_tree(item, field_type, origin, join(key, field))
        if ours:
            _check_bounds(result[field], bounds, origin, join(key, field))
    return result


def _check_scalar(value: Any, schema: type, origin: str, key: str) -> Any:
    def wrong(message: str) -> typing.NoReturn:
        fail(origin, key, message)

    if isinstance(value, Mapping) and value.get("_tag") not in (
        None,
        *DISTRIBUTION_TAGS,
    ):
        tag = value["_tag"]
        wrong(f"unknown tag {tag} {suggest(tag, DISTRIBUTION_TAGS)}")
    if schema is str:
        if not isinstance(value, str):
            wrong(f"must be text, got {_describe(value)}")
        return value
    if schema is bool:
        if not isinstance(value, bool):
            wrong(f"must be true or false, got {_describe(value)}")
        return value
    if isinstance(value, str):  # YAML 1.1 reads 1e-3 as text
        try:
            value = float(value)
        except ValueError:
            wrong(f"must be a number, got {_describe(value)}")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        wrong(f"must be a number, got {_describe(value)}")
    if math.isnan(value):
        wrong("must be a number, got NaN")
    if schema is int:
        if math.isinf(value):
            wrong(f"must be finite, got {value}")
        if value != int(value):
            wrong(f"must be a whole number, got {value}")
        return int(value)
    return float(value)


def _check_union(value: Any, options: Sequence[Any], origin: str, key: str) -> Any:
    if value is None and type(None) in options:
        return None
    options = [
        option
        for option in options
        # Drake pads its unions with classes that only report a wrong selection.
        if option is not type(None) and not _base_name(option).startswith("_Invalid")
    ]
    if len(options) == 1:
        return check_tree(value, options[0], origin, key)
    tags = {f"!{_base_name(option)}": option for option in options}
    tag = value.get("_tag") if isinstance(value, Mapping) else None
    if tag is not None:
        if tag not in tags:
            fail(origin, key, f"unknown tag {tag} {suggest(tag, tags)}")
        checked = check_tree(value, tags[tag], origin, key)
        return {**checked, "_tag": tag}
    untagged = [option for option in options if _fields(option) is None]
    if not isinstance(value, Mapping) and untagged:
        return check_tree(value, untagged[0], origin, key)
    if isinstance(value, Mapping) and not dc.is_dataclass(options[0]):
        return check_tree(value, options[0], origin, key)  # Drake's default choice
    return fail(origin, key, f"needs a tag (allowed: {names(tags)})")


def _check_bounds(value: Any, bounds: Mapping[str, Any], origin: str, key: str) -> None:
    if value is None:
        return
    length = bounds.get("length")
    if length is not None and len(value) != length:
        fail(origin, key, f"needs {length} numbers, got {len(value)}")
    if bounds.get("nonempty") and not value:
        fail(origin, key, "must not be empty")
    tests = {
        "gt": (operator.gt, "greater than"),
        "ge": (operator.ge, "at least"),
        "le": (operator.le, "at most"),
    }
    for item in value if isinstance(value, list) else [value]:
        if item not in bounds.get("among", (item,)):
            fail(origin, key, f"must be one of {names(bounds['among'])}; got {item!r}")
        if isinstance(item, float) and math.isinf(item):
            fail(origin, key, f"must be finite, got {item}")
        for name, (test, words) in tests.items():
            if name in bounds and not test(item, bounds[name]):
                fail(origin, key, f"must be {words} {bounds[name]}, got {item}")


def fail(origin: str, key: str, message: str) -> typing.NoReturn:
    """Raise the error of one key of a file or option."""
    raise ScenarioError(f"{origin}: {key or 'top level'}: {message}")


def join(key: str, name: object) -> str:
    """Return the dotted key of an entry."""
    return f"{key}.{name}" if key else str(name)


def _base_name(schema: Any) -> str:
    return str(getattr(schema, "__name__", schema)).split("𝓣")[0]


def _describe(value: Any) -> str:
    if isinstance(value, Mapping):
        tag = value.get("_tag")
        return "a mapping" if tag is None else f"a mapping tagged {tag}"
    if isinstance(value, bool):
        return str(value).lower()
    if value is None:
        return "null"
    return "a list" if isinstance(value, list) else repr(value)


def names(names: Iterable[str]) -> str:
    """Return names in their order, for a message."""
    return ", ".join(sorted(names))
