"""Scenes: the object of one episode, drawn from a scenario's distributions."""

from __future__ import annotations

import copy
import dataclasses as dc
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import simple_shape
from drake_srg.scenario.draws import (
    add_clutter,
    draw_distributions,
    is_distribution,
    key_generator,
    load_distribution,
)
from drake_srg.scenario.yaml_typed import load_typed
from drake_srg.types import Cylinder, Shape, Vector

_KEYS = {"object", "estimate_error"}


@dc.dataclass(frozen=True)
class Scene:
    """What one episode is about.

    Attributes:
        object: The object, with a position.
        shape: Its shape.
        estimate_error: Estimated less true position, x and y [m], shape (2,).
        tree: The scene as plain data, for `options={"scene": ...}`.
    """

    object: ObjectConfig
    shape: Shape
    estimate_error: Vector
    tree: Mapping[str, Any]

    @property
    def position(self) -> Vector:
        """Where the object starts, [x, y] in world [m]."""
        return np.array(self.object.position)

    @property
    def is_round(self) -> bool:
        """Whether the object looks the same from all sides."""
        return isinstance(self.shape, Cylinder)


class SceneSource:
    """Draws scenes from a scenario's picked object.

    The object is one of `objects`, or the only one of `clutter`, whose kind is drawn.

    Args:
        tree: Of the scenario; see `load_tree`.
        origin: The scenario's name, for error messages.
        noise: Standard deviation of the estimated position, in x and in y [m].

    Raises:
        ScenarioError: If the scenario picks no object, or has more than one.
    """

    def __init__(self, tree: Mapping[str, Any], origin: str, noise: float) -> None:
        if not isinstance(noise, float | int | np.floating) or not 0 <= noise < np.inf:
            raise ScenarioError(f"noise: must be at least 0 m, got {noise!r}")
        self.noise = noise
        task = tree.get("task") or {}
        self.name = str(task.get("pick") or "")
        region = task.get("region") or {}
        self._region = [np.array(region.get(k, [0.0, 0.0])) for k in ("min", "max")]
        clutter = tree.get("clutter") or {}
        objects = add_clutter(dict(tree), 0, origin, {})["objects"]
        if [*objects] != [self.name]:
            raise ScenarioError(
                f"{origin}: task.pick: must name the only object of an environment, "
                f"got {self.name!r} of {', '.join(objects) or 'none'}"
            )
        drawn = self.name not in (tree.get("objects") or {})
        kinds = clutter["kinds"] if drawn else objects
        self._kinds = [Kind(kind, origin, name) for name, kind in sorted(kinds.items())]
        models = {kind.model for kind in self._kinds}
        if len(models) > 1:
            raise ScenarioError(
                f"{origin}: clutter.kinds: an environment is built once, so all must "
                "have a shape, or all the same model; got "
                + ", ".join(sorted(model or "a shape" for model in models))
            )
        (self._model,) = models

    def draw(self, rng: np.random.Generator) -> Scene:
        """Draw a scene; all randomness comes from `rng`."""
        kind = self._kinds[int(rng.integers(len(self._kinds)))]
        config, tree = kind.draw(int(rng.integers(2**31)))
        if config.position is None:
            config.position = rng.uniform(*self._region).tolist()
            tree["position"] = config.position
        error = rng.normal(0.0, 1.0, 2) * self.noise
        return self._scene(
            config, error, {"object": tree, "estimate_error": error.tolist()}
        )

    def replay(self, tree: Any) -> Scene:
        """Return a scene from plain data, as `info["scene"]` holds it.

        Raises:
            ScenarioError: If it is no such data.
        """
        if not isinstance(tree, Mapping):
            raise ScenarioError(f"scene: must be a mapping, got {type(tree).__name__}")
        for key in tree:
            if key not in _KEYS:
                raise ScenarioError(f"scene: unknown key {key!r} {suggest(key, _KEYS)}")
        config: ObjectConfig = load_typed(
            ObjectConfig, tree.get("object", {}), "scene: object"
        )
        if config.position is None:
            raise ScenarioError("scene: object.position: must be given")
        if config.shape is None and not config.model:
            raise ScenarioError("scene: object: needs a shape or a model")
        try:
            error = np.array(tree.get("estimate_error", [0.0, 0.0]), dtype=float)
        except (TypeError, ValueError):
            error = np.empty(0)
        if error.shape != (2,) or not np.isfinite(error).all():
            raise ScenarioError("scene: estimate_error: must be two numbers [m]")
        if (config.model or "") != self._model:
            raise ScenarioError(
                f"scene: object.model: must be {self._model or 'empty'}, as the "
                f"environment was built, got {config.model or 'a shape'}"
            )
        for key in ("mass", "friction"):
            if config.shape is not None and getattr(config, key) is None:
                raise ScenarioError(f"scene: object.{key}: must be given with a shape")
        return self._scene(config, error, tree)

    def _scene(
        self, config: ObjectConfig, error: Vector, tree: Mapping[str, Any]
    ) -> Scene:
        shape = simple_shape(self.name, config)
        if shape is None:
            raise ScenarioError(
                f"scene: object.model: {config.model} must be a cylinder, box or sphere"
            )
        return Scene(config, shape, error, tree)


class Kind:
    """An object's entry of a scenario, read once and drawn often.

    Args:
        tree: Of the entry.
        origin: The scenario's name, for error messages.
        name: The kind's.

    Raises:
        ScenarioError: If the entry is invalid.
    """

    def __init__(self, tree: Mapping[str, Any], origin: str, name: str) -> None:
        self._keys: dict[tuple[str, ...], Any] = {}
        for path, node in _leaves(tree):
            drawn = _distributions(node, origin, ".".join((name, *path)))
            if drawn is not node:
                self._keys[path] = drawn
        self._tree = draw_distributions(tree, 0, origin, None, name)
        self._config = load_typed(ObjectConfig, self._tree, origin)

    @property
    def model(self) -> str:
        """Its model; empty for a shape."""
        return str(self._config.model or "")

    def draw(self, seed: int) -> tuple[ObjectConfig, dict[str, Any]]:
        """Return the object of a seed, and its tree."""
        config, tree = copy.deepcopy(self._config), copy.deepcopy(dict(self._tree))
        for path, drawn in self._keys.items():
            value = _sample(drawn, seed, ".".join(path))
            thing, node = config, tree
            for key in path[:-1]:
                thing, node = getattr(thing, key), node[key]
            setattr(thing, path[-1], value)
            node[path[-1]] = value
        return config, tree


def _leaves(
    tree: Mapping[str, Any], path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield what is not a plain mapping, with its path."""
    for key, value in tree.items():
        if isinstance(value, Mapping) and not is_distribution(value):
            yield from _leaves(value, (*path, key))
        else:
            yield (*path, key), value


def _distributions(node: Any, origin: str, key: str) -> Any:
    """Return a leaf with Drake's distributions in place of their trees."""
    if is_distribution(node):
        return load_distribution(node, origin, key)
    if isinstance(node, list):
        found = [
            _distributions(item, origin, f"{key}[{i}]") for i, item in enumerate(node)
        ]
        return (
            found if any(a is not b for a, b in zip(found, node, strict=True)) else node
        )
    return node


def _sample(drawn: Any, seed: int, key: str) -> Any:
    """Return a leaf with a sample in place of each distribution."""
    if isinstance(drawn, list):
        return [_sample(item, seed, f"{key}[{i}]") for i, item in enumerate(drawn)]
    if not hasattr(drawn, "Sample"):
        return drawn
    return np.asarray(drawn.Sample(key_generator(seed, key))).tolist()
