"""The claimed payload, held with the palm down and to the side, and the largest mass.

In `payload_wrap`, the fingers envelop a 68 mm cylinder; in `payload_pinch`, the pads
hold it. The arm lifts the cylinder slowly off its support and holds it for 10 s.

`specimen` repeats this with the gripper that `drake-srg identify` makes from the
vendor's log. At the same command, it pulls its wires less than the data-sheet model.
Does it still hold as much?
"""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RollPitchYaw

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.underactuation import FINGERS
from drake_srg.objects.config import ObjectConfig
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Cylinder, Vector
from experiments.hold_drift import creep, things
from experiments.stands.holding import FULL_FORCE, in_hand, is_free, weld_model

# As wide as the soup can and long enough to lie on the cradle; friction of painted
# metal on rubber, like the can.
RADIUS, LENGTH, FRICTION = 0.034, 0.16, 0.8
# x of the cylinder's middle in the palm frame, by grip and direction [m]. Wrapped: 2 mm
# from the palm. Pinched, palm down: standing along the pads, between their middles (the
# model's frame `grasp_center`). Pinched, to the side: across the pads, where the tips
# stay on their stops. Further in, the wires curl the tips.
_X = {
    ("wrap", "down"): SRG.palm_face_x + 0.002 + RADIUS,
    ("wrap", "side"): SRG.palm_face_x + 0.002 + RADIUS,
    ("pinch", "down"): SRG.grasp_center_x,
    ("pinch", "side"): 0.155,
}
DIRECTIONS = ("down", "side")
_MIDDLE = 0.5  # x of the bench's middle in world [m]
_POST_HEIGHT, _POST_Y = 0.15, 0.02  # inner edges of the cradle, which carry it [m]
_CRADLE_Z = _POST_HEIGHT + np.sqrt(RADIUS**2 - _POST_Y**2)
# The fingers close and the wire force settles (7 time constants of 0.3 s). Then the arm
# lifts the object off its support and holds it. The lift is slow, so that momentum does
# not add to slip [s].
CLOSE, LIFT, HOLD = 3.5, 3.0, 10.0
CLAIMED = ex.at_least(HOLD, source="thesis")
LIFT_HEIGHT = 0.06  # m
# An object counts as held while it moves less than this in the hand [m]. Pinched,
# motion counts from when the load comes on. Wrapped, it counts from the end of the
# lift, because heavy cylinders settle from the base links onto the tips (palm down;
# 5 kg by 12 mm). The tips must then reach around the object: base plus tip angle above
# 90 degrees.
_MOST_MOTION = 0.005
_TIME = "time since the lift began [s]"
_RESOLUTION = 0.02  # relative, of largest masses
BENCH, FAST = "gripper_bench", "gripper_bench_fast"


def payload_scenario(grip: str, direction: str, mass: float, scenario: str) -> Scenario:
    """Return the bench with a cylinder of a mass [kg] in the open hand.

    Wrapped with the palm down, it lies across the hand on the cradle; otherwise it
    stands on the table.
    """
    thing = ObjectConfig(shape=Cylinder(RADIUS, LENGTH), mass=mass, friction=FRICTION)
    x, down = _X[grip, direction], direction == "down"
    lying = down and grip == "wrap"
    # Standing and taken from above, the cylinder has its upper half between the pads.
    height = 0.7 * LENGTH if down else 0.5 * LENGTH
    if lying:
        height = _CRADLE_Z
        thing.pose = Transform()
        thing.pose.translation = np.array([_MIDDLE, 0.0, _CRADLE_Z])
        thing.pose.rotation = Rotation(RollPitchYaw(0.0, np.pi / 2, 0.0))
    bench = bench_scenario(
        thing,
        gripper_rpy=[0.0, 90.0, 0.0] if down else [0.0, 0.0, 0.0],
        home=[0.0, 0.0, height + x] if down else [-x, 0.0, height],
        scenario=scenario,
    )
    if lying:
        weld_model(bench, "cradle", "cradle", [_MIDDLE, 0.0, 0.0])
    return bench


def hold(
    grip: str, direction: str, scenario: str, mass: float, wire_force: float
) -> ex.Measures:
    """Close on the cylinder, lift it off its support and hold it; see `judge_hold`."""
    bench = payload_scenario(grip, direction, mass, scenario)
    limit = bench.gripper.wire_motor.drive.force_limit_of(wire_force)
    with Rig(bench, name="payload") as rig:
        rig.advance(CLOSE, closure=1.0, force_limit=limit)
        home = rig.commanded("arm.position_commanded")
        rig.move(home + np.array([0.0, 0.0, LIFT_HEIGHT]), LIFT)
        free = is_free(rig)
        rig.advance(HOLD)
        log = rig.log()
    angles, force = log["gripper.state_measured"][:, :4], log["gripper.wire_force"]
    found = judge_hold(grip, log["time"], in_hand(log), angles)
    return found | {"wire_force": np.max(force)} | ({} if free else {"held_for": 0.0})


def judge_hold(grip: str, time: Vector, p_GO: Vector, q: Vector) -> ex.Measures:
    """Judge a hold by times (K) [s], places in the hand (K, 3) [m], joints (K, 4).

    Return how long it was `held_for` [s]; its motion while the load comes on, `slip`
    [mm], and during the hold, `creep` [um/s]; and since the lift began, over time.
    """
    time = time - CLOSE
    closed, lifted = (int(np.argmin(np.abs(time - t))) for t in (0.0, LIFT))
    angle = np.min([q[:, base] + q[:, tip] for base, tip in FINGERS], axis=0)
    since = closed if grip == "pinch" else lifted
    lost = np.linalg.norm(p_GO - p_GO[since], axis=1)[lifted:] > _MOST_MOTION
    if grip == "wrap":
        lost |= angle[lifted:] < 0.5 * np.pi
    held_for = time[lifted + np.argmax(lost)] - LIFT if lost.any() else HOLD
    return {
        "held_for": float(held_for),
        "slip": 1e3 * np.linalg.norm(p_GO[lifted] - p_GO[closed]),
        "creep": 1e6 * np.linalg.norm(p_GO[-1] - p_GO[lifted]) / HOLD,
        _TIME: time[closed:],
        "motion in the hand [mm]": 1e3
        * np.linalg.norm(p_GO[closed:] - p_GO[closed], axis=1),
    }


def cases(
    grip: Literal["wrap", "pinch"] = "wrap",
    mass: float = 5.0,
    wire_force: float = 200.0,
) -> list[ex.Case]:
    """Hold a mass in both directions, and find the largest mass held.

    Args:
        grip: How the fingers hold the cylinder.
        mass: Claimed mass, held first [kg].
        wire_force: Force of each wire [N]; the servo gives up to 308.7 N.
    """
    common = {"mass": [mass], "wire_force": [wire_force]}
    return ex.grid(grip=[grip], direction=DIRECTIONS, scenario=(BENCH, FAST), **common)


def trial(
    grip: str, direction: str, scenario: str, mass: float, wire_force: float
) -> ex.Measures:
    return largest(lambda m: hold(grip, direction, scenario, m, wire_force), mass)


def largest(holds: Callable[[float], ex.Measures], mass: float) -> ex.Measures:
    """Hold a mass [kg], then bisect for the largest that is held, `largest`.

    The search gives up when a hundredth of the claimed mass is lost.
    """
    first: ex.Measures = {}
    held, lost, next_mass = 0.0, np.inf, mass
    while lost > max(held * (1.0 + _RESOLUTION), 0.01 * mass):
        result = holds(next_mass)
        first = first or result
        if result["held_for"] >= HOLD:
            held = next_mass
        else:
            lost = next_mass
        # Double or halve until the limit is bracketed, then take geometric means.
        next_mass = 2.0 * held
        if lost < np.inf:
            next_mass = float(np.sqrt(max(held, lost / 4.0) * lost))
    return first | {"largest": held}


def held(mass: float, found: Any) -> ex.Values:
    return {
        f"{mass:g} kg held for [s]": (found["held_for"], CLAIMED),
        "slip while the load comes on [mm]": found["slip"],
        "creep while held [um/s]": found["creep"],
    }


def summary(own: ex.Trials) -> ex.Values:
    bench, fast = (own.where(scenario=scenario)[0] for scenario in (BENCH, FAST))
    mass, largest = bench["mass"], bench["largest"]
    agrees = ex.within(largest, relative=0.05)
    return held(mass, bench) | {
        "wire force [N]": bench["wire_force"],
        "largest mass held [kg]": (largest, ex.at_least(mass, source="thesis")),
        f"largest mass held, {FAST} [kg]": (fast["largest"], agrees),
    }


COMMON: dict[str, Any] = {
    "cases": cases,
    "trial": trial,
    "claims": {"wire force": FULL_FORCE},
    "by": ("grip", "direction"),
    "summary": summary,
    "picture": [
        ex.Curves(_TIME, "motion in the hand [mm]", where={"scenario": BENCH}),
        ex.Bars(["largest mass held", f"largest mass held, {FAST}"]),
    ],
}
payload_wrap = ex.Experiment(
    "5 kg wrapped by the fingers, palm down and to the side, and the largest mass.",
    preset={"grip": "wrap", "mass": 5.0, "wire_force": 200.0},
    **COMMON,
)
payload_pinch = ex.Experiment(
    "2.5 kg between the pads, palm down and to the side, and the largest mass.",
    preset={"grip": "pinch", "mass": 2.5, "wire_force": 125.0},
    **COMMON,
)

MODELS = {"data sheet": "gripper_bench", "specimen": "srg_specimen"}
MASSES = {"wrap": 5.0, "pinch": 2.5}  # kg
EFFORT = 0.8  # share of the servo's range, of SAKE's driver
_CREEP_FORCE = 107.0  # of a held can and box: 0.35 of the data-sheet model's PWM [N]


def specimen_cases() -> list[ex.Case]:
    what = [f"{grip}, {direction}" for grip in MASSES for direction in DIRECTIONS]
    return [
        {"name": f"{model}, {name}".removesuffix(", closing")}
        | {"model": model, "what": name}
        for model in MODELS
        for name in (*what, "closing", *things())
    ]


def specimen_trial(name: str, model: str, what: str) -> ex.Measures:
    scenario = MODELS[model]
    drive = load_scenario(scenario).gripper.wire_motor.drive
    if what in things():
        limit = drive.force_limit_of(_CREEP_FORCE)
        rate = creep(what, scenario, (), limit)
        return {"creep, 107 N per wire [um/s]": rate}
    force = drive.wire_force_of(EFFORT)
    if what == "closing":
        return {
            "wire force at 80 % effort [N]": force,
            "wire force at full effort [N]": drive.full_wire_force,
            "closing time at 80 % effort [s]": closing_time(scenario, EFFORT),
            "closing time at 100 % effort [s]": closing_time(scenario, 1.0),
        }
    grip, direction = what.split(", ")
    return hold(grip, direction, scenario, MASSES[grip], force)


def specimen_summary(own: ex.Trials) -> ex.Values:
    (t,) = own
    return held(MASSES[t["what"].split(",")[0]], t) if "held_for" in t else dict(t)


def closing_time(scenario: str, effort: float) -> float:
    """Return the time in which the empty hand closes [s]; NaN if it does not."""
    bench = bench_scenario(
        gripper_rpy=[0.0, 0.0, 0.0],
        scenario=scenario,
        overrides=["object.present=false"],
    )
    with Rig(bench, name="specimen") as rig:
        rig.advance(0.1)
        rig.advance(3.0, closure=0.65, force_limit=effort)
        log = rig.log()
    q = log["gripper.state_measured"][:, :4].sum(axis=1)
    done = q >= 0.98 * q[-1]
    return float(log["time"][np.argmax(done)]) - 0.1 if q[-1] > 3.0 else np.nan


specimen = ex.Experiment(
    "Payload, closing and creep of an identified gripper and of the data-sheet model.",
    specimen_cases,
    specimen_trial,
    summary=specimen_summary,
    picture=[ex.Bars(["slip while the load comes on"]), ex.Bars(["creep while held"])],
)
