"""The rules between scenario keys, read from the code that checks them."""

from __future__ import annotations

import ast
import inspect
import re
import sys
from collections.abc import Iterator, Mapping

from drake_srg.scenario.checks import check_scenario, clear_problems
from make_site.markdown import code, table

# The keys that functions get as an argument, or from another function.
_GIVEN = {"_object_problems": "objects.NAME", "_step_problems": "NAME.period"}


def rules_page() -> str:
    """Return a table of the checks of a scenario as a whole."""
    modules = dict.fromkeys(f.__module__ for f in (check_scenario, clear_problems))
    sources = [inspect.getsource(sys.modules[name]) for name in modules]
    rows = [row for source in sources for row in rules(source)]
    heads = ("key", "message if it is broken")
    return table(heads, [(code(key), code(problem)) for key, problem in rows])


def rules(source: str) -> Iterator[tuple[str, str]]:
    """Yield the keys and messages that a module's functions `..._problems` yield.

    Values stand as `...`, unless a reader understands their names.
    """
    module = ast.parse(source)
    constants = _texts(module.body)
    for function in module.body:
        if not isinstance(function, ast.FunctionDef):
            continue
        if not function.name.endswith("_problems"):
            continue
        known = {**constants, **_texts(ast.walk(function))}
        for node in ast.walk(function):
            if not (isinstance(node, ast.Yield) and isinstance(node.value, ast.Tuple)):
                continue
            key, problem = node.value.elts
            message = re.sub(r",? got .*?(?= \(allowed|$)", "", _words(problem, known))
            for each in _looped_keys(function, key) or [_words(key, known)]:
                path = each.replace("<key>", _GIVEN.get(function.name, "..."))
                path = path.replace("<name>", "NAME").replace("<i>", "i")
                yield path, re.sub(r"<[^>]*[^>\w.][^>]*>", "...", message)


def _texts(nodes: Iterator[ast.AST] | list[ast.stmt]) -> dict[str, ast.expr]:
    """Return the texts that statements assign, by name."""
    return {
        target.id: node.value
        for node in nodes
        if isinstance(node, ast.Assign)
        and isinstance(node.value, (ast.JoinedStr, ast.Constant))
        for target in node.targets
        if isinstance(target, ast.Name)
    }


def _looped_keys(function: ast.FunctionDef, key: ast.expr) -> list[str]:
    """Return the keys that a loop around the message writes out, if there is one."""
    for node in ast.walk(function):
        if (
            isinstance(node, ast.For)
            and isinstance(node.iter, ast.Tuple)
            and isinstance(node.target, ast.Tuple)
            and any(child is key for child in ast.walk(node))
            and ast.unparse(node.target.elts[0]) == ast.unparse(key)
        ):
            items = [item for item in node.iter.elts if isinstance(item, ast.Tuple)]
            return [_words(item.elts[0], {}) for item in items]
    return []


def _words(node: ast.expr, known: Mapping[str, ast.expr]) -> str:
    """Return the words of a text; a value is its expression in angle brackets."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(_words(part, known) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        node = node.value
    if isinstance(node, ast.Name) and node.id in known:
        return _words(known[node.id], {k: v for k, v in known.items() if k != node.id})
    return f"<{ast.unparse(node)}>"
