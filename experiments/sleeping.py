"""The time that sleeping objects save, and the outcomes with and without sleep.

In each scene, a resting carton is pushed into objects that stand and lie on a table. It
is simulated with all objects awake, and with objects that sleep until something comes
near. Every tenth scene is also simulated awake with half the step. Pushes are chaotic:
half the step changes more outcomes than sleep does.

In `sleeping_tasks`, trials of the varied kitchen with a can and two pieces of clutter
must give the same result in words: success, the reason of a failure, the number of
attempts.
"""

import dataclasses as dc
import time as wall
from typing import Any

import numpy as np

import experiments.runner as ex
from drake_srg.common.log_format import is_pose
from drake_srg.objects.config import ObjectConfig, SleepingConfig
from drake_srg.scenario import load_scenario
from drake_srg.simulation.rig import Rig, tabletop
from drake_srg.types import Box, Cylinder, Vector
from experiments.data import household_objects
from experiments.stands.cells import simulate_whole
from experiments.stands.holding import body_of, push

# The carton is pushed when everything sleeps, and has come to rest at the end [s].
PUSH, PUSHED_FOR, END = 1.1, 0.1, 1.6
MOVED, FELL = 0.005, np.deg2rad(45.0)  # an object moved [m], or fell over [rad]
AWAKE, ASLEEP, HALF = "awake", "asleep", "half the step"
_AT_REST = ("005_tomato_soup_can", "mug", "bowl", "squeeze_bottle", "wrench")
# By how many trials a count, and by how much a share, differs from run to run.
SOME, PART = ex.number(spread=3.0), ex.number(spread=0.01)
_COST = 2.0  # simulated time over which the cost is measured [s]
QUANTILES = {"median": 0.5, "95th percentile": 0.95, "largest": 1.0}


def scene(seed: int) -> tuple[dict[str, ObjectConfig], float]:
    """Return the objects of a scene and the force of the push along x [N].

    The carton comes first. The others are ahead of it, none in contact with another.
    """
    rng = np.random.default_rng(seed)

    def draw(least: float, most: float) -> float:
        return float(rng.uniform(least, most))

    common: dict[str, Any] = {"friction": 0.6, "mass": draw(0.1, 0.4)}
    objects = {
        "carton": ObjectConfig(
            shape=Box([0.06, 0.08, 0.05]), mass=0.4, friction=0.4, position=[0.3, 0.0]
        ),
        "can": ObjectConfig(
            shape=Cylinder(0.033, draw(0.05, 0.1)),
            position=[draw(0.38, 0.46), draw(-0.04, 0.04)],
            **common,
        ),
        "block": ObjectConfig(
            shape=Box([0.05, 0.05, draw(0.03, 0.1)]),
            position=[draw(0.52, 0.58), 0.03 + draw(-0.04, 0.04)],
            yaw=draw(0.0, 1.5),
            **common,
        ),
    }
    return objects, draw(5.0, 12.0)


def cases(seeds: int = 300) -> list[ex.Case]:
    """Measure the cost of objects at rest, then push cartons in many scenes."""
    costs = ex.grid(name=["6 objects", "40 objects"], seed=[None], kind=(AWAKE, ASLEEP))
    scenes = ex.grid(name=["scenes"], seed=range(seeds), kind=(AWAKE, ASLEEP, HALF))
    return costs + [c for c in scenes if c["kind"] != HALF or c["seed"] % 10 == 0]


def trial(name: str, kind: str, seed: int | None) -> ex.Measures:
    sleeping = SleepingConfig() if kind == ASLEEP else None
    if seed is None:
        count = int(name.split(maxsplit=1)[0])
        rig = Rig(tabletop(at_rest(count), sleeping), name="sleeping", log_period=0.5)
        rig.advance(1.5)  # once everything is at rest
        start = wall.process_time()
        rig.advance(_COST)
        return {"cost": (wall.process_time() - start) / _COST}
    objects, force = scene(seed)
    scenario = tabletop(objects, sleeping)
    if kind == HALF:
        scenario.plant_config.time_step *= 0.5
    rig = Rig(scenario, name="sleeping", period=0.05, log_period=0.5)
    rig.advance(PUSH)
    slept = all(body_of(rig, name).is_locked(rig.plant_context) for name in objects)
    start_poses = [rig.X_WO(thing) for thing in objects]
    push(rig, "carton", [force, 0.0, 0.0])
    rig.advance(PUSHED_FOR)
    push(rig, "carton", np.zeros(3))
    rig.advance(END - PUSH - PUSHED_FOR)
    moved, words = [], []
    for a, thing in zip(start_poses, objects, strict=True):
        b = rig.X_WO(thing)
        moved.append(b.translation() - a.translation())
        upright = np.clip(a.rotation().col(2) @ b.rotation().col(2), -1.0, 1.0)
        fell, far = np.arccos(upright) > FELL, np.linalg.norm(moved[-1]) > MOVED
        words.append("fell" if fell else "moved" if far else "stayed")
    return {"moved": moved, "words": " ".join(words), "slept": slept}


def at_rest(count: int) -> dict[str, ObjectConfig]:
    """Return that many objects at rest, some of each kind, apart from each other."""
    things = household_objects()
    box = ObjectConfig(shape=Box([0.09, 0.17, 0.04]), mass=0.5, friction=0.6)
    kinds = [*(things[name] for name in _AT_REST), box]
    return {
        f"thing_{i}": dc.replace(
            kinds[i % len(kinds)],
            position=[-0.25 + 0.2 * (i % 7), -0.65 + 0.22 * (i // 7)],
        )
        for i in range(count)
    }


def costs(own: ex.Trials) -> ex.Values:
    if own.name == "scenes":
        return {}
    found = {f"{t['kind']}, real-time factor []": 1.0 / t["cost"] for t in own}
    if own.name == "6 objects":
        awake, asleep = own["cost"]
        found["cost asleep over cost awake []"] = asleep / awake
    return found


def outcomes(trials: ex.Trials) -> dict[str, ex.Values]:
    """Expect the same outcomes, within the effect of half the time step."""
    scenes = trials.where(name="scenes")
    awake = {t["seed"]: t for t in scenes.where(kind=AWAKE)}
    asleep, half = (scenes.where(kind=kind) for kind in (ASLEEP, HALF))

    def others(own: ex.Trials) -> int:
        return sum(t["words"] != awake[t["seed"]]["words"] for t in own)

    def apart(own: ex.Trials) -> Vector:
        """Return how far each scene ends from the same one awake, at most [mm]."""
        apart = [t["moved"] - awake[t["seed"]]["moved"] for t in own]
        return 1e3 * np.array([np.linalg.norm(a, axis=1).max() for a in apart])

    smaller = others(asleep) / len(asleep) < others(half) / len(half)
    known = "pushes are chaotic; half the step changes a larger share" * smaller
    what, largest = "scenes that end otherwise", max(apart(asleep))
    same: ex.Values = {
        f"{what} [of {len(asleep)}]": (others(asleep), ex.at_most(0.0, known=known)),
        # Of one can that rolls.
        "difference of positions, largest [mm]": (largest, ex.number(spread=largest)),
    }
    for word in ("median", "95th percentile"):
        value, limit = (np.quantile(apart(o), QUANTILES[word]) for o in (asleep, half))
        key = f"difference of positions, {word}, at most with half the step [mm]"
        same[key] = (value, ex.at_most(limit))
    return {
        ASLEEP: {"scenes in which all slept []": np.mean(asleep["slept"])},
        f"awake and {HALF}": {f"{what} [of {len(half)}]": (others(half), SOME)},
        "awake and asleep": same,
    }


sleeping = ex.Experiment(
    "The time that sleeping objects save, and the outcomes with and without sleep.",
    cases,
    trial,
    {
        "scenes in which all slept": ex.at_least(1.0),
        "cost asleep over cost awake": ex.at_most(0.5),
        "awake, real-time factor": ex.number(clock="rate"),
        "asleep, real-time factor": ex.number(clock="rate"),
    },
    summary=costs,
    whole=outcomes,
    picture=[
        ex.Bars(["awake, real-time factor", "asleep, real-time factor"], log=True),
        ex.Bars(["difference of positions, largest"]),
    ],
    serial=True,
)

_TASK_OVERRIDES = (
    # Contact settings in which things rest; see `resting`. Then, what saves time.
    "plant_config.time_step=0.005",
    "plant_config.stiction_tolerance=1.0e-3",
    "directives.table.add_model.file=package://drake_srg/sdf/table_mat.sdf",
    "directives.gripper.add_model.file=package://drake_srg/sdf/srg_fast.sdf",
    "ignored_contacts=[['arm::*', 'arm::*'], ['arm::*', 'gripper::*']]",
    "clutter.count=2",
)


def task_cases(trials: int = 300, seed: int = 0) -> list[ex.Case]:
    seeds = range(seed, seed + trials)
    return [{"kind": kind, "seed": s} for s in seeds for kind in (AWAKE, ASLEEP)]


def task_trial(kind: str, seed: int) -> ex.Measures:
    start = wall.process_time()
    overrides = (*_TASK_OVERRIDES, *(("sleeping={}",) if kind == ASLEEP else ()))
    scenario = load_scenario("kitchen_varied_accurate", seed=seed, overrides=overrides)
    result = simulate_whole(scenario)
    m = result.metrics
    return {
        "success": bool(m.success),
        "attempts": m.attempts,
        "outcome": f"{m.success}, {m.failure or ''}, {m.attempts}",
        "touched": (m.others_moved_m or 0.0) > MOVED,
        "ends": [log[-1, :3] for key, log in result.log.items() if is_pose(key)],
        "seconds": wall.process_time() - start,
    }


def task_outcomes(trials: ex.Trials) -> dict[str, ex.Values]:
    """Expect the same outcome of every trial; that limit was set before the first."""
    awake, asleep = (trials.where(kind=kind) for kind in (AWAKE, ASLEEP))
    n, pairs = len(awake), list(zip(awake, asleep, strict=True))
    other = int(np.sum(awake["outcome"] != asleep["outcome"]))
    low, high = ex.wilson(other, n)
    moved = np.sum(awake["touched"] != asleep["touched"])
    apart = [np.linalg.norm(a["ends"] - b["ends"], axis=1).max() for a, b in pairs]
    found: ex.Values = {
        f"trials that end otherwise [of {n}]": (other, ex.at_most(0.0)),
        "their share, at least []": (low, PART),
        "their share, at most []": (high, PART),
        f"trials in which only one moves another object [of {n}]": (moved, SOME),
    }
    for word, share in QUANTILES.items():
        value = 1e3 * np.quantile(apart, share)
        key = f"difference of positions, {word} [mm]"
        found[key] = (value, ex.number(spread=value))
    cost = sum(asleep["seconds"]) / sum(awake["seconds"])
    found["cost asleep over cost awake []"] = (cost, ex.number(spread=0.1))
    return {"awake and asleep": found}


sleeping_tasks = ex.Experiment(
    "Outcomes of tasks with resting objects that sleep, and with all awake.",
    task_cases,
    task_trial,
    dict.fromkeys(
        ("successes", "trials of several attempts", "trials that move another object"),
        SOME,
    ),
    summary=lambda own: {
        f"successes [of {len(own)}]": np.sum(own["success"]),
        f"trials of several attempts [of {len(own)}]": np.sum(own["attempts"] > 1),
        f"trials that move another object [of {len(own)}]": np.sum(own["touched"]),
    },
    whole=task_outcomes,
    picture=[
        ex.Bars(["successes", "trials that move another object"]),
        ex.Histogram("seconds"),
    ],
    serial=True,
)
