"""Scenes of episodes: physics, workspace, and the objects drawn for each."""

from __future__ import annotations

import copy
import dataclasses as dc
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import simple_shape
from drake_srg.scenario import Scenario
from drake_srg.scenario.draws import add_clutter, draw_distributions
from drake_srg.scenario.load import load_tree, override_tree
from drake_srg.scenario.typed_yaml import load_typed, merge
from drake_srg.types import Cylinder, Shape, Vector

# Margin around the region of the objects, and greatest height of the workspace [m].
_MARGIN, _HIGHEST = 0.08, 0.3
# Height of the grasp centre above the table at the start of an episode [m]: 5 cm above
# the tallest object.
START_HEIGHT = 0.17
# Least height of the grasp centre above the table [m]: the open fingers end 20 mm below
# it.
LOWEST = 0.025
_MOST_YAW = 3.0  # rad


@dc.dataclass(frozen=True, eq=False)
class Workspace:
    """Bounds of a hand's motion, and its start.

    Attributes:
        low: Least x, y, z of the grasp centre in world, shape (3,) [m].
        high: Greatest x, y, z, shape (3,) [m].
        start: The hand's pose above the middle of the region, shape (4,) [m, rad].
    """

    low: Vector
    high: Vector
    start: Vector

    @classmethod
    def of(cls, scenario: Scenario, *, goal: bool = False) -> Workspace:
        """Return the workspace of a scenario's hand.

        Args:
            scenario: Scenario with `task.region`.
            goal: Whether the workspace includes `task.place.position`.
        """
        table = scenario.table.height
        region = np.array([scenario.task.region.min, scenario.task.region.max])
        reached = region
        if goal:
            reached = np.array([*region, scenario.task.place.position])
        return cls(
            np.array([*(reached.min(axis=0) - _MARGIN), table + LOWEST]),
            np.array([*(reached.max(axis=0) + _MARGIN), table + _HIGHEST]),
            np.array([*region.mean(axis=0), table + START_HEIGHT, 0.0]),
        )

    def within(self, pose: Vector) -> Vector:
        """Return a pose (4), clipped to the bounds."""
        yaw = np.clip(pose[3], -_MOST_YAW, _MOST_YAW)
        return np.append(np.clip(pose[:3], self.low, self.high), yaw)

    def near(self, margin: float) -> npt.NDArray[np.float64]:
        """Return the least and greatest x, y, z with a margin [m], shape (3, 2)."""
        return np.stack([self.low - margin, self.high + margin], axis=1)


# Time between actions [s] (21.3 Hz). This and all periods below are exact in binary.
CONTROL_PERIOD = 3 / 64

PHYSICS = ("train", "fast", "accurate")

_SAMPLED = ("proximity", "minimum_jerk", "grasp_detector")
_SENSING = {name: {"period": 3 / 128} for name in _SAMPLED}
_FINE_SENSING = {name: {"period": 3 / 256} for name in _SAMPLED}

# Changes to each driver's configuration: periods as in `kitchen_fast`, and half of them
# with the accurate physics.
_DRIVERS: dict[str, dict[str, Any]] = {
    "plant": {"_tag": "!PlantServoDriver", "proximity": None},
    "position": {
        "_tag": "!SrgPositionDriver",
        **_SENSING,
        "servo": {"period": 3 / 256},
        "underactuation": {"period": 3 / 128},
    },
    "tendon": {
        "_tag": "!SrgTendonDriver",
        **_SENSING,
        "servo": {"period": 3 / 512},
        "spool": {"period": 3 / 128},
    },
}
_ACCURATE: dict[str, dict[str, Any]] = {
    "plant": {},
    "position": {
        **_FINE_SENSING,
        "servo": {"period": 3 / 512},
        "underactuation": {"period": 3 / 256},
    },
    "tendon": {
        **_FINE_SENSING,
        "servo": {"period": 3 / 512},
        "spool": {"period": 3 / 256},
    },
}
# The YAML tag of each driver's configuration.
DRIVER_TAGS: dict[str, str] = {name: own["_tag"] for name, own in _DRIVERS.items()}
DRIVERS = tuple(_DRIVERS)

# Steps of the plant per control period, of 23, 3 and 1.5 ms. Steps of 12 ms would cost
# 1.5 times as much as 23 ms; see docs/learning.md for the effect of 23 ms.
_COARSE, _FINE, _FINEST = 2, 16, 32


@dc.dataclass(frozen=True)
class Physics:
    """Physics settings of an environment.

    Attributes:
        name: `train`: Drake's convex integrator in steps of 23 ms without error
            control, and an arm without weight; `fast`: the scenario's own plant, in
            steps that divide the control period; `accurate`: `sap` in steps of 1.5 ms,
            and the hand's fine geometry. The wires of `tendon` need a discrete plant,
            so `train` is then `lagged` in steps of 3 ms.
        driver: Driver of the gripper: `plant`, `position` or `tendon`.
        train_steps: Steps per control period of `train` with a continuous plant. The
            default is 2. Tasks that set an object down need 4: with fewer, it bounces
            and falls over.
    """

    name: str = "train"
    driver: str = "plant"
    train_steps: int = _COARSE

    def __post_init__(self) -> None:
        choose("physics", self.name, PHYSICS)
        choose("driver", self.driver, DRIVERS)

    def scenario_tree(
        self, scenario: str | Path, overrides: Iterable[str] = ()
    ) -> dict[str, Any]:
        """Return the tree of a scenario with this physics, without drawing.

        Args:
            scenario: Name, or path of a YAML file.
            overrides: Entries `KEY=VALUE`, as for `load_scenario`.

        Raises:
            ScenarioError: If the scenario cannot be read, has no arm or gripper, or an
                override changes a key that the physics or the driver sets.
        """
        if isinstance(overrides, str):
            raise ScenarioError(
                f"overrides: must be a list of KEY=VALUE, got {overrides!r}"
            )
        overrides = list(overrides)
        tree = load_tree(scenario, overrides)
        for key in ("arm", "gripper"):
            if not isinstance(tree.get(key), dict):
                raise ScenarioError(f"{scenario}: {key}: an environment needs one")
        own = (tree.get("plant_config") or {}).get("time_step", 0.001)
        changes = self._plant(own)
        step = changes["plant_config"]["time_step"]
        changes["arm"] = {
            "period": step or CONTROL_PERIOD / self.train_steps,
            "command_period": CONTROL_PERIOD,
            "weightless": self.name == "train",
        }
        # Nothing is recorded, but with CENIC, all periods of a scenario must be
        # multiples of 1/1024 s.
        changes["recording"] = {"period": CONTROL_PERIOD, "video_fps": 16}
        if self.name == "accurate":
            hand = "package://drake_srg/sdf/srg.sdf"
            changes["directives"] = {"gripper": {"add_model": {"file": hand}}}
        if step > 0.0:
            tree.pop("simulator_config", None)
        tree = merge(tree, changes, str(scenario))
        tree["gripper"] = self._gripper(tree["gripper"])
        self._check_effect(tree, overrides)
        return tree

    def _check_effect(self, tree: dict[str, Any], overrides: Iterable[str]) -> None:
        """Check that no override changes a key that the physics or the driver sets.

        Raises:
            ScenarioError: If one does.
        """
        for override in overrides:
            other = copy.deepcopy(tree)
            override_tree(other, [override])
            if other != tree:
                key = override.partition("=")[0]
                raise ScenarioError(
                    f"overrides: {key}: cannot be set with physics={self.name} "
                    f"and driver={self.driver}, which set it"
                )

    def _plant(self, own_step: float) -> dict[str, Any]:
        """Return the changes to a scenario's plant and simulator.

        Args:
            own_step: The scenario's own time step [s], 0 for a continuous plant.
        """
        continuous = self.driver != "tendon"
        if self.name == "train" and continuous:
            return {
                "plant_config": {"time_step": 0.0},
                "simulator_config": {
                    "integration_scheme": "cenic",
                    "max_step_size": CONTROL_PERIOD / self.train_steps,
                    "accuracy": 1e-2,
                    "use_error_control": False,
                },
            }
        if self.name == "fast" and own_step == 0.0 and continuous:
            return {"plant_config": {"time_step": 0.0}}
        if self.name == "accurate":
            steps, contact = _FINEST, "sap"
        elif self.name == "train" or own_step == 0.0:
            steps, contact = _FINE, "lagged"
        else:
            steps, contact = max(round(CONTROL_PERIOD / own_step), 1), ""
        plant: dict[str, Any] = {"time_step": CONTROL_PERIOD / steps}
        if contact:
            plant["discrete_contact_approximation"] = contact
        return {"plant_config": plant}

    def _gripper(self, own: dict[str, Any]) -> Any:
        gripper = merge(own, _DRIVERS[self.driver])
        return merge(gripper, _ACCURATE[self.driver] if self.name == "accurate" else {})


def choose(keyword: str, value: Any, allowed: Iterable[str]) -> None:
    """Check the value of an environment's keyword.

    Raises:
        ScenarioError: If it is not allowed.
    """
    if value not in (allowed := tuple(allowed)):
        raise ScenarioError(
            f"{keyword}: unknown {value!r} {suggest(str(value), allowed)}"
        )


_KEYS = {"object", "estimate_error"}


@dc.dataclass(frozen=True)
class Scene:
    """Object of one episode, and the error of its estimated position.

    Attributes:
        object: The object, with a position.
        shape: Its shape.
        estimate_error: Estimated minus true position, x and y [m], shape (2,).
        tree: The scene as plain data, for `options={"scene": ...}`.
    """

    object: ObjectConfig
    shape: Shape
    estimate_error: Vector
    tree: Mapping[str, Any]

    @property
    def position(self) -> Vector:
        """Start of the object, [x, y] in world [m]."""
        return np.array(self.object.position)

    @property
    def is_round(self) -> bool:
        """Whether the object looks the same from all sides."""
        return isinstance(self.shape, Cylinder)


class SceneSource:
    """Draws scenes from a scenario's picked object.

    The object is one of `objects`, or the only one of `clutter`, whose kind is drawn.

    Args:
        tree: Tree of the scenario; see `load_tree`.
        origin: The scenario's name, for error messages.
        noise: Standard deviation of the estimated position, in x and in y [m].

    Raises:
        ScenarioError: If the scenario picks no object, or has more than one.
    """

    def __init__(self, tree: Mapping[str, Any], origin: str, noise: float) -> None:
        if not isinstance(noise, float | int | np.floating) or not 0 <= noise < np.inf:
            raise ScenarioError(f"noise: must be at least 0 m, got {noise!r}")
        self.noise, self._origin = noise, origin
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
        self._kinds = [kind for _, kind in sorted(kinds.items())]
        models = {
            load_typed(
                ObjectConfig, draw_distributions(kind, 0, origin, None, name), origin
            ).model
            or ""
            for name, kind in kinds.items()
        }
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
        tree = draw_distributions(kind, int(rng.integers(2**31)), self._origin)
        config = load_typed(ObjectConfig, tree, self._origin)
        if config.position is None:
            config.position = rng.uniform(*self._region).tolist()
            tree["position"] = config.position
        error = rng.normal(0.0, 1.0, 2) * self.noise
        return self._scene(
            config, error, {"object": tree, "estimate_error": error.tolist()}
        )

    def replay(self, tree: Any) -> Scene:
        """Return a scene from plain data, such as `info["scene"]`.

        Raises:
            ScenarioError: If the data are not a scene.
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
