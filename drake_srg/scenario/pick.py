"""`task.pick` of many objects, and what must fit together to put them into bins."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from drake_srg.common.exceptions import suggest
from drake_srg.scenario.yaml_tree import describe, fail
from drake_srg.vision.color_names import COLORS

if TYPE_CHECKING:
    from drake_srg.scenario.schema import Scenario

_ALL, _ROW = "all", "row"
_ALLOWED = "all, a list of names, {colour: COLOUR}"


def resolve_pick(tree: Mapping[str, Any], origin: str) -> Mapping[str, Any]:
    """Return a scenario's tree with its bins and selections written out.

    `task.pick` with `task.place.bin` becomes an entry of `task.place.bins`, and the
    names of the objects for the bins or the row become `task.clear.objects`.

    Args:
        tree: Tree of the whole scenario, with its clutter; not changed.
        origin: File or name at the start of error messages.

    Raises:
        ScenarioError: If `task.pick` and `task.place` do not go together, or if
            `task.clear` names objects itself.
    """
    task, objects = tree.get("task"), tree.get("objects")
    if not (isinstance(task, Mapping) and isinstance(objects, Mapping)):
        return tree  # `load_typed` reports it
    pick, clear = task.get("pick"), task.get("clear")
    place = task.get("place")
    if not isinstance(place, Mapping):
        place = {}  # `load_typed` reports any other type
    given = [key for key in ("bin", "bins") if place.get(key)]
    if place.get("row") is not None:  # {} is a row with the defaults
        given.append("row")
    if not given:
        return _without_bin(tree, origin)
    if len(given) > 1:
        problem = f"needs one of bin, bins and row, got {' and '.join(given)}"
        fail(origin, "task.place", problem)
    bins = _bins(pick, place, objects, origin)
    if not isinstance(bins, Mapping):
        return tree  # `load_typed` reports it
    clear = {} if clear is None else clear
    if not isinstance(clear, Mapping):
        return tree  # `load_typed` reports it
    if "objects" in clear:
        fail(origin, "task.clear.objects", "must be absent: task.pick sets it")
    named = [selection.get("names") for selection in bins.values()]
    every = [name for name in objects if _present(objects[name])]
    if all(isinstance(names, list) for names in named):
        every = [name for names in named for name in names]
    clear = {**clear, "objects": every}
    place = {**place, "bins": {} if "row" in given else bins}
    return {**tree, "task": {**task, "pick": "", "clear": clear, "place": place}}


def _bins(
    pick: Any, place: Mapping[str, Any], objects: Mapping[str, Any], origin: str
) -> Any:
    """Return what goes where: trees of SelectionConfigs by the name of the place."""
    into, bins = place.get("bin"), place.get("bins")
    if into and not isinstance(into, str):
        fail(origin, "task.place.bin", f"must be text, got {_shown(into)}")
    if place.get("row") is not None and not isinstance(pick, list):
        problem = f"must be a list of names with task.place.row, got {_shown(pick)}"
        fail(origin, "task.pick", problem)
    if not bins:
        return {into or _ROW: _selection(pick, objects, origin, "task.pick")}
    if pick != _ALL:
        problem = f"must be all with task.place.bins, got {_shown(pick)}"
        fail(origin, "task.pick", problem)
    if not isinstance(bins, Mapping):
        return bins
    return {
        name: _selection(given, objects, origin, f"task.place.bins.{name}")
        for name, given in bins.items()
    }


def _without_bin(tree: Mapping[str, Any], origin: str) -> Mapping[str, Any]:
    """Return the tree of a scenario that sets one object down; a list may name it."""
    task, pick = tree["task"], tree["task"].get("pick")
    if pick == _ALL and _ALL not in tree["objects"]:
        fail(origin, "task.place.bin", "must name the bin where `all` are picked")
    if isinstance(pick, Mapping):
        fail(origin, "task.place.bin", "must name the bin for objects of a colour")
    if not isinstance(pick, list):
        return tree
    if len(pick) != 1:
        problem = f"must name one object without task.place.bin, got {len(pick)}"
        fail(origin, "task.pick", problem)
    return {**tree, "task": {**task, "pick": pick[0]}}


def _selection(
    given: Any, objects: Mapping[str, Any], origin: str, key: str
) -> Mapping[str, Any]:
    """Return what `task.pick` or a bin selects, as the tree of a SelectionConfig."""
    if given == _ALL and _ALL not in objects:
        return {}
    if isinstance(given, str):
        if given not in objects:
            allowed = suggest(given, [_ALL, *objects])
            fail(origin, key, f"unknown object {given!r} {allowed}")
        given = [given]
    if isinstance(given, list):
        if not given:
            fail(origin, key, "must name at least one object")
        for i, name in enumerate(given):
            if not (isinstance(name, str) and name in objects):
                allowed = suggest(str(name), objects)
                fail(origin, key, f"unknown object {_shown(name)} {allowed}")
            if name in given[:i]:
                fail(origin, key, f"must name each object once, got {name!r} again")
        return {"names": given}
    if not (isinstance(given, Mapping) and given.get("colour")):
        fail(origin, key, f"must be one of: {_ALLOWED}, got {_shown(given)}")
    if (colour := given["colour"]) not in COLORS:
        known = suggest(str(colour), COLORS)
        fail(origin, f"{key}.colour", f"unknown {_shown(colour)} {known}")
    return given


def _present(given: Any) -> bool:
    return not (isinstance(given, Mapping) and given.get("present") is False)


def _shown(given: Any) -> str:
    return repr(given) if isinstance(given, str) else describe(given)


def clear_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the key and the description of each problem of clearing the table."""
    clear, table = scenario.task.clear, scenario.table
    if clear is None:
        if scenario.task.place.cameras:
            yield "task.place.cameras", "needs task.place.bin, bins or row"
        return
    if not clear.objects:
        yield "task.pick", "needs at least one object for the bin, got none"
    yield from _bin_problems(scenario)
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


def _bin_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield bins that are not there, and what the cameras cannot tell."""
    added = [d.add_model.name for d in scenario.directives if d.add_model is not None]
    models = [name for name in added if name not in ("arm", "gripper")]
    place = scenario.task.place
    taken: dict[str, str] = {}  # what has a bin already: the bin
    for name, selection in place.bins.items():
        key = "task.place.bin" if place.bin else f"task.place.bins.{name}"
        if name not in models:
            yield key, f"unknown model {name!r} {suggest(name, models)}"
        if selection.names and selection.colour:
            yield key, "needs either names or a colour"
        for thing in selection.names or [selection.colour or _ALL]:
            if thing in taken:
                yield key, f"must not take {thing!r}, which {taken[thing]!r} takes"
            taken[thing] = name
        for thing in selection.names:
            if not scenario.objects[thing].known:
                yield f"objects.{thing}.known", "must be true for an object with a name"
