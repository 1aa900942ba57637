"""YAML trees with line numbers, checked against typed dataclasses.

A tree consists of dicts, lists and scalars. A tag is the entry `_tag` of its mapping.

Drake's `yaml_load_typed` does the conversion. But its errors name neither the file nor
the key, and it accepts mistyped tags. Therefore, `check_tree` checks everything first.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses as dc
import functools
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import yaml
from pydrake.common.yaml import yaml_dump, yaml_load, yaml_load_typed

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.config import bounds_problem, kind_problem, names, unchecked


def parse_yaml(text: str, origin: str) -> Any:
    """Parse YAML text; tags of mappings become the key `_tag`.

    Args:
        text: YAML; empty text gives None.
        origin: File or option at the start of error messages.

    Raises:
        ScenarioError: If the text is not valid YAML, has a key twice or keys that are
            not text, or has a part that contains itself.
    """
    try:
        return copy.deepcopy(_parse(text or "null"))
    except _BadTreeError as error:
        raise ScenarioError(f"{origin}: {error}") from None
    except Exception as error:
        lines = " ".join(part.strip() for part in str(error).splitlines())
        raise ScenarioError(f"{origin}: not valid YAML: {lines[:200]}") from None


@functools.lru_cache(maxsize=64)
def _parse(text: str) -> Any:
    """Parse YAML text; cached, because common bases take tens of milliseconds."""
    try:
        tree = yaml_load(data=text)
    except RecursionError:  # too deep for the loader in C, which would crash
        raise
    except Exception:
        _check_node(yaml.compose(text, Loader=_LOADER), {})  # a better message, if any
        raise
    _check_node(yaml.compose(text, Loader=_LOADER), {})
    return tree


# The loader in C, if PyYAML has it.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_KEYS = ("tag:yaml.org,2002:str", "tag:yaml.org,2002:merge")


class _BadTreeError(ValueError):
    """Valid YAML that is not a tree with unique text keys."""


def _check_node(node: yaml.Node | None, finished: dict[int, bool]) -> None:
    """Check that a node is a tree whose mappings have unique text keys.

    Args:
        node: The node; None for empty text.
        finished: By a node's id: True once it is checked, False while it is being
            checked.

    Raises:
        _BadTreeError: If the node is not such a tree; the message says where.
    """
    if not isinstance(node, yaml.CollectionNode) or finished.get(id(node)):
        return
    if id(node) in finished:
        raise _BadTreeError("an anchored part contains itself")
    finished[id(node)] = False
    mapping = isinstance(node, yaml.MappingNode)
    lines: dict[str, int] = {}
    for key, child in node.value if mapping else ((None, c) for c in node.value):
        if key is not None:
            line = key.start_mark.line + 1
            if key.tag not in _KEYS:
                got = key.value if isinstance(key, yaml.ScalarNode) else "a collection"
                raise _BadTreeError(f"keys must be text, got {got} (line {line})")
            if key.value in lines:
                also = f"is in line {lines[key.value]}, too"
                raise _BadTreeError(f"line {line}: key {key.value!r} {also}")
            lines[key.value] = line
        _check_node(child, finished)
    finished[id(node)] = True


def merge(base: Any, override: Any, origin: str = "", key: str = "") -> Any:
    """Return `base` with `override` laid over it, mapping by mapping.

    A mapping with another tag than the base's mapping replaces that as a whole. If the
    base has a list, the keys of the override's mapping name the entries to override, or
    to remove by null; see `entry_names`.

    Args:
        base: A parsed tree; not changed.
        override: A parsed tree; not changed.
        origin: File or option at the start of error messages.
        key: Dotted path of both trees.

    Raises:
        ScenarioError: If a list has no entry of a given name.
    """
    if not isinstance(override, Mapping):
        return override
    if isinstance(base, list) and override and "_tag" not in override:
        merged = list(base)
        for name, value in override.items():
            i = _entry_index(base, name, origin, key)
            merged[i] = merge(base[i], value, origin, join(key, name))
        return [entry for entry in merged if entry is not None]
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
    """Merge `value` into `tree` at the dotted `key`, adding mappings on the way.

    The entry of a list is given by its name, as in `directives.gripper.add_model.file`,
    or, in a list without names, by its index, as in `planner.steps.0.duration`. An
    empty mapping replaces the old value, because merging it would change nothing.

    Raises:
        ScenarioError: If the key leads through a scalar, or to an entry that a list
            does not have.
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
        if isinstance(entry, int) and value is None:
            del node[entry]
            return
        old = node[entry] if isinstance(entry, int) else node.get(entry)
        node[entry] = merge(old, value, origin, key) if value != {} else value


def entry_names(items: Sequence[Any]) -> list[str]:
    """Return the names of a list's entries; empty if an entry has no name.

    The name of an entry is its `name`. The name of a model directive is the `name` of
    its model or frame, the `child` of a weld, or the stem of an included `file`.
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
    """Return the index of the list entry that a key refers to.

    Args:
        items: The list.
        name: The key: a name, or an index if the list has no names.
        origin: File or option at the start of error messages.
        key: Dotted path of the list.
        indices: Whether an index is accepted if the list has no names.
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


def fail(origin: str, key: str, message: str) -> typing.NoReturn:
    """Raise a ScenarioError about one key of a file or option."""
    raise ScenarioError(f"{origin}: {key or 'top level'}: {message}")


def join(key: str, name: object) -> str:
    """Return the dotted path of an entry of `key`."""
    return f"{key}.{name}" if key else str(name)


def describe(value: Any) -> str:
    """Return a short description of a YAML value, for a message."""
    if isinstance(value, Mapping):
        tag = value.get("_tag")
        return "a mapping" if tag is None else f"a mapping tagged {tag}"
    if isinstance(value, bool):
        return str(value).lower()
    if value is None:
        return "null"
    return "a list" if isinstance(value, list) else repr(value)


# Tags of the distributions that can replace a number; see draws.py.
DISTRIBUTION_TAGS = (
    "!Deterministic",
    "!Gaussian",
    "!Uniform",
    "!UniformDiscrete",
    "!DeterministicVector",
    "!GaussianVector",
    "!UniformVector",
)


def check_tree(value: Any, schema: Any, origin: str, key: str = "") -> Any:
    """Check parsed YAML against a schema and return it normalised.

    Checks keys, types, tags, finiteness and the bounds of dataclass fields (see
    drake_srg/config.py), and the fields of Drake's own classes.

    Args:
        value: A tree of `parse_yaml`, with distributions drawn.
        schema: A type: dataclass, Drake schema class, list, dict, Union, scalar.
        origin: File or option at the start of error messages.
        key: Dotted path of `value`.

    Raises:
        ScenarioError: On the first mistake found.
    """
    generic = typing.get_origin(schema)
    if generic in (typing.Union, types.UnionType):
        return _check_union(value, typing.get_args(schema), origin, key)
    if generic is list or schema is np.ndarray:
        (item,) = typing.get_args(schema) or (float,)
        if not isinstance(value, list):
            fail(origin, key, f"must be a list, got {describe(value)}")
        return [check_tree(v, item, origin, f"{key}[{i}]") for i, v in enumerate(value)]
    if generic is dict:
        if not isinstance(value, Mapping):
            fail(origin, key, f"must be a mapping, got {describe(value)}")
        item = typing.get_args(schema)[1]
        return {  # null in a variant removes an entry of its base
            k: check_tree(v, item, origin, join(key, k))
            for k, v in value.items()
            if v is not None
        }
    if schema in (bool, int, float, str):
        return _check_scalar(value, schema, origin, key)
    if _fields(schema) is not None:
        return _check_fields(value, schema, origin, key)
    return value


def load_typed(schema: type[Any], tree: Any, origin: str) -> Any:
    """Check a parsed tree and return it as an instance of the dataclass `schema`.

    Raises:
        ScenarioError: On the first mistake found.
    """
    result, kinds = schema(), typing.get_type_hints(schema)
    for key, value in check_tree(tree, schema, origin).items():
        try:
            loaded = _load_field(_Field(schema, key, kinds[key], repr(value), value))
        except Exception as error:
            line = " ".join(str(error).split())
            fail(origin, key, f"cannot be read: {line[:200]}")
        setattr(result, key, copy.deepcopy(loaded))
    return result


@dc.dataclass(frozen=True)
class _Field:
    """A field of a dataclass to load, as a cache key: equal text, equal value."""

    schema: type[Any]
    key: str
    kind: Any  # its type, which grows as drivers are accepted
    text: str
    value: Any = dc.field(compare=False)


@functools.lru_cache(maxsize=256)
def _load_field(field: _Field) -> Any:
    """Return the value of a field, cached: trials share most, at milliseconds each."""
    data = yaml_dump({field.key: field.value})
    return getattr(read_typed(field.schema, data), field.key)


def read_typed(schema: type[Any], text: str) -> Any:
    """Return the dataclass in a text of `yaml_dump_typed`, or of a checked tree."""
    with unchecked():
        return yaml_load_typed(schema=schema, data=text)


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
        fail(origin, key, f"must be a mapping, got {describe(value)}")
    tag = value.get("_tag")
    name = _base_name(schema)
    if ours and tag not in (None, f"!{name}"):
        fail(origin, key, f"must have the tag !{name} or none, got {tag}")
    if not ours and tag is not None and tag != f"!{name}":
        return value  # a tagged short form of a Drake class, such as !Rpy {deg: ...}
    fields = _fields(schema) or {}
    # A tag matters only in a union (`_check_union`), so drop it here.
    result: dict[str, Any] = {}
    for field, item in value.items():
        if field == "_tag":
            continue
        if field not in fields:
            fail(origin, key, f"unknown key {field!r} {suggest(field, fields)}")
        field_type, bounds = fields[field]
        result[field] = check_tree(item, field_type, origin, join(key, field))
        if ours and (problem := bounds_problem(result[field], bounds)):
            fail(origin, join(key, field), problem)
    return result


def _check_scalar(value: Any, schema: type, origin: str, key: str) -> Any:
    if isinstance(value, Mapping) and value.get("_tag") not in (
        None,
        *DISTRIBUTION_TAGS,
    ):
        tag = value["_tag"]
        fail(origin, key, f"unknown tag {tag} {suggest(tag, DISTRIBUTION_TAGS)}")
    if isinstance(value, str) and schema in (int, float):  # YAML 1.1 reads 1e-3 as text
        with contextlib.suppress(ValueError):
            value = float(value)
    if problem := kind_problem(value, schema, describe):
        fail(origin, key, problem)
    return schema(value)


def _check_union(value: Any, options: Sequence[Any], origin: str, key: str) -> Any:
    if value is None and type(None) in options:
        return None
    options = [
        option
        for option in options
        # Drake adds classes to its unions that only report an invalid choice.
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
        return check_tree(value, options[0], origin, key)  # Drake's default
    return fail(origin, key, f"needs a tag (allowed: {names(tags)})")


def _base_name(schema: Any) -> str:
    return str(getattr(schema, "__name__", schema)).split("𝓣")[0]
