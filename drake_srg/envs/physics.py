"""The scenario of an environment: its physics and driver, timed for the control."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.scenario.load import load_tree
from drake_srg.scenario.yaml_tree import merge, set_key

# Time between actions [s]: 21.3 Hz, exact in binary, as are all periods below.
CONTROL_PERIOD = 3 / 64

PHYSICS = ("train", "fast", "accurate")

_SENSING = {
    name: {"period": 3 / 128} for name in ("proximity", "minimum_jerk", "grasp_detector")
}
_FINE_SENSING = {name: {"period": 3 / 256} for name in _SENSING}

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
DRIVERS = tuple(_DRIVERS)

# Steps of the plant per control period. `train`: 12 ms; `accurate`: 1.5 ms.
_TRAIN_STEPS, _ACCURATE_STEPS = 4, 32


@dc.dataclass(frozen=True)
class Physics:
    """How an environment simulates.

    Attributes:
        name: `train`: steps of 12 ms, an arm without weight, as coarse as still lifts;
            `fast`: the scenario's own plant, with steps that divide the control
            period; `accurate`: steps of 1.5 ms and the hand's fine geometry.
        driver: Of the gripper: `plant`, `position` or `tendon`.
    """

    name: str = "train"
    driver: str = "plant"

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
            ScenarioError: If the scenario cannot be read, has no arm or gripper, or its
                physics and the driver do not go together.
        """
        tree = load_tree(scenario, overrides)
        for key in ("arm", "gripper"):
            if not isinstance(tree.get(key), dict):
                raise ScenarioError(f"{scenario}: {key}: an environment needs one")
        plant = tree.get("plant_config") or {}
        own_step = plant.get("time_step", 0.001)
        if self.name == "fast" and own_step == 0.0:
            step = tree["simulator_config"]["max_step_size"]
            changes: dict[str, Any] = {}
        else:
            steps = {"train": _TRAIN_STEPS, "accurate": _ACCURATE_STEPS}.get(
                self.name, max(round(CONTROL_PERIOD / (own_step or 1.0)), 1)
            )
            step = CONTROL_PERIOD / steps
            changes = {
                "plant_config": {
                    "time_step": step,
                    "discrete_contact_approximation": "sap",
                },
                "simulator_config": None,
            }
        changes["arm"] = {
            "period": step,
            "command_period": CONTROL_PERIOD,
            "weightless": self.name == "train",
        }
        tree = merge(tree, changes, str(scenario))
        if changes.get("simulator_config", 0) is None:
            tree.pop("simulator_config", None)
        tree["gripper"] = self._gripper(tree["gripper"])
        if self.name == "accurate":
            set_key(
                tree,
                "directives.gripper.add_model.file",
                "package://drake_srg/sdf/srg.sdf",
            )
        return tree

    def _gripper(self, own: dict[str, Any]) -> Any:
        gripper = merge(own, _DRIVERS[self.driver])
        return merge(gripper, _ACCURATE[self.driver] if self.name == "accurate" else {})


def choose(keyword: str, value: Any, allowed: Iterable[str]) -> None:
    """Check the value of an environment's keyword.

    Raises:
        ScenarioError: If it is not among those allowed.
    """
    if value not in (allowed := tuple(allowed)):
        problem = suggest(value, allowed) if isinstance(value, str) else (
            f"(allowed: {', '.join(allowed)})"
        )
        raise ScenarioError(f"{keyword}: unknown {value!r} {problem}")
