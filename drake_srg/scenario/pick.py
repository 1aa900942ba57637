"""`task.pick: all`, and what must fit together to clear a table into a bin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from drake_srg.common.exceptions import suggest
from drake_srg.scenario.yaml_tree import describe, fail

if TYPE_CHECKING:
    from drake_srg.scenario.schema import Scenario

_ALL = "all"


def resolve_pick(tree: Mapping[str, Any], origin: str) -> Mapping[str, Any]:
    """Return a scenario's tree with the names of all objects in `task.clear`.

    Args:
        tree: Tree of the whole scenario, with its clutter; not changed.
        origin: File or name at the start of error messages.

    Raises:
        ScenarioError: If there is a bin but `task.pick` is not `all`, or the other way
            round, or if `task.clear` names objects itself.
    """
    task, objects = tree.get("task"), tree.get("objects")
    if not (isinstance(task, Mapping) and isinstance(objects, Mapping)):
        return tree  # `load_typed` reports it
    pick, place, clear = (task.get(key) for key in ("pick", "place", "clear"))
    into = place.get("bin") if isinstance(place, Mapping) else None
    every = pick == _ALL and _ALL not in objects
    if not into:
        if every:
            fail(origin, "task.place.bin", "must name the bin where `all` are picked")
        return tree
    if not every:
        if isinstance(pick, str) and pick not in objects:
            problem = f"unknown object {pick!r} {suggest(pick, [_ALL])}"
        else:
            given = pick if isinstance(pick, str) else describe(pick)
            problem = (
                "must be all with task.place.bin, because the planner does not tell "
                f"objects apart, got {given}"
            )
        fail(origin, "task.pick", problem)
    if clear is None:
        clear = {}
    if not isinstance(clear, Mapping):
        return tree  # `load_typed` reports it
    if "objects" in clear:
        fail(origin, "task.clear.objects", "must be absent: task.pick all sets it")
    clear = {**clear, "objects": list(objects)}
    return {**tree, "task": {**task, "pick": "", "clear": clear}}


def clear_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the key and the description of each problem of clearing the table."""
    clear, table = scenario.task.clear, scenario.table
    if clear is None:
        return
    if not clear.objects:
        yield "task.pick", "needs at least one object for the bin, got none"
    added = [d.add_model.name for d in scenario.directives if d.add_model is not None]
    models = [name for name in added if name not in ("arm", "gripper")]
    into = scenario.task.place.bin
    if into not in models:
        yield "task.place.bin", f"unknown model {into!r} {suggest(into, models)}"
    low, high = clear.region.min, clear.region.max
    if any(a >= b for a, b in zip(low, high, strict=True)):
        yield "task.clear.region", f"min must be below max, got {low} .. {high}"
    if any(a > b for a, b in zip(table.min, low, strict=True)) or any(
        a > b for a, b in zip(high, table.max, strict=True)
    ):
        yield (
            "task.clear.region",
            f"must be on the table, got {low} .. {high} "
            f"(allowed: {table.min} .. {table.max})",
        )
