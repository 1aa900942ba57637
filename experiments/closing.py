"""A hand that closes around a can: the order of events, and how gently it does so.

A can stands 4 mm from the palm. The hand points to the front and closes. With wires,
contact stops the base and the tip follows. Algorithm 1 switches from base to tip when a
proximity or touch sensor fires. It then drives the base to its last target: the full
closure after a step command, or hardly beyond the sensor's angle after the ramp of the
thesis's client. A base that freezes stops by itself.

The thesis promises that no force moves the object until the tip closes. If the base
stops before it touches the object, this must hold.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.sensors import ProximityConfig, TouchConfig
from drake_srg.gripper.underactuation import FINGERS
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Vector
from experiments.data import household_objects

START = 0.1  # of closing, when the hand has come to rest [s]
DURATION = 2.9  # of closing [s]
LOG_PERIOD = 0.002  # s
TOUCHED = TouchConfig().trigger_force  # at which thin-film sensors respond [N]
NEAR = ProximityConfig().trigger_distance  # at which proximity sensors fire [m]
# Height of the palm's middle above the table; the palm points to the front [m].
_HEIGHT = 0.06
# Middle of the can, whose radius is 34 mm, in the palm frame: 4 mm from the palm's face
# at 72 mm. Another 2 mm closer, the base sensors of the open hand fire at once [m].
_X = SRG.palm_face_x + 0.004 + 0.034


def can_in_hand(driver: str) -> Scenario:
    """Return the bench with the open hand of a driver around the can on the table."""
    can = household_objects()["005_tomato_soup_can"]
    can.resolution = 0.005  # as in gripper_bench; the base links' force depends on it
    return bench_scenario(
        can,
        gripper_rpy=[0.0, 0.0, 0.0],
        home=[-_X, 0.0, _HEIGHT],
        overrides=[f"gripper={driver}"],
    )


def first(time: Vector, condition: npt.NDArray[np.bool_]) -> float:
    """Return when a condition (K,) first holds [s]; NaN if it never does."""
    return float(time[np.argmax(condition)]) if condition.any() else np.nan


def shift_of(log: Mapping[str, Vector]) -> Vector:
    """Return the distance that the can has moved, shape (K,) [mm]."""
    p_WO = log["object_pose.thing"][:, :3]
    return 1e3 * np.linalg.norm(p_WO - p_WO[0], axis=1)


def series(log: Mapping[str, Vector]) -> dict[str, Any]:
    """Return time since the command, and means of both fingers, every 10 ms."""
    touch, proximity = log["gripper.contact_force"][::5], log["gripper.proximity"][::5]
    return {
        "time [s]": log["time"][::5] - START,
        "base touch [N]": touch[:, :2].mean(axis=1),
        "tip touch [N]": touch[:, 2:].mean(axis=1),
        "base proximity [m]": proximity[:, :2].mean(axis=1),
        "tip proximity [m]": proximity[:, 2:].mean(axis=1),
        "shift of the can [mm]": shift_of(log)[::5],
    }


def panels(title: str = "", **where: str) -> list[ex.Curves]:
    """Return the panels of touch, proximity and the can's shift, of some trials."""
    measures: tuple[str | Sequence[str], ...] = (
        ("base touch [N]", "tip touch [N]"),
        ("base proximity [m]", "tip proximity [m]"),
        "shift of the can [mm]",
    )
    return [ex.Curves("time [s]", y, where=where, title=title) for y in measures]


DRIVERS = {
    "wires": "!SrgTendonDriver {}",
    "Algorithm 1, proximity": "!SrgPositionDriver {trigger: proximity}",
    "Algorithm 1, touch": "!SrgPositionDriver {trigger: touch}",
}
_COUNT = 2.0 * np.pi / 4096.0  # of a 12-bit encoder: less is no motion [rad]
# From a hinge to the point where its link presses: middle of base link, of pad [m].
_BASE_LEVER, _TIP_LEVER = 0.5 * SRG.base_length, round(SRG.pad_middle, 3)


def sequence_trial(driver: str) -> ex.Measures:
    scenario = can_in_hand(DRIVERS[driver])
    with Rig(scenario, name="closing_sequence", log_period=LOG_PERIOD) as rig:
        rig.advance(START)
        rig.advance(DURATION, closure=1.0)
        log = rig.log()
    time, angle = log["time"] - START, log["gripper.state_measured"][:, :4]
    touch, proximity = log["gripper.contact_force"], log["gripper.proximity"]
    left, right = (list(finger) for finger in FINGERS)
    motor, wires = scenario.gripper.wire_motor, None
    if motor is not None:
        force = log["gripper.wire_force"]
        limit = scenario.gripper.servo.force_limit * motor.drive.full_wire_force
        wires = (np.max(force), np.mean(force[-1]), limit)
    return series(log) | {
        "base touch force at the end [N]": np.mean(touch[-1, :2]),
        "tip touch force at the end [N]": np.mean(touch[-1, 2:]),
        # By finger.
        "near": [first(time, proximity[:, b] <= NEAR) for b, _ in FINGERS],
        "base": [first(time, touch[:, b] >= TOUCHED) for b, _ in FINGERS],
        "start": [first(time, angle[:, t] > _COUNT) for _, t in FINGERS],
        "tip": [first(time, touch[:, t] >= TOUCHED) for _, t in FINGERS],
        "smallest touch force at the end [N]": min(touch[-1]),
        "largest difference of left and right joints [degrees]": np.rad2deg(
            np.max(np.abs(angle[:, left] - angle[:, right]))
        ),
        "motion of the can [mm]": shift_of(log)[-1],
        "angle": angle[-1],
        "proximity": proximity[-1],
        "wires": wires,
    }


def order_and_agreement(trials: ex.Trials) -> dict[str, ex.Values]:
    """Judge the order of events at both fingers, and the posture in the end.

    The can stops every link, whatever drives it. Only the depth differs to which links
    press into can or rubber, which the proximity sensors measure.
    """
    found: dict[str, Any] = {}
    bases, tips = np.array(FINGERS).T
    by_wires = trials.where(driver="wires")[0]
    for t in trials:
        driver = t["driver"]
        for i, side in enumerate(("left", "right")):
            # With proximity, Algorithm 1 switches before the base touches the can.
            near, base = "proximity" in driver, t["base"][i]
            what, cue = ("is near", t["near"][i]) if near else ("touches", base)
            start = f"tip starts after the base {what} [s]"
            found[f"{driver}, {side}"] = {
                "base touches at [s]": base,
                start: (t["start"][i], ex.at_least(cue)),
                "tip touches after the base [s]": (t["tip"][i], ex.at_least(base)),
            }
        if t["wires"] is not None:
            most, end, limit = t["wires"]
            found[driver] = {
                "largest wire force [N]": (most, ex.at_most(limit)),
                "wire force at the end [N]": (end, ex.within(limit, relative=0.05)),
            }
            continue
        off = np.rad2deg(np.abs(t["angle"] - by_wires["angle"]))
        depth = -np.minimum(np.minimum(t["proximity"], by_wires["proximity"]), 0.0)
        base = np.rad2deg(np.max(depth[bases]) / _BASE_LEVER)
        # The tip's angle is relative to the base link, so the base's error adds to it.
        tip = base + np.rad2deg(np.max(depth[tips]) / _TIP_LEVER)
        what = "{} at the end, difference from wires [degrees]"
        found[driver] = {
            what.format("base"): (np.max(off[bases]), ex.at_most(base)),
            what.format("tip"): (np.max(off[tips]), ex.at_most(tip)),
        }
    return found


closing_sequence = ex.Experiment(
    "A hand closing around a can: touch, proximity and shift of the can.",
    lambda: ex.grid(driver=DRIVERS),
    sequence_trial,
    {
        "smallest touch force at the end": ex.at_least(TOUCHED, source="data sheet"),
        # The fingers are identical, but the meshes of pads and can are not mirrored.
        "largest difference of left and right joints": ex.at_most(0.5),
    },
    whole=order_and_agreement,
    picture=panels(),
)

# The client's ramp: message i of 0 to 1000 says floor(i / 10) percent.
_RATE, _LAST = 25.0, 1000  # messages/s
STEP, APPROACH = "step", "freeze, approach"
# The driver's underactuation, and at which distance its sensors fire [m].
WAYS = {
    STEP: ("{base: algorithm_1}", 0.003),
    "ramp": ("{base: algorithm_1}", 0.003),
    "freeze": ("{base: freeze}", 0.003),
    "freeze at 2 mm": ("{base: freeze}", 0.002),
    APPROACH: ("{base: freeze, approach_speed: 1.0}", 0.003),
}
IMPACT, STEADY = "base force before the tip touches", "base force at the end"
SHIFT, SLOWEST = "largest shift of the can", "both tips touch after"


def ramp(t: float) -> float:
    """Return the command of the client's ramp at a time [s]: 0 open .. 1 closed."""
    # A message belongs to the sample at its time, whatever way that is rounded.
    return min(int(t * _RATE + 1e-9), _LAST) // 10 / 100.0


def gentle_trial(way: str) -> ex.Measures:
    underactuation, trigger = WAYS[way]
    scenario = can_in_hand(
        f"!SrgPositionDriver {{underactuation: {underactuation}, "
        f"proximity: {{trigger_distance: {trigger}}}}}"
    )
    slowly = way == "ramp"
    closure: Callable[[float], float] = ramp if slowly else lambda t: 1.0
    with Rig(scenario, name="closing_gently", log_period=LOG_PERIOD) as rig:
        rig.advance(START)
        rig.advance(_LAST / _RATE + 1.0 if slowly else DURATION, closure=closure)
        log = rig.log()
        closed = rig.X_GO().translation()
        home = rig.commanded("arm.position_commanded")
        rig.move(home + np.array([0.0, 0.0, 0.1]), 1.0)
        rig.advance(1.0)
        lifted = rig.X_GO().translation()
    touch, proximity = log["gripper.contact_force"], log["gripper.proximity"]
    before = np.cumsum(np.max(touch[:, 2:], axis=1) >= TOUCHED) == 0  # a tip touches
    both, shift = np.min(touch[:, 2:], axis=1) >= TOUCHED, shift_of(log)
    slip = 1e3 * np.linalg.norm(lifted - closed)
    return series(log) | {
        "command": "ramp" if slowly else "step",
        f"{STEADY} [N]": np.mean(touch[-1, :2]),
        "tip force at the end [N]": np.mean(touch[-1, 2:]),
        f"{IMPACT} [N]": np.max(touch[before, :2]),
        "clearance of the base until then [mm]": 1e3 * np.min(proximity[before, :2]),
        f"{SHIFT} [mm]": np.max(shift),
        "shift at the end [mm]": shift[-1],
        f"{SLOWEST} [s]": first(log["time"] - START, both),
        "slip in the hand that lifts the can [mm]": slip,
    }


def better(trials: ex.Trials) -> dict[str, ex.Values]:
    """Expect a gentle closing to be better than a step in all, and about as fast."""
    step, gentle = (trials.where(way=way)[0] for way in (STEP, APPROACH))
    compared: ex.Values = {}
    for name, measure, later in (
        ("base force, impact [N]", f"{IMPACT} [N]", 0.0),
        (f"{STEADY} [N]", f"{STEADY} [N]", 0.0),
        (f"{SHIFT} [mm]", f"{SHIFT} [mm]", 0.0),
        (f"{SLOWEST}, up to 0.1 s later [s]", f"{SLOWEST} [s]", 0.1),
    ):
        compared[name] = (gentle[measure], ex.at_most(step[measure] + later))
    return {f"{APPROACH}, less than {STEP}": compared}


# Below 0.02 mm, shifts differ from run to run.
SHIFTS = dict.fromkeys(WAYS, ex.number(spread=lambda shift: max(0.02, 0.1 * shift)))
closing_gently = ex.Experiment(
    "A hand closing around a can, gently: impact, steady force and shift of the can.",
    lambda: ex.grid(way=WAYS),
    gentle_trial,
    {
        IMPACT: dict.fromkeys(("ramp", "freeze"), ex.at_most(TOUCHED, source="thesis")),
        SHIFT: SHIFTS,
        "shift at the end": SHIFTS,
        # A can that moves further in the hand is not held, as in payload_wrap.
        "slip in the hand that lifts the can": ex.at_most(5.0),
    },
    whole=better,
    # The ramp takes ten times as long as the others.
    picture=[
        *panels("closed at once", command="step"),
        *panels("ramp of 40 s, as the thesis's client commands", command="ramp"),
    ],
)
