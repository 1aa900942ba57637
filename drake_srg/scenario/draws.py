"""Draws of a scenario's random values, each key from its own random stream."""

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

from drake_srg.config import names
from drake_srg.scenario.typed_yaml import check_tree, fail, join, merge

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
    """Return the random generator for one key of a scenario.

    Each key draws from its own stream, so a change of one field does not change the
    draws of others.
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
        tree: A tree of `parse_yaml`; not changed.
        seed: Seed of all draws.
        origin: File or option at the start of error messages.
        values: Receives the drawn numbers by key, one entry per number of a vector.
        key: Dotted path of `tree`.

    Raises:
        ScenarioError: If the numbers of a distribution are invalid.
    """
    if isinstance(tree, Mapping):
        if is_distribution(tree):
            distribution = load_distribution(tree, origin, key)
            drawn = np.asarray(distribution.Sample(key_generator(seed, key))).tolist()
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


def is_distribution(tree: Any) -> bool:
    """Return whether a tree is one of the distributions of Drake's schema."""
    return (
        isinstance(tree, Mapping)
        and tree.get("_tag") in _DISTRIBUTIONS
        and "limit_angle_deg" not in tree
    )


def load_distribution(node: Mapping[str, Any], origin: str, key: str) -> Any:
    """Return the distribution in a tree, as an object of Drake with a method `Sample`.

    Args:
        node: A tree for which `is_distribution` holds.
        origin: File or option at the start of error messages.
        key: Dotted path of `node`.

    Raises:
        ScenarioError: If the distribution's numbers are invalid.
    """
    tag = node["_tag"]
    cls, fields = _DISTRIBUTIONS[tag]
    given = {k: v for k, v in node.items() if k != "_tag"}
    try:
        if set(given) != fields:
            raise ValueError
        distribution = cls()
        for field, value in given.items():
            kind = list[float] if isinstance(value, list) else float
            number = check_tree(value, kind, "")
            if not np.all(np.isfinite(number)):
                raise ValueError
            if field == "stddev" and np.min(number) < 0.0:
                raise ValueError
            setattr(distribution, field, number)
        if "min" in given and np.any(distribution.min > distribution.max):
            raise ValueError
        distribution.Sample(RandomGenerator(0))  # lists of different lengths fail
        return distribution
    except Exception:
        fail(
            origin,
            key,
            f"{tag} needs finite numbers for {names(fields)}"
            + (", in lists of the same length" if tag.endswith("Vector") else "")
            + (", with min not above max" if "min" in fields else "")
            + (", with stddev at least 0" if "stddev" in fields else ""),
        )


def draw_choices(
    tree: Mapping[str, Any], seed: int, origin: str, values: dict[str, Any]
) -> dict[str, Any]:
    """Return a scenario's tree merged with one choice of each group in `choices`.

    A choice may itself contain `choices`, which are drawn next. `chosen` names choices
    of groups that are not drawn.

    Args:
        tree: Tree of the whole scenario; not changed.
        seed: Seed of the draws.
        origin: File or name at the start of error messages.
        values: Receives the names of drawn choices, by `choices.GROUP`.

    Raises:
        ScenarioError: If a group has no choices, or a choice does not fit the tree.
    """
    tree = dict(tree)
    chosen = tree.get("chosen") or {}
    if not _is_mapping(chosen):
        return tree
    while groups := tree.pop("choices", None):
        if not _is_mapping(groups):
            fail(origin, "choices", "must be a mapping of groups of choices")
        for group, given in groups.items():
            key = f"choices.{group}"
            choices = _without_nulls(given) if _is_mapping(given) else given
            if not (_is_mapping(choices) and choices):
                fail(origin, key, "must be a mapping of at least one choice")
            names, name = sorted(choices), chosen.get(group)
            if name is None:
                indices = UniformDiscrete(list(range(len(names))))
                name = names[int(indices.Sample(key_generator(seed, key)))]
                values[key] = name
            elif name not in names:
                allowed = ", ".join(names)
                fail(origin, f"chosen.{group}", f"got {name!r} (allowed: {allowed})")
            if not _is_mapping(choices[name]):
                fail(origin, f"{key}.{name}", "must be a mapping of a scenario's keys")
            tree = dict(merge(tree, _of_what_is_left(tree, choices[name]), origin))
    return tree


def _of_what_is_left(
    tree: Mapping[str, Any], choice: Mapping[str, Any]
) -> dict[str, Any]:
    """Return a choice without changes to entries that the tree has removed by null."""
    left = dict(choice)
    for group in ("objects", "cameras"):
        given, entries = choice.get(group), tree.get(group)
        if isinstance(given, Mapping) and isinstance(entries, Mapping):
            gone = {name for name, entry in entries.items() if entry is None}
            left[group] = {k: v for k, v in given.items() if k not in gone}
    return left


def add_clutter(
    tree: Mapping[str, Any], seed: int, origin: str, values: dict[str, Any]
) -> dict[str, Any]:
    """Return a scenario's tree with the clutter added to its `objects`.

    This draws only the kinds of the objects; their fields are drawn later.

    Args:
        tree: Tree of the whole scenario; not changed.
        seed: Seed of the draws.
        origin: File or name at the start of error messages.
        values: Receives the kinds and, if drawn, the count, by key.

    Raises:
        ScenarioError: If the count is invalid, there are no kinds, or a name is taken.
    """
    tree, clutter = dict(tree), tree.get("clutter")
    if tree.get("objects") is None:  # null in a variant removes the base's objects
        tree["objects"] = {}
    # `load_typed` reports values of another type.
    if not _is_mapping(tree["objects"]):
        return tree
    tree["objects"] = _without_nulls(tree["objects"])
    if not isinstance(clutter, Mapping):
        return tree
    key = "clutter.count"
    drawn = draw_distributions(clutter.get("count", 0), seed, origin, values, key)
    count: int = check_tree(drawn, int, origin, key)
    if not 0 <= count <= _MOST_CLUTTER:
        fail(origin, key, f"must be 0 .. {_MOST_CLUTTER}, got {count}")
    kinds = clutter.get("kinds", {})
    kinds = _without_nulls(kinds) if _is_mapping(kinds) else kinds
    if not (_is_mapping(kinds) and all(map(_is_mapping, kinds.values()))):
        return tree
    if count > 0 and not kinds:
        fail(origin, "clutter.kinds", "needs at least one kind, got none")
    objects = dict(tree["objects"])
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


def _without_nulls(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping without the entries that a variant removes by null."""
    return {key: value for key, value in tree.items() if value is not None}


def _is_mapping(value: Any) -> bool:
    return isinstance(value, Mapping)
