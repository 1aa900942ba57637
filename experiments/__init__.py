"""Claims about the models, drivers and planners, and the trials that test them.

A file here holds one or a few experiments; `runner` runs and judges them, `stands` has
what several share. Run one with `python -m experiments NAME`, and see
docs/experiments.md for how to add a claim.
"""

import ast
import functools
from pathlib import Path
from typing import NamedTuple

FOLDER = Path(__file__).resolve().parent


class Found(NamedTuple):
    """An experiment, as read from the source without importing it."""

    module: str
    description: str


def find_experiments() -> dict[str, Found]:
    """Return every experiment by name, in order; read once per process."""
    return _find(FOLDER)


@functools.cache
def _find(folder: Path) -> dict[str, Found]:
    found = {}
    for path in folder.glob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            match node:
                case ast.Assign(
                    targets=[ast.Name(id=name)],
                    value=ast.Call(
                        func=ast.Attribute(attr="Experiment"),
                        args=[ast.Constant(value=str(text)), *_],
                    ),
                ):
                    found[name] = Found(f"{__name__}.{path.stem}", text)
    return dict(sorted(found.items()))
