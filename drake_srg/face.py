"""Public names of packages (their faces), imported on first use.

A package lists its public names in `__init__.pyi`, one `from MODULE import NAME as
NAME` each. Type checkers read that file, and so does `face`. All other names are
private. With this, `import drake_srg.gripper` takes no time, and a package's public
names cannot cause circular imports.
"""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def names_of(package: str) -> dict[str, str]:
    """Return the module of each public name of a package."""
    init = Path(str(importlib.import_module(package).__file__))
    stub = ast.parse(init.with_suffix(".pyi").read_text("utf-8"))
    imports = [line for line in stub.body if isinstance(line, ast.ImportFrom)]
    return {line.names[0].name: str(line.module) for line in imports}


def face(
    package: str,
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return a package's `__getattr__`, `__dir__` and `__all__` (PEP 562).

    Args:
        package: The package's `__name__`. Its `__init__.pyi` must be beside its
            `__init__.py`.
    """
    module, homes = sys.modules[package], names_of(package)

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(homes[name]), name)
        setattr(module, name, value)
        return value

    def names() -> list[str]:
        return sorted({*vars(module), *homes})

    return get, names, list(homes)
