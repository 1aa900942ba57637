"""The plant's own servos against sampled drivers: closing, force, borderline grasps.

Grasps are drawn so that about half of them hold. The same grasp of the same object is
simulated coarsely, as policies are trained, and in fine steps.
"""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np

from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.learning.envs.tasks import GraspOneShotEnv
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.sweeps.statistics import wilson_interval
from drake_srg.types import Vector

DRIVERS = {
    "plant": "!PlantServoDriver {}",
    "position": "!SrgPositionDriver {}",
    "tendon": "!SrgTendonDriver {}",
}
# Physics and driver of both ways to simulate a grasp; the second is the reference.
WAYS = (("train", "plant"), ("accurate", "plant"))
_CLOSURE = 0.6
# Scenes of other seeds are for training and evaluation.
_FIRST_SEED = 9_000_000


@dc.dataclass(frozen=True)
class Closing:
    """An empty hand that closes, then one that holds a can.

    Attributes:
        time: Samples, shape (K,) [s].
        base: Angle of the left base of the empty hand, shape (K,) [rad].
        rise: Time until it is within a tenth of where it goes [s].
        force: Sum of the pressures of one finger on the can [N].
    """

    time: Vector
    base: Vector
    rise: float
    force: float


def measure_closing(driver: str) -> Closing:
    """Close a hand with a driver on nothing, and on a can."""
    empty = bench_scenario(
        scenario="gripper_bench_fast",
        overrides=[f"gripper={driver}", "object.present=false"],
    )
    with Rig(empty, name="plant_servo") as rig:
        rig.advance(2.0, closure=_CLOSURE)
        log = rig.log()
    base = log["gripper.state_measured"][:, 0]
    rise = float(log["time"][np.argmax(base >= 0.9 * base[-1])])
    can = bench_scenario(scenario="gripper_bench_fast", overrides=[f"gripper={driver}"])
    with Rig(can, name="plant_servo") as rig:
        rig.move([0.0, 0.0, 0.22], 1.0)
        rig.advance(2.0, closure=0.66)
        force = rig.measured("gripper.contact_force")
    return Closing(log["time"], base, rise, float(0.5 * np.sum(force)))


def borderline_action(seed: int, env: GraspOneShotEnv) -> Vector:
    """Return a grasp of the present scene that is off by so much that it may fail."""
    rng = np.random.default_rng(seed)
    size = env.scene.shape.bounding_size
    across = 0.0 if env.scene.is_round or size[1] <= size[0] else 1.0
    x, y, yaw = rng.normal([0.0, 0.0, across], [0.4, 0.4, 0.25])
    height, closure = rng.uniform([-1.0, -0.4], [1.0, 0.8])
    return np.array([x, y, height, yaw, -1.0, closure])


def outcomes(track: Track, grasps: int) -> Vector:
    """Return which grasps hold, shape (2, grasps), a row per entry of `WAYS`."""
    envs = [
        GraspOneShotEnv(physics=physics, driver=driver, noise=0.0)
        for physics, driver in WAYS
    ]
    held = np.zeros((len(WAYS), grasps))
    for k in track(range(grasps), lambda k: f"grasp {k}"):
        for i, env in enumerate(envs):
            env.reset(seed=_FIRST_SEED + k)
            *_, info = env.step(borderline_action(k, env))
            held[i, k] = info["success"]
    return held


def run(track: Track, *, grasps: int = 89) -> ExperimentResult:
    """Compare the drivers' closing, and grasps that nearly fail.

    Args:
        track: Shows progress.
        grasps: Number of grasps.
    """
    closings = {name: measure_closing(driver) for name, driver in DRIVERS.items()}
    held = outcomes(track, grasps)
    rows = [*closing_rows(closings), *grasp_rows(held)]
    names = [" ".join(way) for way in WAYS]
    table = {"grasp": np.arange(grasps), **dict(zip(names, held, strict=True))}
    return ExperimentResult(rows, {"grasps": table}, _draw(closings, held))


def closing_rows(closings: dict[str, Closing]) -> list[Row]:
    """Judge the plant's servos beside the position driver's."""
    rows = []
    for name, closing in closings.items():
        rows += [
            Row.info(name, "90 % of closure 0.6, empty", closing.rise, "s"),
            Row.info(name, "force of a finger on the can", closing.force, "N"),
        ]
    # The speed limit of both is that of the joint; the reference of the sampled driver
    # spends half of its time on starting and stopping.
    sampled = closings["position"]
    rows.append(
        Row.at_most(
            "plant", "closing time over the position driver's", 1.0,
            closings["plant"].rise / sampled.rise, "",
        )
    )  # fmt: skip
    return rows


def grasp_rows(held: Vector) -> list[Row]:
    """Judge how often the ways of simulating grasps agree."""
    rows = []
    for way, outcome in zip(WAYS, held, strict=True):
        low, high = wilson_interval(int(outcome.sum()), outcome.size)
        for suffix, value in (
            ("", float(outcome.mean())),
            (", at least", low),
            (", at most", high),
        ):
            rows.append(
                Row.info(" ".join(way), f"grasps held{suffix}", value, "", spread=0.1)
            )
    coarse, fine = held
    same = float(np.mean(coarse == fine))
    rows.append(
        Row.at_least(
            "train plant", "same outcome as accurate plant", 0.85, same, "", spread=0.1
        )
    )
    return rows


def _draw(closings: dict[str, Closing], held: Vector) -> Any:
    figure = make_figure(8.0, 3.4, "Drivers that close, and grasps that nearly fail")
    left, right = figure.subplots(1, 2)
    style_axes(left, xlabel="time [s]", ylabel="base angle, empty hand [rad]")
    for (name, closing), color in zip(closings.items(), COLORS, strict=False):
        left.plot(closing.time, closing.base, color=color, label=name)
    left.set_xlim(0.0, 1.5)
    left.legend(fontsize=8, frameon=False)
    style_axes(right, ylabel="grasps held [%]")
    names = [" ".join(way) for way in WAYS]
    right.bar(names, 100.0 * held.mean(axis=1), color=COLORS[: len(WAYS)])
    right.set_ylim(0.0, 100.0)
    return figure
