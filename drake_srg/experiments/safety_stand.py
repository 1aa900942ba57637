"""The kitchen's arm with a safety monitor, and random motions for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drake_srg.common.minimum_jerk import minimum_jerk_blend
from drake_srg.safety.limits import JointLimits
from drake_srg.safety.tool import Tool
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector

# Random postures lie this far around home [rad]. Then the peaks of acceleration and
# speed of a minimum-jerk motion of unit length in unit time.
_AROUND, _PEAK_A, _PEAK_V = 0.5, 5.77, 1.88
_MARGIN = 0.05  # of the postures to the joints' limits [rad]
# The force that stops the arm [N]; it feels inertia, too.
_FORCE = 80.0
_LIMITS = f"{{transient: {_FORCE}, quasi_static: {_FORCE}}}"
_OVERRIDES = (
    f"safety={{force: {{profile: {{any: {_LIMITS}}}, regions: [any]}}}}",
    "object.present=false",
    "plant_config.time_step=0.005",
    "ignored_contacts=[['arm::*', '*'], ['gripper::*', '*']]",
)


class Stand:
    """The kitchen's arm with a safety monitor, and its limits."""

    def __init__(self) -> None:
        self.scenario: Scenario = load_scenario(
            "kitchen", seed=0, overrides=list(_OVERRIDES)
        )
        arm, safety = self.scenario.arm, self.scenario.safety
        assert arm is not None
        assert safety is not None
        self.home, self.period = np.array(arm.home), arm.period
        plant = MakeModelsPlant(self.scenario)
        instance = plant.GetModelInstanceByName("arm")
        self.limits = JointLimits.of_plant(plant, instance, safety, arm.period)
        self.speed = plant.GetVelocityUpperLimits()[: len(self.home)]
        self.acceleration = plant.GetAccelerationUpperLimits()[: len(self.home)]
        self.tool = Tool(plant, "arm", safety.tool)

    def motion(
        self, start: Vector, random: np.random.Generator
    ) -> tuple[Callable[[float], Vector], float]:
        """Return a random motion from rest to rest, and its duration [s]."""
        goal = self.home + random.uniform(-_AROUND, _AROUND, len(start))
        lower, upper = self.limits.lower + _MARGIN, self.limits.upper - _MARGIN
        way = np.clip(goal, lower, upper) - start
        share = random.uniform(0.2, 1.0)
        duration = max(
            float(np.max(_PEAK_V * np.abs(way) / (share * self.speed))),
            float(np.max(np.sqrt(_PEAK_A * np.abs(way) / self.acceleration))),
        )
        return lambda t: start + minimum_jerk_blend(t / duration) * way, duration
