"""The kitchen's arm with a safety monitor, and random motions for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.arm.drivers import ArmPositionDriver
from drake_srg.arm.safety.limits import JointLimits, Tool
from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.common.systems import model_actuators
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector

# Random postures lie this far around home [rad]. Then the peaks of acceleration and
# speed of a minimum-jerk motion of unit length in unit time.
_AROUND, _PEAK_A, _PEAK_V = 0.5, 5.77, 1.88
_LONGEST = 1.0  # that an arm settles [s]
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


class Settling:
    """How long a position-controlled arm moves on after its commands have come to rest.

    Joints with mass matrix M and gains Kp, Kd that have followed commands of
    deceleration a lag by e = Kp⁻¹ M a when these come to rest. From then on,

        M e'' + Kd e' + Kp e = 0,

    which is linear in a: e'(t) = H(t) a. So no joint is faster than the product of the
    absolute values of H(t) and a, whatever the signs. The plant takes its steps
    implicitly, which damps: so does this.

    Args:
        plant: With the arm; a scratch context of it is made here.
        arm: The driver.
        step: Of the plant [s].
    """

    def __init__(
        self, plant: MultibodyPlant, arm: ArmPositionDriver, step: float
    ) -> None:
        self._plant, self._context = plant, plant.CreateDefaultContext()
        self._arm = plant.GetModelInstanceByName("arm")
        self._kp, self._kd, self._step = np.diag(arm.kp), np.diag(arm.kd), step

    def time(self, q: Vector, deceleration: Vector, slow: float) -> float:
        """Return when the last joint has become slow [s].

        Args:
            q: Where the commands rest, shape (N,) [rad].
            deceleration: Of the commands before, shape (N,) [rad/s²].
            slow: Largest speed [rad/s].
        """
        plant, n = self._plant, len(q)
        plant.SetPositions(self._context, self._arm, q)
        mass = plant.CalcMassMatrix(self._context)[:n, :n]
        eye, none = np.eye(n), np.zeros((n, n))
        stiffness, damping = (np.linalg.solve(mass, k) for k in (self._kp, self._kd))
        rate = np.block([[none, eye], [-stiffness, -damping]])
        advance = np.linalg.inv(np.eye(2 * n) - self._step * rate)
        # Columns: e and e' for a deceleration of 1 of each joint.
        state = np.vstack([np.linalg.solve(self._kp, mass), none])
        last = 0.0
        for k in range(1, round(_LONGEST / self._step)):
            state = advance @ state
            if np.any(np.abs(state[n:]) @ np.abs(deceleration) > slow):
                last = k * self._step
        return last


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
        motors = model_actuators(plant, instance)
        self.efforts = np.array([motor.effort_limit() for motor in motors])
        self.tool = Tool(plant, "arm", safety.tool)
        assert isinstance(arm, ArmPositionDriver)
        step = self.scenario.plant_config.time_step
        self._settling = Settling(plant, arm, step)

    def settling_time(self, q: Vector, slow: float) -> float:
        """Return when an arm that rests at `q` (N,) [rad] is slow after a stop [s]."""
        deceleration = self.limits.brake / self.period**2
        return self._settling.time(q, deceleration, slow)

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
