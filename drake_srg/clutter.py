"""Clutter: as many more objects as are drawn, each of one of several kinds."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from pydrake.common.schema import UniformDiscrete

from drake_srg.distributions import draw_distributions, key_generator
from drake_srg.yaml_loading import check_tree, fail

_MOST = 100


def add_clutter(
    tree: Mapping[str, Any], seed: int, origin: str, values: dict[str, Any]
) -> dict[str, Any]:
    """Return a scenario's tree with `clutter` among its `objects`, still to be drawn.

    Args:
        tree: Of the whole scenario; it is not changed.
        seed: Of the draws.
        origin: File or name to begin errors with.
        values: Gets the number of things, where it is drawn, and their kinds, by keys.

    Raises:
        ScenarioError: If the number is none, or there is nothing to choose from.
    """
    tree, clutter = dict(tree), tree.get("clutter")
    if not isinstance(clutter, Mapping):  # `load_typed` complains, where it must
        return tree
    key = "clutter.count"
    drawn = draw_distributions(clutter.get("count", 0), seed, origin, values, key)
    count: int = check_tree(drawn, int, origin, key)
    if not 0 <= count <= _MOST:
        fail(origin, key, f"must be 0 .. {_MOST}, is {count}")
    kinds = clutter.get("kinds", {})
    if not (_is_mapping(kinds) and all(map(_is_mapping, kinds.values()))):
        return tree
    if count > 0 and not kinds:
        fail(origin, "clutter.kinds", "must have an entry to choose from, is empty")
    objects = dict(tree.get("objects") or {})
    for name in (f"clutter_{i + 1}" for i in range(count)):
        if name in objects:
            fail(origin, f"objects.{name}", "is the name of one of the clutter's")
        indices = UniformDiscrete(list(range(len(kinds))))
        index = int(indices.Sample(key_generator(seed, f"objects.{name}")))
        kind = sorted(kinds)[index]
        values[f"objects.{name}.kind"] = kind
        objects[name] = {"known": False, **copy.deepcopy(dict(kinds[kind]))}
    clutter = {**clutter, "count": count, "kinds": {}}
    return {**tree, "objects": objects, "clutter": clutter}


def _is_mapping(value: Any) -> bool:
    return isinstance(value, Mapping)
