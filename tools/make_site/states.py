"""The planners' states, drawn from their transition tables."""

from __future__ import annotations

import ast
import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from drake_srg.arm.safety import monitor
from drake_srg.planning.clearing import knowledge as clearing
from drake_srg.planning.pick_and_place import knowledge as pick_and_place
from drake_srg.planning.servoing import planner as servoing
from drake_srg.theses import taught
from make_site.markdown import code, table

_Table = Mapping[Any, Sequence[tuple[Callable[..., bool], Any]]]
TABLES: Mapping[str, tuple[str, _Table]] = {
    "!PickAndPlace": (
        "Sets one object on its goal. A used-up time budget and a protective stop lead "
        "from every mode to FAILED.",
        pick_and_place.TRANSITIONS,
    ),
    "!Servoing": (
        "The same with a visual servo, which may give up while it grasps or lifts.",
        servoing.SERVO_TRANSITIONS,
    ),
    "!Clear": (
        "Clears or sorts a table. Every failure leads from every mode to FAILED.",
        clearing.TRANSITIONS,
    ),
    "!Taught": (
        "Goes through taught postures, as the five-axis arm's thesis does.",
        taught.TRANSITIONS,
    ),
    "SafetyMonitor": ("Stops the arm, and starts it again.", monitor.TRANSITIONS),
}
# Pixels: of a box, between boxes, of the margin with the arcs.
_WIDTH, _HEIGHT, _STEP, _MARGIN = 170, 26, 44, 190


def states_page() -> str:
    """Return a drawing and a table of transitions for each state machine."""
    parts = []
    for name, (text, transitions) in TABLES.items():
        rows = [
            (code(mode.name), code(following.name), code(condition_words(condition)))
            for mode, leads in transitions.items()
            for condition, following in leads
        ]
        parts += [
            f"## {name}\n\n{text}\n",
            f"```{{raw}} html\n{drawing(transitions)}```\n",
        ]
        parts += [table(("from", "to", "when"), rows)]
    return "\n".join(parts)


def drawing(transitions: _Table) -> str:
    """Return an SVG: modes from top to bottom, arcs where one leads past the next.

    Arcs on the right lead down, those on the left lead back up.
    """
    into = {following for leads in transitions.values() for _, following in leads}
    modes = [mode for mode in transitions if transitions[mode] or mode in into]
    rows = {mode: i for i, mode in enumerate(modes)}
    middle = _MARGIN + _WIDTH / 2
    lines = []
    for mode, leads in transitions.items():
        for following in dict.fromkeys(following for _, following in leads):
            lines.append(_arrow(rows[mode], rows[following], middle))
    for mode, row in rows.items():
        y = _STEP * row + 8
        lines.append(
            f'<rect x="{_MARGIN}" y="{y}" width="{_WIDTH}" height="{_HEIGHT}" rx="5"/>'
            f'<text x="{middle}" y="{y + 18}">{mode.name}</text>'
        )
    height, width = _STEP * len(modes), 2 * _MARGIN + _WIDTH
    return (
        f'<svg class="states" viewBox="0 0 {width} {height}" role="img" '
        'aria-label="Which mode follows which"><defs><marker id="tip" refX="7" '
        'refY="3" markerWidth="8" markerHeight="6" orient="auto"><path class="tip" '
        f'd="M0 0L8 3L0 6z"/></marker></defs>{"".join(lines)}</svg>\n'
    )


def _arrow(start: int, end: int, middle: float) -> str:
    """Return an arrow between two rows: straight to the next one, else an arc."""
    y = 8 + _HEIGHT / 2
    a, b = _STEP * start + y, _STEP * end + y
    if end == start + 1:
        half = _HEIGHT / 2
        path = f"M{middle} {a + half}L{middle} {b - half}"
    else:
        side = 1 if end > start else -1
        x = middle + side * _WIDTH / 2
        # The farther an arc leads, the wider it is; ends of arcs are not on top.
        reach = x + side * 18 * (1 + 1.15 * abs(end - start)) ** 0.95
        a, b = a + 5 * side, b - 5 * side
        path = f"M{x} {a}C{reach:.0f} {a} {reach:.0f} {b} {x} {b}"
    return f'<path class="arc" d="{path}" marker-end="url(#tip)"/>'


def condition_words(condition: Callable[..., bool]) -> str:
    """Return a condition in words: the source of a lambda's body, else its name."""
    place = condition.__code__
    if condition.__name__ != "<lambda>":
        return condition.__name__.strip("_")
    return _lambdas(inspect.getfile(condition))[place.co_firstlineno]


@functools.cache
def _lambdas(file: str) -> Mapping[int, str]:
    """Return the bodies of the lambdas of a file by the lines where they begin."""
    found = {}
    for node in ast.walk(ast.parse(Path(file).read_text("utf-8"))):
        if isinstance(node, ast.Lambda):
            words = ast.unparse(node.body)
            found[node.lineno] = words.replace("o.", "").replace("c.", "")
    return found
