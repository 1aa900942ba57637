"""The reference of public names: a page per package, made by autodoc."""

from __future__ import annotations

import ast
import functools
import importlib
import inspect

from drake_srg.face import names_of
from make_site.field_comments import assigned_names
from make_site.markdown import table
from make_site.systems import PACKAGE, ROOT

# Modules that are public as a whole.
WHOLE = ("drake_srg.types", "drake_srg.lifetime")


@functools.cache
def faces() -> dict[str, dict[str, str]]:
    """Return the defining modules of public names, by package or module and name."""
    stubs = sorted([PACKAGE / "__init__.pyi", *PACKAGE.glob("*/__init__.pyi")])
    packages = [".".join(stub.parent.relative_to(ROOT).parts) for stub in stubs]
    found = {package: names_of(package) for package in packages}
    return found | {module: dict.fromkeys(_defined(module), module) for module in WHOLE}


def _defined(module: str) -> list[str]:
    """Return the public functions, classes and constants of a module."""
    source = inspect.getsource(importlib.import_module(module))
    names: list[str] = []
    for node in ast.parse(source).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.append(node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            names += assigned_names(node)
    return [name for name in dict.fromkeys(names) if not name.startswith("_")]


def public_names() -> list[str]:
    """Return the dotted names of everything on a page."""
    return [f"{face}.{name}" for face, names in _documented() for name in names]


def _documented() -> list[tuple[str, list[str]]]:
    """Return the names that each page documents; the package's are on other pages."""
    pages = [(face, list(names)) for face, names in faces().items()]
    elsewhere = {name for face, names in pages[1:] for name in names}
    assert set(pages[0][1]) <= elsewhere, "a name of the package is on no other face"
    return pages[1:]


def python_pages() -> dict[str, str]:
    """Return the page of each package by its name, and the overview as `index`."""
    documented = dict(_documented())
    pages = {_page_name(face): _page(face, names) for face, names in documented.items()}
    rows = [
        (f"[{_page_name(f)}]({_page_name(f)}.rst)", _summary(f)) for f in documented
    ]
    top, *_ = faces()
    links = [
        f"[{name}]({_page_name(face)}.rst)"
        for name in faces()[top]
        for face in [next(f for f, names in documented.items() if name in names)]
    ]
    toctree = "\n".join(pages)
    index = (
        "# Python\n\nEvery public name, by the room of the package that offers it: "
        "`from drake_srg.gripper import GripperServo`. Whatever is not here is private "
        "and may change with any version.\n\n"
        f"{table(('room', ''), rows)}\n"
        f"`drake_srg` itself offers the names of most programs: {', '.join(links)}.\n\n"
        f"```{{toctree}}\n:hidden:\n\n{toctree}\n```\n"
    )
    return {**pages, "index": index}


def _page_name(face: str) -> str:
    return face.rpartition(".")[2]


def _page(face: str, names: list[str]) -> str:
    """Return the page of a package, as reStructuredText."""
    parts = [f"{face}\n{'=' * len(face)}\n", f".. automodule:: {face}\n"]
    for name in names:
        value = getattr(importlib.import_module(face), name)
        if inspect.isclass(value):
            parts.append(f".. autoclass:: {face}.{name}\n   :members:\n")
        elif inspect.isfunction(value):
            parts.append(f".. autofunction:: {face}.{name}\n")
        else:
            parts.append(f".. autodata:: {face}.{name}\n   :no-value:\n")
    return "\n".join(parts)


def _summary(face: str) -> str:
    document = inspect.getdoc(importlib.import_module(face)) or ""
    return " ".join(document.split("\n\n")[0].split())
