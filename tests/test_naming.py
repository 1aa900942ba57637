"""Names follow Drake: Make, Add, Set and Connect in Pascal case, the rest in snake."""

import ast
import re
from pathlib import Path

import pytest
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem

ROOT = Path(__file__).parents[1]
MODULES = sorted([*ROOT.glob("drake_srg/**/*.py"), *ROOT.glob("tools/**/*.py")])
# Overrides of Drake's methods, and stand-ins for them, have Drake's names.
DRAKE = {*dir(LeafSystem), *dir(Diagram), *dir(DiagramBuilder)}
SNAKE = re.compile(r"[a-z0-9_]+")
PASCAL = re.compile(r"_?((Make|Add|Set|Connect)[A-Z]\w*|Simulate|Serve)")
MONOGRAM = re.compile(r"_?[pRXV]_[A-Z]\w*")  # X_WG: a pose, a function of something
TEMPLATE = re.compile(r"[A-Z]\w*_")  # instantiates a scalar-converted system


def misnamed(text):
    """Functions and methods whose names break the rule."""
    allowed = (SNAKE, PASCAL, MONOGRAM, TEMPLATE)
    names = [
        node.name
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef)
    ]
    return [
        n for n in names if n not in DRAKE and not any(p.fullmatch(n) for p in allowed)
    ]


def test_functions_are_named_as_in_drake():
    names = {
        str(path.relative_to(ROOT)): misnamed(path.read_text(encoding="utf-8"))
        for path in MODULES
    }
    assert {path: wrong for path, wrong in names.items() if wrong} == {}


@pytest.mark.parametrize(
    "name", ["PlanPath", "Checks", "Slowed", "makeCell", "_Slower"]
)
def test_a_misnamed_function_is_found(name):
    assert misnamed(f"class A:\n    def {name}(self): pass") == [name]
