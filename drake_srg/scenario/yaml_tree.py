"""Parsed YAML as plain trees: reading, laying one over another, setting keys.

A tree consists of dicts, lists and scalars. A tag is the entry `_tag` of its mapping.
"""

from __future__ import annotations

import copy
import functools
import typing
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pydrake.common.yaml import yaml_load

from drake_srg.common.exceptions import ScenarioError


def parse_yaml(text: str, origin: str) -> Any:
    """Parse YAML text; tags of mappings become the key `_tag`.

    Args:
        text: YAML; empty text gives None.
        origin: File or option at the start of error messages.

    Raises:
        ScenarioError: If the text is not valid YAML, has keys that are not text, or has
            a part that contains itself.
    """
    try:
        tree = copy.deepcopy(_parse(text or "null"))
    except AttributeError:  # Drake looks for a prefix in the top-level keys
        raise ScenarioError(f"{origin}: keys must be text") from None
    except Exception as error:
        lines = " ".join(part.strip() for part in str(error).splitlines())
        raise ScenarioError(f"{origin}: not valid YAML: {lines[:200]}") from None
    _check_is_tree(tree, origin)
    return tree


@functools.lru_cache(maxsize=64)
def _parse(text: str) -> Any:
    """Parse YAML text; scenarios share bases, whose text takes tens of milliseconds."""
    return yaml_load(data=text)


def merge(base: Any, override: Any, origin: str = "", key: str = "") -> Any:
    """Return `base` with `override` laid over it, mapping by mapping.

    A mapping whose tag differs from the base's replaces it as a whole. The keys of a
    mapping over a list name the entries of the list to override; see `entry_names`.

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
    """Merge `value` into `tree` at the dotted `key`, adding mappings on the way.

    The entry of a list is given by its name, as in `directives.gripper.add_model.file`,
    or, in a list without names, by its index, as in `script.0.duration`. An empty
    mapping replaces the old value, because merging it would change nothing.

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
        old = node[entry] if isinstance(entry, int) else node.get(entry)
        node[entry] = merge(old, value, origin, key) if value != {} else value


def entry_names(items: Sequence[Any]) -> list[str]:
    """Return the names of a list's entries, or an empty list unless all have one.

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
    """Return the index of the entry of a list that a key means.

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


def _check_is_tree(node: Any, origin: str, above: tuple[int, ...] = ()) -> None:
    if not isinstance(node, (dict, list)):
        return
    if id(node) in above:
        raise ScenarioError(f"{origin}: an anchored part contains itself")
    for key in node if isinstance(node, dict) else ():
        if not isinstance(key, str):
            raise ScenarioError(f"{origin}: keys must be text, got {describe(key)}")
    for child in node.values() if isinstance(node, dict) else node:
        _check_is_tree(child, origin, (*above, id(node)))


def fail(origin: str, key: str, message: str) -> typing.NoReturn:
    """Raise a ScenarioError about one key of a file or option."""
    raise ScenarioError(f"{origin}: {key or 'top level'}: {message}")


def join(key: str, name: object) -> str:
    """Return the dotted path of an entry of `key`."""
    return f"{key}.{name}" if key else str(name)


def names(names: Iterable[str]) -> str:
    """Return sorted names as text, for a message."""
    return ", ".join(sorted(names))


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
