"""Reads the comments that document fields of dataclasses, and constants."""

from __future__ import annotations

import ast
import dataclasses as dc
import functools
import inspect
import io
import re
import sys
import textwrap
import tokenize
from collections.abc import Sequence

# Unit symbols; products, quotients and powers of them are units, too.
_ATOMS = (
    *("m", "mm", "um", "s", "ms", "rad", "deg", "kg", "N", "Pa", "K", "V", "A", "W"),
    *("J", "Ohm", "Hz", "degrees", "degC", "pixel", "pixels", "stops", "messages"),
)
_ATOM = "|".join(sorted(_ATOMS, key=len, reverse=True))
_FACTOR = rf"(?:1|{_ATOM})(?:²|³|\^\d)?"
_UNIT = re.compile(rf"\(?{_FACTOR}(?:[ /*(]+{_FACTOR}\)?)*\)?")


def class_comments(kind: type) -> dict[str, str]:
    """Return the comment of each field of a class, inherited ones included.

    A comment stands above a field, or behind it. One above several fields of one type
    without comments of their own belongs to all of them.
    """
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if dc.is_dataclass(base):
            found.update(_own_comments(base))
    return found


def unit_of(comment: str) -> str:
    """Return the unit that a comment states: `[m/s]`, or at its beginning; or ""."""
    for candidate in re.findall(r"\[([^\]]+)\]", comment):
        if _is_unit(candidate):
            return str(candidate)
    first = re.split(r"[,.:;]", comment)[0].strip()
    return first if _is_unit(first) else ""


def _is_unit(text: str) -> bool:
    return all(_UNIT.fullmatch(part) for part in text.split(" or "))


@functools.cache
def _own_comments(kind: type) -> dict[str, str]:
    try:
        source = textwrap.dedent(inspect.getsource(kind))
    except (OSError, TypeError):  # generated, as by functools
        return {}
    (node,) = ast.parse(source).body
    assert isinstance(node, ast.ClassDef)
    return _comments_of(node.body, source)


@functools.cache
def module_comments(module: str) -> dict[str, str]:
    """Return the comments of the constants of an imported module, by their names."""
    source = inspect.getsource(sys.modules[module])
    return _comments_of(ast.parse(source).body, source)


def _comments_of(body: Sequence[ast.stmt], source: str) -> dict[str, str]:
    comments = _comments_by_line(source)
    found: dict[str, str] = {}
    last, hint, end = "", "", 0  # the field before: comment, type, last line
    for node in body:
        if not isinstance(node, (ast.AnnAssign, ast.Assign)):
            last = ""
            continue
        names = assigned_names(node)
        kind = ast.unparse(node.annotation) if isinstance(node, ast.AnnAssign) else ""
        lines = range(node.lineno, (node.end_lineno or node.lineno) + 1)
        above = _block_above(comments, node.lineno)
        behind = [comments[line][1] for line in lines if line in comments]
        if not (above or behind) and kind == hint and end + 1 == node.lineno:
            above = last
        last, hint, end = above, kind, lines[-1]
        for name in names:
            found[name] = " ".join([*filter(None, [above]), *behind])
    return found


def assigned_names(node: ast.AnnAssign | ast.Assign) -> list[str]:
    """Return the names to which a statement assigns."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    parts = [
        part for t in targets for part in (t.elts if isinstance(t, ast.Tuple) else [t])
    ]
    return [part.id for part in parts if isinstance(part, ast.Name)]


def _comments_by_line(source: str) -> dict[int, tuple[bool, str]]:
    """Return each comment by its line: whether it stands alone, and its words."""
    lines = source.splitlines()
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {
        row: (not lines[row - 1][:column].strip(), text.lstrip("#").strip())
        for kind, text, (row, column), _, _ in tokens
        if kind == tokenize.COMMENT and "noqa" not in text
    }


def _block_above(comments: dict[int, tuple[bool, str]], line: int) -> str:
    """Return the lines of comment directly above a line, as one."""
    words: list[str] = []
    while comments.get(line - 1, (False, ""))[0]:
        line -= 1
        words.insert(0, comments[line][1])
    return " ".join(words)
