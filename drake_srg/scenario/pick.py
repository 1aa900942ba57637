"""The forms of `task.pick` that name several objects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drake_srg.common.exceptions import suggest
from drake_srg.scenario.yaml_tree import fail

ALL = "all"


def resolve_pick(tree: Mapping[str, Any], origin: str) -> Mapping[str, Any]:
    """Return a scenario's tree with `task.clear` in place of several picked objects.

    Args:
        tree: Tree of the whole scenario, with its clutter; not changed.
        origin: File or name at the start of error messages.

    Raises:
        ScenarioError: If the task has several objects and no bin, a bin and no object,
            or a name that is not there.
    """
    task, objects = tree.get("task"), tree.get("objects")
    if not (isinstance(task, Mapping) and isinstance(objects, Mapping)):
        return tree  # `load_typed` reports it
    pick, place = task.get("pick"), task.get("place")
    into = place.get("bin") if isinstance(place, Mapping) else None
    several = isinstance(pick, list) or (pick == ALL and ALL not in objects)
    if not into:
        if several:
            fail(origin, "task.pick", "several objects need task.place.bin")
        return tree
    names = list(objects) if pick == ALL and several else pick
    if isinstance(pick, str) and not several:
        names = [pick] if pick else []
    if not isinstance(names, list):
        return tree
    if not names:
        fail(origin, "task.pick", "needs at least one object for the bin, got none")
    for name in names:
        if name not in objects:
            hint = suggest(str(name), objects)
            fail(origin, "task.pick", f"unknown object {name!r} {hint}")
    clear = {**(task.get("clear") or {}), "objects": names}
    return {**tree, "task": {**task, "pick": "", "clear": clear}}
