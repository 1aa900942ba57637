"""The reference of scenario keys, made from the classes that a scenario fills."""

from __future__ import annotations

import dataclasses as dc
import functools
import typing
from collections.abc import Iterator, Mapping
from typing import Any

from pydrake.common.schema import Transform

from drake_srg.config import unchecked
from drake_srg.scenario.schema import Scenario
from make_site.drake_fields import COMMENTS
from make_site.field_comments import class_comments, unit_of
from make_site.key_values import (
    bounds_words,
    inner_classes,
    is_schema,
    schema_name,
    show_value,
    type_words,
)
from make_site.markdown import code, table

# A class with more keys than this is shown once; elsewhere, the page refers to it.
_REPEATED = 4
_HEADS = ("key", "meaning", "value", "default")  # as a phone shows them
_POSES = "Poses (`X_PB`, `pose` and others) are mappings with these keys."


@dc.dataclass(frozen=True)
class Key:
    """A scenario key, as the reference shows it."""

    path: str  # dotted, with NAME and [i] for the names and places of entries
    tag: str  # of the class whose key it is, where a tag chooses it; or empty
    type: str
    default: str
    bounds: str
    unit: str
    comment: str


def scenario_keys() -> list[Key]:
    """Return every key of a scenario file; paths of keys of poses begin with POSE."""
    walk = _Walk()
    keys = [*walk.keys(Scenario, Scenario(), "", "")]
    return [*keys, *walk.keys(Transform, Transform(), "POSE", "")]


def keys_index() -> str:
    """Return a table of the keys of the first level, and the list of their pages."""
    sections = _sections()
    rows = [
        (
            f"[{name}](keys/{name}.md)" if len(keys) > 1 else _breakable(name),
            _POSES if name == "POSE" else keys[0].comment,
            _value_words(keys[0]) if len(keys) == 1 else "",
            keys[0].default if len(keys) == 1 else "",
        )
        for name, keys in sections.items()
    ]
    pages = "\n".join(f"keys/{name}" for name in keys_pages())
    tree = f"```{{toctree}}\n:hidden:\n\n{pages}\n```\n"
    return f"{table(_HEADS, rows)}\n{tree}"


def keys_pages() -> dict[str, str]:
    """Return a page for each key of the first level that has others below it."""
    return {
        name: "\n".join(_page(name, keys))
        for name, keys in _sections().items()
        if len(keys) > 1
    }


@functools.cache
def _sections() -> dict[str, list[Key]]:
    """Return all keys by the first part of their paths."""
    sections: dict[str, list[Key]] = {}
    for key in scenario_keys():
        first = key.path.replace("[", ".").split(".", maxsplit=1)[0]
        sections.setdefault(first, []).append(key)
    return sections


def _page(name: str, keys: list[Key]) -> Iterator[str]:
    yield f"# {name}\n"
    if name == "POSE":
        yield f"{_POSES}\n"
    else:
        head, *keys = keys
        default = f" Default: {head.default}." if head.default else ""
        yield f"{head.comment}{default}\n"
    for tag in dict.fromkeys(key.tag for key in keys):
        if tag:
            yield f"## {name} !{tag}\n"
        yield _table([key for key in keys if key.tag == tag])


def _table(keys: list[Key]) -> str:
    rows = [
        (
            _breakable(key.path),
            "" if key.comment == key.unit else key.comment,
            _value_words(key),
            key.default,
        )
        for key in keys
    ]
    return table(_HEADS, rows)


def _breakable(path: str) -> str:
    """Return a key as code that browsers break after dots only."""
    words = path.replace("<", "&lt;").replace(".", ".<wbr>")
    return f'<code class="docutils literal notranslate key">{words}</code>'


def _value_words(key: Key) -> str:
    """Return the values of a key in words: type, unit and bounds."""
    unit = f" [{key.unit}]" if key.unit else ""
    return ", ".join(filter(None, [f"{key.type}{unit}", key.bounds]))


class _Walk:
    """Visits the classes of a scenario from the top, the large ones once."""

    def __init__(self) -> None:
        # Where a class was entered, and with which defaults.
        self._entered: dict[Any, list[tuple[Any, str]]] = {}

    def keys(self, kind: Any, value: Any, path: str, tag: str) -> Iterator[Key]:
        """Yield the keys of a class, and of the classes of its fields.

        Args:
            kind: A dataclass, or one of Drake's schema classes.
            value: An instance with the defaults; None: the class requires arguments.
            path: Dotted path of the class's keys.
            tag: The tag that chose the class, if any.
        """
        comments = field_comments(kind)
        for name, hint, bounds, own in schema_fields(kind):
            default = own if value is None else getattr(value, name)
            where = f"{path}.{name}" if path else name
            choices = list(inner_classes(hint, where))
            several = len(choices) > 1
            below: list[Key] = []
            elsewhere = ""
            for choice, inside in choices:
                used = default if type(default) is choice else _made(choice)
                if place := self._place(choice, used, inside):
                    elsewhere += f" Keys as in {code(place)}."
                    continue
                chosen = f"{choice.__name__}" if several else tag
                below += self.keys(choice, used, inside, chosen)
            comment = comments[name] or (_summary(choices[0][0]) if choices else "")
            yield Key(
                where,
                tag,
                type_words(hint),
                show_value(default),
                bounds_words(bounds),
                unit_of(comment),
                f"{comment}{elsewhere}".strip(),
            )
            yield from below

    def _place(self, kind: Any, value: Any, path: str) -> str:
        """Return where a class's keys are already shown, or "" after noting `path`."""
        if not dc.is_dataclass(kind) or len(dc.fields(kind)) <= _REPEATED:
            return ""
        entered = self._entered.setdefault(kind, [])
        for other, place in entered:
            if other == value:
                return place
        entered.append((value, path))
        return ""


def schema_fields(kind: Any) -> Iterator[tuple[str, Any, Mapping[str, Any], Any]]:
    """Yield name, type, metadata and default of each field of a class."""
    if not dc.is_dataclass(kind):
        for field in kind.__fields__:
            yield field.name, field.type, {}, None
        return
    hints = typing.get_type_hints(kind)
    for own in dc.fields(kind):
        default = own.default
        if own.default_factory is not dc.MISSING:
            default = own.default_factory()
        yield own.name, hints[own.name], own.metadata, default


def field_comments(kind: Any) -> Mapping[str, str]:
    """Return the comment of each field; for one without, the class's own summary."""
    names = [name for name, *_ in schema_fields(kind)]
    if not dc.is_dataclass(kind):
        stated = COMMENTS.get(schema_name(kind), {})
        return {name: stated.get(name, _summary(kind)) for name in names}
    stated = class_comments(typing.cast(type[Any], kind))
    summary = {
        field.name: "" if is_schema(field.type) else _summary(kind)
        for field in dc.fields(kind)
    }
    return {name: stated.get(name) or summary[name] for name in names}


def _summary(kind: Any) -> str:
    """Return the first sentence about a class."""
    if not dc.is_dataclass(kind):
        return f"Drake's {code(schema_name(kind))}."
    return " ".join((kind.__doc__ or "").split("\n\n")[0].split())


def _made(kind: Any) -> Any:
    """Return an instance with the defaults, or None if some keys are required."""
    try:
        with unchecked():  # some keys have no valid default
            return kind()
    except TypeError:
        return None
