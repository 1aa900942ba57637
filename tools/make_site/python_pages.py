"""The reference of public names: a page per room of the package, made by autodoc."""

from __future__ import annotations

import ast
import functools
import importlib
from collections.abc import Iterator
from pathlib import Path

from make_site.field_comments import assigned_names
from make_site.markdown import code, table
from make_site.systems import PACKAGE, ROOT

# Below these, every module has its place on the page of a part of the room.
_LARGE = ("planning",)


def modules() -> Iterator[str]:
    """Yield the dotted names of all public modules."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if parts[-1] != "__main__":
            yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def public_names(module: str) -> list[str]:
    """Return the functions, classes and constants that a module defines for others.

    Names that its `__all__` hands on are documented where they are defined.
    """
    return [name for names in _defined(module) for name in names]


@functools.cache
def _defined(module: str) -> tuple[list[str], list[str]]:
    """Return the functions and classes of a module, and its other public names."""
    path = PACKAGE.parent.joinpath(*module.split("."))
    source = path.with_suffix(".py") if not path.is_dir() else path / "__init__.py"
    classes: list[str] = []
    others: list[str] = []
    for node in ast.parse(source.read_text(encoding="utf-8")).body:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            if not any(map(_makes_command, node.decorator_list)):
                classes.append(node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            others += assigned_names(node)
    # A template of Drake's, `GripperServo_`, is documented as its class for floats,
    # to which an assignment gives its name.
    made = [name.removesuffix("_") for name in classes if name.endswith("_")]
    classes = [name for name in classes if name not in others] + made
    others = [name for name in others if name not in made]
    return _public(classes), _public(others)


def _makes_command(decorator: ast.expr) -> bool:
    """Return whether a decorator makes a command, which a page of its own describes."""
    return isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "command"


def _public(names: list[str]) -> list[str]:
    return [n for n in dict.fromkeys(names) if n and "_" not in (n[0], n[-1])]


def page_of(module: str) -> str:
    """Return the name of the page on which a module is."""
    parts = module.split(".")[1:]
    if not parts:
        return "drake_srg"
    if parts[0] in _LARGE and _is_package(f"drake_srg.{'.'.join(parts[:2])}"):
        return "_".join(parts[:2])
    return parts[0]


def python_pages() -> dict[str, str]:
    """Return the page of each room by its name, and of all as `index`."""
    grouped: dict[str, list[str]] = {}
    for module in modules():
        grouped.setdefault(page_of(module), []).append(module)
    pages = {name: _page(name, members) for name, members in grouped.items()}
    rows = [(f"[{n}]({n}.rst)", _summary(m[0])) for n, m in grouped.items()]
    names = "\n".join(grouped)
    pages["index"] = (
        "# Python\n\nEvery public name, by the room of the package that it is in. "
        "Rooms import downwards only.\n\n"
        f"{table(('room', ''), rows)}\n"
        f"```{{toctree}}\n:hidden:\n\n{names}\n```\n"
    )
    return pages


def _page(name: str, group: list[str]) -> str:
    """Return the page of a room, as reStructuredText."""
    title = group[0] if name in ("drake_srg", group[0].split(".")[-1]) else name
    parts = [_heading(title, "=")]
    for module in group:
        if module != title:
            parts.append(_heading(module.removeprefix("drake_srg."), "-"))
        defined, constants = _defined(module)
        members = f"   :members: {', '.join(defined)}\n" if defined else ""
        parts.append(f".. automodule:: {module}\n{members}")
        parts += [f".. autodata:: {module}.{n}\n   :no-value:\n" for n in constants]
        # Names that a package hands on are documented in their own modules.
        if handed := _handed_on(module):
            parts.append(f"Names: {handed}.\n")
    return "\n".join(parts)


def _heading(text: str, line: str) -> str:
    return f"{text}\n{line * len(text)}\n"


def _handed_on(module: str) -> str:
    """Return links to the names that a package's `__all__` takes from its modules."""
    if not _is_package(module):
        return ""
    loaded = importlib.import_module(module)
    names = getattr(loaded, "__all__", [])
    links = []
    for name in names:
        home = getattr(getattr(loaded, name), "__module__", "")
        target = f"{home}.{name}" if str(home).startswith("drake_srg.") else ""
        links.append(f":py:obj:`{name} <{target}>`" if target else f"``{name}``")
    return ", ".join(links)


def _is_package(module: str) -> bool:
    return Path(PACKAGE.parent.joinpath(*module.split("."))).is_dir()


def _summary(module: str) -> str:
    document = importlib.import_module(module).__doc__ or code(module)
    return " ".join(document.split("\n\n")[0].split())
