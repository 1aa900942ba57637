"""Draws what a scenario leaves to chance, each key from its own stream."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.common.schema import (
    Deterministic,
    DeterministicVectorX,
    Gaussian,
    GaussianVectorX,
    Uniform,
    UniformDiscrete,
    UniformVectorX,
)
from pydrake.common.yaml import yaml_dump, yaml_load_typed

from drake_srg.scenario.yaml_tree import check_tree, fail, join, names

_MOST_CLUTTER = 100

_DISTRIBUTIONS = {
    "!Deterministic": (Deterministic, {"value"}),
    "!Gaussian": (Gaussian, {"mean", "stddev"}),
    "!Uniform": (Uniform, {"min", "max"}),
    "!UniformDiscrete": (UniformDiscrete, {"values"}),
    "!DeterministicVector": (DeterministicVectorX, {"value"}),
    "!GaussianVector": (GaussianVectorX, {"mean", "stddev"}),
    "!UniformVector": (UniformVectorX, {"min", "max"}),
}


def key_generator(seed: int, key: str) -> RandomGenerator:
    """Return the random generator that belongs to one key of a scenario.

    Each key draws from its own stream, so that a change of one field leaves what the
    others draw as it was.
    """
    digest = hashlib.sha256(f"{seed}/{key}".encode()).digest()
    return RandomGenerator(int.from_bytes(digest[:4], "little"))


def draw_distributions(
    tree: Any,
    seed: int,
    origin: str,
    values: dict[str, Any] | None = None,
    key: str = "",
) -> Any:
    """Return `tree` with every distribution of Drake's schema replaced by a draw.

    Args:
        tree: As `parse_yaml` returns it.
        seed: Of all draws.
        origin: File or option to name in errors.
        values: Gets what is drawn, by its key; of vectors each entry.
        key: Dotted path of `tree`.

    Raises:
        ScenarioError: If a distribution's numbers do not make one.
    """
    if isinstance(tree, Mapping):
        if tree.get("_tag") in _DISTRIBUTIONS and "limit_angle_deg" not in tree:
            drawn = _draw(tree, seed, origin, key)
            if values is None:
                return drawn
            values |= (
                {f"{key}[{i}]": x for i, x in enumerate(drawn)}
                if isinstance(drawn, list)
                else {key: drawn}
            )
            return drawn
        return {
            k: draw_distributions(v, seed, origin, values, join(key, k))
            for k, v in tree.items()
        }
    if isinstance(tree, list):
        return [
            draw_distributions(v, seed, origin, values, f"{key}[{i}]")
            for i, v in enumerate(tree)
        ]
    return tree


def _draw(node: Mapping[str, Any], seed: int, origin: str, key: str) -> Any:
    tag = node["_tag"]
    cls, fields = _DISTRIBUTIONS[tag]
    given = {k: v for k, v in node.items() if k != "_tag"}
    try:
        if set(given) != fields:
            raise ValueError
        for value in given.values():
            check_tree(value, float if not isinstance(value, list) else list[float], "")
            if not np.all(np.isfinite(np.array(value, dtype=float))):
                raise ValueError
        drawn = yaml_load_typed(schema=cls, data=yaml_dump(given))
        if "min" in given and np.any(np.array(given["min"]) > np.array(given["max"])):
            raise ValueError
        if "stddev" in given and np.any(np.array(given["stddev"], dtype=float) < 0.0):
            raise ValueError
        return np.asarray(drawn.Sample(key_generator(seed, key))).tolist()
    except Exception:
        fail(
            origin,
            key,
            f"{tag} needs finite numbers for {names(fields)}"
            + (", in lists of the same length" if tag.endswith("Vector") else "")
            + (", with min not above max" if "min" in fields else "")
            + (", with stddev at least 0" if "stddev" in fields else ""),
        )


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
    if not 0 <= count <= _MOST_CLUTTER:
        fail(origin, key, f"must be 0 .. {_MOST_CLUTTER}, got {count}")
    kinds = clutter.get("kinds", {})
    if not (_is_mapping(kinds) and all(map(_is_mapping, kinds.values()))):
        return tree
    if count > 0 and not kinds:
        fail(origin, "clutter.kinds", "needs at least one kind, got none")
    objects = dict(tree.get("objects") or {})
    for name in (f"clutter_{i + 1}" for i in range(count)):
        if name in objects:
            fail(origin, f"objects.{name}", "this name is reserved for clutter")
        indices = UniformDiscrete(list(range(len(kinds))))
        index = int(indices.Sample(key_generator(seed, f"objects.{name}")))
        kind = sorted(kinds)[index]
        values[f"objects.{name}.kind"] = kind
        objects[name] = {"known": False, **copy.deepcopy(dict(kinds[kind]))}
    clutter = {**clutter, "count": count, "kinds": {}}
    return {**tree, "objects": objects, "clutter": clutter}


def _is_mapping(value: Any) -> bool:
    return isinstance(value, Mapping)
