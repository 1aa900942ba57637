"""Scenes: the object of one episode, drawn from a scenario's distributions."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import simple_shape
from drake_srg.scenario.draws import add_clutter, draw_distributions
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
        if not (np.isfinite(noise) and noise >= 0.0):
            raise ScenarioError(f"noise: must be at least 0 m, got {noise!r}")
        self.noise = noise
        self._origin = origin
        self.name = str((tree.get("task") or {}).get("pick") or "")
        self._tree = {key: tree.get(key) for key in ("objects", "clutter")}
        region = tree["task"].get("region") or {}
        self._region = [np.array(region.get(k, [0.0, 0.0])) for k in ("min", "max")]
        objects = self._objects(0)
        if [*objects] != [self.name]:
            raise ScenarioError(
                f"{origin}: task.pick: must name the only object of an environment, "
                f"got {self.name!r} of {', '.join(objects) or 'none'}"
            )

    def _objects(self, seed: int) -> Mapping[str, Any]:
        objects: Mapping[str, Any] = add_clutter(self._tree, seed, self._origin, {})[
            "objects"
        ]
        return objects

    def draw(self, rng: np.random.Generator) -> Scene:
        """Draw a scene; all randomness comes from `rng`."""
        seed = int(rng.integers(2**31))
        entry = self._objects(seed)[self.name]
        key = f"objects.{self.name}"
        tree = dict(draw_distributions(entry, seed, self._origin, None, key))
        if tree.get("position") is None:
            tree["position"] = rng.uniform(*self._region).tolist()
        error = rng.normal(0.0, 1.0, 2) * self.noise
        return self.replay({"object": tree, "estimate_error": error.tolist()})

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
        shape = simple_shape(self.name, config)
        if shape is None:
            raise ScenarioError(
                f"scene: object.model: {config.model} must be a cylinder, box or sphere"
            )
        error = np.array(tree.get("estimate_error", [0.0, 0.0]), dtype=float)
        if error.shape != (2,) or not np.isfinite(error).all():
            raise ScenarioError("scene: estimate_error: must be two numbers [m]")
        return Scene(config, shape, error, tree)
