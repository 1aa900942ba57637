"""Adaptive or preprogrammed: what looking is worth to the five-axis arm.

Three methods pick the cylinder. The first uses a taught pose. The second uses the pose
that the camera saw at the beginning. The third also looks again before the grasp and
before placing. The cylinder stands where it was taught, or anywhere in the pick region,
or is pushed away during the approach. Each trial has one attempt.

This is the third research question of the arm's thesis. If the cylinder is not where it
was taught, a method that sees it must be better than the fixed pose beyond doubt: its
interval must lie above the other's. After a push, the same holds for a second look.
"""

from collections.abc import Mapping

import numpy as np

import experiments.runner as ex
from experiments.stands.cycles import THESIS_PLACE, placed_interval, run_cycle, shares

# P0 is that of `assistive_arm_thesis`: beside the recess, where a hand that goes there
# on a straight line does not touch the cylinder.
_HOME = "arm.home=[-1.391, -0.17, 0.29, 0.0, -0.1162]"
_ONCE = "planner.max_attempts=1"
FIXED, ONE_LOOK, LOOKS = "fixed pose", "one look", "looks before grasp and placing"
# P2 is the taught cylinder's middle. P4 sets it into the recess, P3 is 30 mm above.
_TAUGHT = (
    f"planner=!Taught {{grasp: {THESIS_PLACE.tolist()}, "
    "lift: [-1.567, 0.3551, -0.1627, 0.0003, -0.1926], "
    "place: [-1.567, 0.3933, -0.0757, 0.0004, -0.3138], "
    # The rest is as in `assistive_arm_fast`.
    "time_budget: 60, period: 0.01171875, clearance: 0.005, hand_clearance: 0.0025, "
    "payload: 0.03}"
)
# Nothing tells this method when the object is safe: it waits as long as ours verifies a
# grasp, and as the thesis waits for the open hand.
_WAITS = ("planner.grip_wait=0.1", "planner.release_wait=0.5")
METHODS: Mapping[str, tuple[str, ...]] = {
    FIXED: (_HOME, _TAUGHT, *_WAITS),
    ONE_LOOK: (
        *(_HOME, _ONCE, "planner.look_before_grasp=false"),
        "planner.look_before_place=false",
    ),
    LOOKS: (_HOME, _ONCE),
}
AS_TAUGHT, ANYWHERE, PUSHED = "where it was taught", "anywhere", "pushed"
# How far the cylinder is pushed [m]: the open fingers leave 17 mm on each side.
_PUSH = (0.01, 0.04)


def cases(trials: int = 100) -> list[ex.Case]:
    return [
        {"name": f"{c['situation']}: {c['method']}", **c}
        for c in ex.grid(
            method=METHODS, situation=(AS_TAUGHT, ANYWHERE, PUSHED), seed=range(trials)
        )
    ]


def situation_overrides(situation: str, seed: int) -> tuple[str, ...]:
    """Return the cylinder's place, and its disturbance, as overrides."""
    if situation == ANYWHERE:
        return ()
    place = f"object.position={THESIS_PLACE[:2].tolist()}"
    if situation == AS_TAUGHT:
        return (place,)
    rng = np.random.default_rng(seed)
    azimuth, distance = rng.uniform(-np.pi, np.pi), rng.uniform(*_PUSH)
    moved = [float(distance * np.cos(azimuth)), float(distance * np.sin(azimuth)), 0.0]
    push = f"!Push {{at: pre_grasp, after: 0.1, displacement: {moved}, duration: 0.3}}"
    return (place, f"disturbances=[{push}]")


def trial(name: str, method: str, situation: str, seed: int) -> ex.Measures:
    overrides = (*METHODS[method], *situation_overrides(situation, seed))
    return run_cycle("assistive_arm_fast", seed, overrides)


def summary(own: ex.Trials) -> ex.Values:
    found, placed = shares(own), own.where(placed=True)
    for what, unit, measure in (
        ("placement error", "mm", "distance"),
        ("time to placement", "s", "placing"),
        ("cycle", "s", "cycle"),
        ("smoothness", "", "smoothness"),
    ):
        found |= ex.quantiles(what, unit, placed.known(measure))
    return found


def better(trials: ex.Trials) -> dict[str, ex.Values]:
    found: dict[str, ex.Values] = {ANYWHERE: {}, PUSHED: {}}
    for situation, method, other in (
        (ANYWHERE, ONE_LOOK, FIXED),
        (ANYWHERE, LOOKS, FIXED),
        (PUSHED, LOOKS, FIXED),
        (PUSHED, LOOKS, ONE_LOOK),
    ):
        (low, _), (_, high) = (
            placed_interval(trials.where(situation=situation, method=name))
            for name in (method, other)
        )
        what = f"placed: least share with {method}; expected: most with {other} []"
        found[situation][what] = (low, ex.at_least(high, spread=0.05))
    return found


adaptation = ex.Experiment(
    "Adaptive or preprogrammed: what looking is worth to the five-axis arm.",
    cases,
    trial,
    summary=summary,
    whole=better,
    picture=[
        ex.Bars(["placed, share"]),
        ex.Bars(["placement error, median"]),
        ex.Bars(["time to placement, median"]),
    ],
)
