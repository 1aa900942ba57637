"""The plant's own servos against sampled drivers: closing, force, borderline grasps.

Grasps are drawn so that about half of them hold. The same grasp of the same object is
simulated coarsely, as in training, and in fine steps. Both servos have the joint's
speed limit. The reference of the sampled driver spends half of its time on starting and
stopping.
"""

import functools

import numpy as np

import experiments.runner as ex
from drake_srg.learning.envs.tasks import GraspOneShotEnv
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Vector

DRIVERS = {
    "plant": "!PlantServoDriver {}",
    "position": "!SrgPositionDriver {}",
    "tendon": "!SrgTendonDriver {}",
}
# Physics and driver of both ways to simulate a grasp; the second is the reference.
WAYS = {"train plant": ("train", "plant"), "accurate plant": ("accurate", "plant")}
# Scenes of other seeds are for training and evaluation.
_FIRST_SEED = 9_000_000


def cases(trials: int = 89) -> list[ex.Case]:
    """Compare the drivers' closing, and grasps that nearly fail."""
    closings = ex.grid(name=DRIVERS, grasp=[None])
    return closings + ex.grid(name=WAYS, grasp=range(trials))


def trial(name: str, grasp: int | None) -> ex.Measures:
    if grasp is None:
        return closing(DRIVERS[name])
    env = environment(name)
    env.reset(seed=_FIRST_SEED + grasp)
    *_, info = env.step(borderline_action(grasp, env))
    return {"held": bool(info["success"])}


@functools.cache
def environment(way: str) -> GraspOneShotEnv:
    physics, driver = WAYS[way]
    return GraspOneShotEnv(physics=physics, driver=driver, noise=0.0)


def closing(driver: str) -> ex.Measures:
    bench = functools.partial(bench_scenario, scenario="gripper_bench_fast")
    empty = bench(overrides=[f"gripper={driver}", "object.present=false"])
    with Rig(empty, name="plant_servo") as rig:
        rig.advance(2.0, closure=0.6)
        log = rig.log()
    base = log["gripper.state_measured"][:, 0]
    rise = float(log["time"][np.argmax(base >= 0.9 * base[-1])])
    with Rig(bench(overrides=[f"gripper={driver}"]), name="plant_servo") as rig:
        rig.move([0.0, 0.0, 0.22], 1.0)
        rig.advance(2.0, closure=0.66)
        force = rig.measured("gripper.contact_force")
    return {
        "time [s]": log["time"],
        "base angle, empty hand [rad]": base,
        "90 % of closure 0.6, empty [s]": rise,
        "force of a finger on the can [N]": 0.5 * np.sum(force),
    }


def borderline_action(seed: int, env: GraspOneShotEnv) -> Vector:
    """Return a grasp of the present scene, displaced so far that it may fail."""
    rng = np.random.default_rng(seed)
    size = env.scene.shape.bounding_size
    across = 0.0 if env.scene.is_round or size[1] <= size[0] else 1.0
    x, y, yaw = rng.normal([0.0, 0.0, across], [0.4, 0.4, 0.25])
    height, closure = rng.uniform([-1.0, -0.4], [1.0, 0.8])
    return np.array([x, y, height, yaw, -1.0, closure])


def summary(own: ex.Trials) -> ex.Values:
    if own.name in DRIVERS:
        return dict(own[0])
    return ex.share("grasps held", sum(own["held"]), len(own), spread=0.1)


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    """Compare closing times, and how often the ways of simulating grasps agree."""
    plant, sampled = (
        trials.where(name=name).one("90 % of closure 0.6, empty [s]")
        for name in ("plant", "position")
    )
    coarse, fine = (trials.where(name=way)["held"] for way in WAYS)
    agree = (np.mean(coarse == fine), ex.at_least(0.85, spread=0.1))
    return {
        "plant": {"closing time over the position driver's []": plant / sampled},
        "train plant": {"same outcome as accurate plant []": agree},
    }


plant_servo = ex.Experiment(
    "The plant's own servos against sampled drivers: closing, force, grasps that fail.",
    cases,
    trial,
    {"closing time over the position driver's": ex.at_most(1.0)},
    summary=summary,
    whole=whole,
    picture=[
        ex.Curves("time [s]", "base angle, empty hand [rad]", where={"grasp": None}),
        ex.Bars(["grasps held"]),
    ],
)
