"""Speed of simulation and resets in the environments for learning, and their memory.

Times are processor times of one core, except for two workers, which are judged by real
time. The limits were set before the run, for an otherwise idle machine. Contact costs
most: while the hand holds something, contact surfaces take two thirds of the time, and
all Python together an eighth.
"""

import itertools
import multiprocessing as mp
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import experiments.runner as ex
from drake_srg.common.systems import NEWER_DRAKE, has_fast_contact
from drake_srg.learning.envs.tasks import PickEnv
from drake_srg.sweeps.trial import resident_memory

# Scenario, physics and driver of the gripper; control periods per second of processor
# time, and time to reset with another object [ms] that are asked for.
CASES = {
    "learn_bench, train, plant": (1500.0, 3.0),
    "learn_kitchen, train, plant": (1000.0, 7.0),
    "learn_bench, train, position": (500.0, 3.0),
    "learn_kitchen, train, position": (500.0, 7.0),
    # As `kitchen_fast` simulates its cell, for comparison.
    "learn_kitchen, fast, position": (0.0, 7.0),
}
FIRST, *_, REFERENCE = CASES
WORKERS = "two workers"
# Episodes of each, and short ones over which the memory is watched.
_EPISODES, _SHORT = 12, 10_000
# Steps of the hand: down over a cylinder, closing, up until the shake.
_DOWN, _CLOSE = 6, 14
_FREE = 15  # steps of turning over the object
_OLD = "" if has_fast_contact() else f"needs the faster contact of {NEWER_DRAKE}"


def cases() -> list[ex.Case]:
    """Measure steps, resets and memory of the environments, then two workers."""
    return ex.grid(name=(*CASES, WORKERS))


def make(name: str) -> PickEnv:
    scenario, physics, driver = name.split(", ")
    return PickEnv(scenario=scenario, physics=physics, driver=driver)


def trial(name: str) -> ex.Measures:
    """Play the same grasp, and reset to other objects in between."""
    if name == WORKERS:
        return {"scaling": 2.0 * slowest(1) / slowest(2)}
    env = make(name)
    x, y = env.mover.pose(env.q_start)[:2]
    cylinder = {"_tag": "!Cylinder", "radius": 0.03, "length": 0.1}
    thing = {"shape": cylinder, "mass": 0.2, "friction": 0.8, "resolution": 0.018}
    scene = {"object": {**thing, "position": [float(x), float(y)]}}
    ticks, free, resets, held = [], [], [], []
    for k in range(_EPISODES):
        start = time.process_time()
        env.reset(seed=k)
        resets.append(1e3 * (time.process_time() - start))
        start = time.process_time()
        for _ in range(_FREE):
            env.step(np.array([0.0, 0.0, 0.0, 0.5, -1.0]))
        free.append(_FREE / (time.process_time() - start))
        env.reset(options={"scene": scene})
        start = time.process_time()
        held.append(grasp(env))
        ticks.append(env.station.time / 3 * 64 / (time.process_time() - start))
    return {
        "control periods [1/s]": np.median(ticks),
        "free of contact [1/s]": np.median(free),
        "reset [ms]": np.median(resets),
        "episodes held []": np.mean(held),
        "memory per 1,000 episodes [MB]": memory_growth(env),
    }


def grasp(env: PickEnv) -> bool:
    """Take the object under the hand, and return whether it survives the shake."""
    for step in itertools.count():
        up = float(step >= _DOWN + _CLOSE) - float(step < _DOWN)
        closure = -1.0 if step < _DOWN else 0.6
        action = np.array([0.0, 0.0, up, 0.0, closure])
        *_, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            break
    return bool(info["success"])


def memory_growth(env: PickEnv) -> float:
    """Return how the memory grows over episodes of two steps [MB per 1,000]."""
    memory = []
    for k in range(_SHORT):
        env.reset(seed=k)
        for _ in range(2):
            env.step(env.action_space.sample())
        memory.append(resident_memory() or np.nan)
    warm = _SHORT // 5  # by then all caches are full
    slope = np.polyfit(np.arange(_SHORT - warm), memory[warm:], 1)[0]
    return 1e3 * float(slope)


def slowest(workers: int) -> float:
    """Return the longest of the times that some workers need at once [s]."""
    with ProcessPoolExecutor(workers, mp.get_context("spawn")) as pool:
        return max(pool.map(timed_grasps, [10 * _EPISODES] * workers))


def timed_grasps(episodes: int) -> float:
    """Grasp in the first environment, and return the wall clock that it takes [s]."""
    env = make(FIRST)
    start = time.perf_counter()
    for k in range(episodes):
        env.reset(seed=k)
        grasp(env)
    return time.perf_counter() - start


def compared(trials: ex.Trials) -> dict[str, ex.Values]:
    """Compare environments with the physics of `kitchen_fast`, and two workers."""
    rates = {
        name: trials.where(name=name)[0]["control periods [1/s]"] for name in CASES
    }
    reference = rates.pop(REFERENCE)
    found: dict[str, ex.Values] = {}
    for name, rate in rates.items():
        ratio = rate / reference
        same = ex.number(spread=0.4 * ratio)
        found[name] = {f"rate over {REFERENCE} []": (ratio, same)}
    found[FIRST]["two workers over one []"] = trials.where(name=WORKERS).one("scaling")
    return found


learning_benchmark = ex.Experiment(
    "Speed of simulation and resets in environments for learning, and their memory.",
    cases,
    trial,
    {
        "control periods": {
            name: ex.at_least(rate, clock="rate", known=_OLD)
            for name, (rate, _) in CASES.items()
            if rate
        }
        | {REFERENCE: ex.number(clock="rate")},
        "free of contact": ex.number(clock="rate"),
        "reset": {
            name: ex.at_most(reset, clock="time") for name, (_, reset) in CASES.items()
        },
        "episodes held": ex.at_least(0.95),
        # As much comes and goes in the allocator.
        "memory per 1,000 episodes": ex.at_most(1.0, spread=1.0),
        "two workers over one": ex.at_least(1.8),
    },
    whole=compared,
    serial=True,
)
