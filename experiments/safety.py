"""Times and distances in which the safety monitor stops the kitchen's arm after faults.

The arm moves between random postures, at random shares of its speed limits, until a
fault occurs in the middle of a motion. There are no obstacles, because only the stop is
measured.

After a robot has lost its commands, the commands must come to rest within 0.2 s. This
is the time to notice, 0.05 s for a watchdog, and the time to brake from top speed, 0.10
s for the slowest joint. The arm itself rests later, when its joints have settled.
"""

import functools
from collections.abc import Callable

import numpy as np

import experiments.runner as ex
from drake_srg import Rig, load_scenario
from drake_srg.arm.driver import ArmPositionDriver
from drake_srg.arm.safety.limits import JointLimits, Tool
from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.common.safety_states import SafetyState, StopReason, safety_state
from drake_srg.common.systems import model_actuators
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Vector
from experiments.stands.holding import push

# Faults and the reason that the monitor must name.
FAULTS = {
    "emergency stop": StopReason.EMERGENCY_STOP,
    "lost command": StopReason.NOT_FINITE,
    "jump": StopReason.SPEED,
    "kick": StopReason.ACCELERATION,
    "frozen commands": StopReason.ACCELERATION,
    "lost heartbeat": StopReason.STALE,
    "push": StopReason.FORCE,
}
_RESTING = 0.01  # a joint that is slower counts as resting [rad/s]
_AFTER = 0.5  # watched after a fault [s]
_PUSH = 150.0  # N
_ARM = ("position_allowed", "state_measured", "torque_measured")
_LOGGED = (*(f"arm.{name}" for name in _ARM), "safety.state")
# A motor with this share of its effort limit can give no more.
_SATURATED = 0.99
# Random postures lie this far around home [rad]. Then the peaks of acceleration and
# speed of a minimum-jerk motion of unit length in unit time.
_AROUND, _PEAK_A, _PEAK_V = 0.5, 5.77, 1.88
_LONGEST = 1.0  # that an arm settles [s]
_MARGIN = 0.05  # of the postures to the joints' limits [rad]
# The force that stops the arm [N]; it feels inertia, too.
_LIMITS = "{transient: 80.0, quasi_static: 80.0}"
_OVERRIDES = (
    f"safety={{force: {{profile: {{any: {_LIMITS}}}, regions: [any]}}}}",
    "object.present=false",
    "plant_config.time_step=0.005",
    "ignored_contacts=[['arm::*', '*'], ['gripper::*', '*']]",
)


class Stand:
    """The kitchen's arm with a safety monitor, and its limits."""

    def __init__(self) -> None:
        self.scenario = load_scenario("kitchen", seed=0, overrides=list(_OVERRIDES))
        arm, safety = self.scenario.arm, self.scenario.safety
        assert isinstance(arm, ArmPositionDriver)
        assert safety is not None
        self.home, self.period = np.array(arm.home), arm.period
        plant = self._plant = MakeModelsPlant(self.scenario)
        instance = self._arm = plant.GetModelInstanceByName("arm")
        self.limits = JointLimits.of_plant(plant, instance, safety, arm.period)
        self.speed = plant.GetVelocityUpperLimits()[: len(self.home)]
        self._acceleration = plant.GetAccelerationUpperLimits()[: len(self.home)]
        motors = model_actuators(plant, instance)
        self.efforts = np.array([motor.effort_limit() for motor in motors])
        self.tool = Tool(plant, "arm", safety.tool)
        self._kp, self._kd = map(np.diag, arm.gains(plant, instance))

    def settling_time(self, q: Vector) -> float:
        """Return the time after which an arm that stops at `q` (N,) [rad] is slow [s].

        Joints with mass matrix M and gains Kp, Kd that have followed commands of
        deceleration a lag by e = Kp⁻¹ M a when these come to rest. From then on,

            M e'' + Kd e' + Kp e = 0,

        which is linear in a: e'(t) = H(t) a. So no joint is faster than the product of
        the absolute values of H(t) and a, whatever the signs. The plant takes its steps
        implicitly, which damps: so does this.
        """
        plant, n, step = self._plant, len(q), self.scenario.plant_config.time_step
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, self._arm, q)
        mass = plant.CalcMassMatrix(context)[:n, :n]
        eye, none = np.eye(n), np.zeros((n, n))
        stiffness, damping = (np.linalg.solve(mass, k) for k in (self._kp, self._kd))
        rate = np.block([[none, eye], [-stiffness, -damping]])
        advance = np.linalg.inv(np.eye(2 * n) - step * rate)
        # Columns: e and e' for a deceleration of 1 of each joint.
        state = np.vstack([np.linalg.solve(self._kp, mass), none])
        deceleration, last = np.abs(self.limits.brake / self.period**2), 0.0
        for k in range(1, round(_LONGEST / step)):
            state = advance @ state
            if np.any(np.abs(state[n:]) @ deceleration > _RESTING):
                last = k * step
        return last

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
            float(np.max(np.sqrt(_PEAK_A * np.abs(way) / self._acceleration))),
        )
        return lambda t: start + minimum_jerk_blend(t / duration) * way, duration


make_stand = functools.cache(Stand)


def cases(trials: int = 200) -> list[ex.Case]:
    """Stop the arm after each of the faults in turn."""
    kinds, n = list(FAULTS), len(FAULTS)
    return [{"fault": kinds[i % n], "number": i // n} for i in range(trials)]


def trial(fault: str, number: int) -> ex.Measures:
    stand = make_stand()
    random = np.random.default_rng([number, list(FAULTS).index(fault)])
    q, duration = stand.motion(stand.home, random)
    period = stand.period
    when = round(random.uniform(0.3, 0.7) * duration / period)
    command = _with_fault(stand, fault, q, when * period, random)
    half, rows = 0.5 * period, []
    # Without contact, a long step is accurate, and a short log saves most of the time.
    with Rig(stand.scenario, name="safety", period=half, log_period=1e3 * half) as rig:
        for i in range(when + round(_AFTER / period)):
            if fault == "emergency stop" and i == when:
                rig.fix("safety.estop", 1.0)
            if fault == "lost heartbeat" and i < when:
                rig.fix("safety.heartbeat", rig.time)
            if fault == "push" and i == when:
                direction = random.normal(size=3)
                push(rig, "palm", _PUSH * direction / np.linalg.norm(direction))
            rig.advance(half, arm=command(i * period))
            # Half a period after an update, the ports show what it has decided.
            rows.append({name: rig.measured(name) for name in _LOGGED})
            rig.advance(half)
    log = {name: np.array([row[name] for row in rows]) for name in _LOGGED}
    streams = fault in ("emergency stop", "lost heartbeat", "push")
    last = duration if streams else (when - 1) * period
    path = [q(t) for t in np.arange(0.0, last + 0.5 * period, period)]
    return _measure(stand, log, when, path)


def _with_fault(
    stand: Stand,
    fault: str,
    q: Callable[[float], Vector],
    since: float,
    random: np.random.Generator,
) -> Callable[[float], Vector]:
    direction = random.choice([-1.0, 1.0], len(stand.home))
    jump = random.uniform(2.0, 20.0) * stand.limits.step * direction
    kick = random.uniform(2.0, 4.0) * stand.limits.bend * direction

    def command(t: float) -> Vector:
        if t < since - 1e-9:
            return q(t)
        if fault == "lost command":
            return np.full(len(stand.home), np.nan)
        if fault == "frozen commands":
            return q(since - stand.period)
        return q(t) + {"jump": jump, "kick": kick}.get(fault, 0.0)

    return command


def _measure(
    stand: Stand, log: dict[str, Vector], fault: int, path: list[Vector]
) -> ex.Measures:
    """Return the measures of a stop.

    `bound` is when the arm rests by theory: when the commands rest, the driver's
    period, the time in which the joints settle, and the time until the next reading.
    A motor at its limit may take longer, because the theory knows no limits.
    """
    allowed, state = log["arm.position_allowed"], log["arm.state_measured"]
    states = [safety_state(row) for row in log["safety.state"]]
    period, n = stand.period, len(stand.home)
    braking = [i for i, (s, _) in enumerate(states) if s is not SafetyState.RUNNING]
    steps = np.diff(allowed, axis=0)
    speed = np.max(np.abs(state[:, n:]), axis=1)

    def rest(moving: Vector) -> float:
        return max(float(np.flatnonzero(moving)[-1] + 1 - fault) * period, 0.0)

    tool = stand.tool.position
    way, line = (np.array([tool(q) for q in of]) for of in (state[fault:, :n], path))
    commanded = rest(np.any(steps != 0.0, axis=1))
    tail = stand.settling_time(allowed[-1])
    effort = np.abs(log["arm.torque_measured"][fault:]) / stand.efforts
    return {
        "reason": states[-1][1].value,
        "speed [share of the limits]": np.max(np.abs(state[fault, n:]) / stand.speed),
        "reaction": np.inf if not braking else (braking[0] - fault) * period,
        "commanded": commanded,
        "stop [s]": rest(speed > _RESTING),
        "bound": commanded + 2.0 * period + tail,
        "saturated": np.max(effort) >= _SATURATED,
        "way [m]": np.sum(np.linalg.norm(np.diff(way, axis=0), axis=1)),
        "off path": max(_distance(tool(q), line) for q in allowed[fault:]),
        "speed / limit": np.max(np.abs(steps) / stand.limits.step),
        "brake / limit": np.max(np.abs(np.diff(steps, axis=0)) / stand.limits.brake),
        "drift": np.max(np.ptp(allowed[-20:], axis=0)),
    }


def _distance(p: Vector, line: Vector) -> float:
    """Return how far a point is from a line through points, shape (K, 3) [m]."""
    a, d = line[:-1], np.diff(line, axis=0)
    length = np.maximum(np.sum(d * d, axis=1), 1e-30)
    u = np.clip(np.sum(d * (p - a), axis=1) / length, 0.0, 1.0)
    return float(np.min(np.linalg.norm(a + u[:, None] * d - p, axis=1)))


def summary(own: ex.Trials) -> ex.Values:
    share, full = own["stop [s]"] / own["bound"], own["saturated"]
    return {
        "reaction, longest [s]": max(own["reaction"]),
        "commands at rest, latest [s]": max(own["commanded"]),
        "arm at rest / its bound []": np.max(share[~full], initial=0.0),
        "the same, motor at its limit []": np.max(share[full], initial=0.0),
        "arm at rest, latest [s]": max(own["stop [s]"]),
        "way of the tool, longest [m]": max(own["way [m]"]),
        "tool off its path, farthest [m]": max(own["off path"]),
    }


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    return {
        f"{len(trials)} faults": {
            "stopped otherwise, or not []": sum(
                t["reason"] != FAULTS[t["fault"]].value or not t["reaction"] >= 0.0
                for t in trials
            ),
            "speed / limit []": max(trials["speed / limit"]),
            "deceleration / limit []": max(trials["brake / limit"]),
            "motion once stopped [rad]": max(trials["drift"]),
        }
    }


safety = ex.Experiment(
    "Times and distances in which a safety monitor stops the kitchen's arm.",
    cases,
    trial,
    {
        "stopped otherwise, or not": ex.at_most(0),
        "speed / limit": ex.at_most(1.0),
        "deceleration / limit": ex.at_most(1.001),
        "motion once stopped": ex.at_most(0.0),
        "reaction, longest": lambda own: (
            ex.number()
            if own.name in ("lost heartbeat", "push")
            else ex.at_most(make_stand().period)
        ),
        "commands at rest, latest": ex.at_most(0.2),
        "arm at rest / its bound": ex.at_most(1.0 + 1e-9),  # for rounding
    },
    summary=summary,
    whole=whole,
    picture=[
        ex.Points("speed [share of the limits]", "stop [s]", limit=0.2),
        ex.Points("speed [share of the limits]", "way [m]"),
    ],
)
