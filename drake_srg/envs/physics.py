"""The scenario of an environment: its physics and driver, timed for the control."""

from __future__ import annotations

import copy
import dataclasses as dc
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.scenario.load import load_tree, override_tree
from drake_srg.scenario.yaml_tree import merge

# Time between actions [s]: 21.3 Hz, exact in binary, as are all periods below.
CONTROL_PERIOD = 3 / 64

PHYSICS = ("train", "fast", "accurate")

_SAMPLED = ("proximity", "minimum_jerk", "grasp_detector")
_SENSING = {name: {"period": 3 / 128} for name in _SAMPLED}
_FINE_SENSING = {name: {"period": 3 / 256} for name in _SAMPLED}

# What each driver's configuration becomes, sampled as in `kitchen_fast`; on the
# accurate physics, twice as often.
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

# Steps of the plant per control period: 23, 3 and 1.5 ms. Coarse steps of 12 ms cost
# half as much again; see docs/learning.md for what 23 ms change.
_COARSE, _FINE, _FINEST = 2, 16, 32


@dc.dataclass(frozen=True)
class Physics:
    """How an environment simulates.

    Attributes:
        name: `train`: Drake's convex integrator in steps of 23 ms without error
            control, and an arm without weight; `fast`: the scenario's own plant, in
            steps that divide the control period; `accurate`: `sap` in steps of 1.5 ms,
            and the hand's fine geometry. The wires of `tendon` need a discrete plant:
            there, `train` is `lagged` in steps of 3 ms.
        driver: Of the gripper: `plant`, `position` or `tendon`.
        train_steps: Steps per control period of `train` with a continuous plant: 2; an
            object that is set down needs 4, or it bounces and falls over.
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
            ScenarioError: If the scenario cannot be read, has no arm or gripper, or
                an override changes what the physics or the driver decides.
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
        # What CENIC asks for; nothing is recorded.
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
        """Check that no override is one of what the physics or the driver decides.

        Raises:
            ScenarioError: If one is.
        """
        for override in overrides:
            other = copy.deepcopy(tree)
            override_tree(other, [override])
            if other != tree:
                key = override.partition("=")[0]
                raise ScenarioError(
                    f"overrides: {key}: is not yours to set with physics={self.name} "
                    f"and driver={self.driver}"
                )

    def _plant(self, own_step: float) -> dict[str, Any]:
        """Return what becomes of a scenario's plant and simulator.

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
        ScenarioError: If it is not among those allowed.
    """
    if value not in (allowed := tuple(allowed)):
        raise ScenarioError(
            f"{keyword}: unknown {value!r} {suggest(str(value), allowed)}"
        )
