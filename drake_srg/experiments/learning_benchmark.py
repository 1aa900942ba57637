"""How fast the environments for learning simulate and reset, and what memory they keep.

Times are processor times of one core, but for two workers, whose wall clock counts.
"""

from __future__ import annotations

import dataclasses as dc
import multiprocessing as mp
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from drake_srg.common.systems import NEWER_DRAKE, has_fast_contact
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.learning.envs.tasks import PickEnv
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.sweeps.trial import resident_memory
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class Case:
    """An environment to measure, and what it must reach.

    Attributes:
        scenario: Of the environment.
        physics: Of the environment.
        driver: Of the gripper.
        rate: Control periods per second of processor time.
        reset: Time to reset with another object [ms].
    """

    scenario: str
    physics: str
    driver: str
    rate: float
    reset: float

    def __str__(self) -> str:
        return f"{self.scenario}, {self.physics}, {self.driver}"


CASES = (
    Case("learn_bench", "train", "plant", 1500.0, 3.0),
    Case("learn_kitchen", "train", "plant", 1000.0, 7.0),
    Case("learn_bench", "train", "position", 500.0, 3.0),
    Case("learn_kitchen", "train", "position", 500.0, 7.0),
    # As `kitchen_fast` simulates its cell, for comparison.
    Case("learn_kitchen", "fast", "position", 0.0, 7.0),
)
# Steps of the hand: down over a cylinder, closing, up until the shake.
_DOWN, _CLOSE = 6, 14
_FREE = 15  # steps of turning over the object
# Growth of the memory that counts as none [MB per 1,000 episodes]: as much comes and
# goes in the allocator.
_FLAT = 1.0
_SCALING = 1.8  # least speed of two workers over one
_OLD = f"needs the faster contact of {NEWER_DRAKE}"


@dc.dataclass(frozen=True)
class Speed:
    """What was measured of an environment.

    Attributes:
        ticks: Control periods per second of each episode, shape (K,).
        free: The same without contact at the hand, shape (K,).
        resets: Time of each reset, shape (K,) [ms].
        held: Share of the episodes in which the object survived the shake.
        growth: Of the process's memory [MB per 1,000 episodes].
    """

    ticks: Vector
    free: Vector
    resets: Vector
    held: float
    growth: float


def make(case: Case) -> PickEnv:
    """Make the environment of a case."""
    return PickEnv(scenario=case.scenario, physics=case.physics, driver=case.driver)


def measure(case: Case, episodes: int, short: int) -> Speed:
    """Play the same grasp, and reset to other objects in between.

    Args:
        case: What to measure.
        episodes: Number of episodes.
        short: Number of short episodes over which the memory is watched.
    """
    env = make(case)
    x, y = env.mover.pose(env.q_start)[:2]
    cylinder = {"_tag": "!Cylinder", "radius": 0.03, "length": 0.1}
    thing = {"shape": cylinder, "mass": 0.2, "friction": 0.8, "resolution": 0.018}
    scene = {"object": {**thing, "position": [float(x), float(y)]}}
    ticks, free, resets, held = [], [], [], []
    for k in range(episodes):
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
    rates = np.array(ticks), np.array(free)
    growth = memory_growth(env, short)
    return Speed(*rates, np.array(resets), float(np.mean(held)), growth)


def memory_growth(env: PickEnv, episodes: int) -> float:
    """Return how the memory grows over episodes of two steps [MB per 1,000]."""
    memory = []
    for k in range(episodes):
        env.reset(seed=k)
        for _ in range(2):
            env.step(env.action_space.sample())
        memory.append(resident_memory() or np.nan)
    warm = episodes // 5  # by then all caches are full
    slope = np.polyfit(np.arange(episodes - warm), memory[warm:], 1)[0]
    return 1e3 * float(slope)


def wall_per_grasp(case: Case, episodes: int) -> float:
    """Return the wall clock that a grasp takes [s]; for processes of their own."""
    env = make(case)
    start = time.perf_counter()
    for k in range(episodes):
        env.reset(seed=k)
        grasp(env)
    return (time.perf_counter() - start) / episodes


def scaling(case: Case, episodes: int) -> float:
    """Return how many times as many grasps two workers make as one."""
    took = []
    for workers in (1, 2):
        with ProcessPoolExecutor(workers, mp.get_context("spawn")) as pool:
            runs = [pool.submit(wall_per_grasp, case, episodes) for _ in range(workers)]
            took.append(max(run.result() for run in runs))
    return 2.0 * took[0] / took[1]


def grasp(env: PickEnv) -> bool:
    """Take the object under the hand, and return whether it survives the shake."""
    step = 0
    while True:
        up = float(step >= _DOWN + _CLOSE) - float(step < _DOWN)
        closure = -1.0 if step < _DOWN else 0.6
        *_, terminated, truncated, info = env.step(
            np.array([0.0, 0.0, up, 0.0, closure])
        )
        step += 1
        if terminated or truncated:
            return bool(info["success"])


def run(track: Track, *, episodes: int = 12, short: int = 10_000) -> ExperimentResult:
    """Measure steps, resets and memory of the environments.

    Args:
        track: Shows progress.
        episodes: Number of episodes of each.
        short: Number of short episodes over which the memory is watched.
    """
    speeds = {case: measure(case, episodes, short) for case in track(CASES)}
    rows = [row for case, speed in speeds.items() for row in judge(case, speed)]
    *cases, reference = CASES
    usual = float(np.median(speeds[reference].ticks))
    for case in cases:
        ratio = float(np.median(speeds[case].ticks)) / usual
        rows.append(
            Row.info(str(case), f"rate over {reference}", ratio, "", spread=0.4 * ratio)
        )
    ratio = scaling(CASES[0], 10 * episodes)
    rows.append(
        Row.at_least(str(CASES[0]), "two workers over one", _SCALING, ratio, "")
    )
    table: dict[str, Any] = {
        "case": [str(case) for case in speeds for _ in range(episodes)],
        "periods per second": np.concatenate([s.ticks for s in speeds.values()]),
        "reset [ms]": np.concatenate([s.resets for s in speeds.values()]),
    }
    return ExperimentResult(rows, {"episodes": table}, _draw(speeds))


def judge(case: Case, speed: Speed) -> list[Row]:
    """Judge the speed of an environment."""
    name = str(case)
    rate, reset = float(np.median(speed.ticks)), float(np.median(speed.resets))
    return [
        Row.at_least(
            name, "control periods", case.rate, rate, "1/s", clock="rate"
        ).because("" if has_fast_contact() else _OLD)
        if case.rate
        else Row.info(name, "control periods", rate, "1/s", clock="rate"),
        Row.info(
            name, "free of contact", float(np.median(speed.free)), "1/s", clock="rate"
        ),
        Row.at_most(name, "reset", case.reset, reset, "ms", clock="time"),
        Row.at_least(name, "episodes held", 0.95, speed.held, ""),
        Row.at_most(
            name,
            "memory per 1,000 episodes",
            *(_FLAT, speed.growth, "MB"),
            spread=_FLAT,
        ),
    ]


def _draw(speeds: dict[Case, Speed]) -> Any:
    figure = make_figure(8.0, 3.4, "Environments on one core, processor time")
    left, right = figure.subplots(1, 2)
    names = [str(c).removeprefix("learn_").replace(", ", "\n") for c in speeds]
    for axes, label, values, limits in (
        (left, "control periods per second", "ticks", [c.rate for c in speeds]),
        (right, "reset [ms]", "resets", [c.reset for c in speeds]),
    ):
        style_axes(axes, ylabel=label)
        heights = [float(np.median(getattr(s, values))) for s in speeds.values()]
        axes.bar(names, heights, color=COLORS[0])
        axes.plot(names, limits, "_", color=COLORS[1], markersize=30, label="limit")
        axes.tick_params(axis="x", labelsize=7)
    left.legend(fontsize=8, frameon=False)
    return figure
