"""Household objects in random poses, grasped from above by the depth image alone.

Each object is dropped in a random orientation, and the planner does not know the
object. It makes a height map of a noisy depth image, and tries the best grasp on this
map. The object counts as held if only the hand holds it one second after it was lifted
by 15 cm. After a failure, the camera looks again. Another underactuated hand, with RP
joints, grasps 87 % of household objects at best.
"""

import dataclasses as dc
import time as clock
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.random import Generator, default_rng
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform, RotationMatrix

import experiments.runner as ex
from drake_srg import ScenarioError, load_scenario
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import HOUSEHOLD, household_object, object_facts
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.planning.grasps.top_grasps import HeightMapGrasps, Reach, TopGrasp
from drake_srg.simulation.rig import Rig, bench_scenario, tabletop
from drake_srg.types import Failure, HeightMap
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.camera_errors import CameraErrorsConfig
from drake_srg.vision.height_map import SUBPIXELS, height_map, points_of
from drake_srg.vision.surfaces import Surface
from experiments.stands.holding import body_of, is_free

_PUBLISHED = ex.at_least(0.87, spread=0.1, source="published, of an RP hand")
_MODELS = (".sdf", ".urdf", ".obj", ".stl", ".glb", ".gltf", ".xml", ".vtk")
_MIDDLE = np.array([0.5, 0.0, 0.0])  # of the bench, under the gantry [m]
_UP = np.array([0.0, 0.0, 1.0])
_SPREAD = 0.1  # things start within this of the middle [m]
_FALL, _REST = 0.01, 0.005  # height of the drop [m], speed at rest [m/s]
_SETTLE, _PATIENCE = 1.0, 4.0  # least and greatest time to come to rest [s]
# What the gantry reaches, and more around it.
_REACH = Reach((0.5, 0.0), 0.0, 0.38)
_SURFACE = Surface((0.0, -0.5), (1.0, 0.5), 0.0)
_APPROACH, _LIFT = 0.12, 0.15  # m
_ARRIVE, _CLOSE, _RAISE, _HOLD = 0.8, 1.2, 0.8, 1.0  # s
_ATTEMPTS = 3  # grasps to try before giving up
_NOISE = CameraErrorsConfig(depth_noise=1e-3, depth_dropout=0.01)
# Contact settings in which things rest (see `resting`), and the position driver as in
# `kitchen`.
_SETTINGS = (
    "plant_config.time_step=0.005",
    "plant_config.discrete_contact_approximation=lagged",
    "plant_config.stiction_tolerance=1.0e-4",
    "directives.table.add_model.file=package://drake_srg/sdf/table_mat.sdf",
    "arm.period=0.005",
    "gripper=!SrgPositionDriver {underactuation: {base: freeze, approach_speed: 1.0}}",
)


def cases(
    objects: Sequence[str] = (), trials: int = 6, seed: int = 1000
) -> list[ex.Case]:
    """Grasp every object in random poses.

    Args:
        objects: Household objects, or files of models; all of the former by default.
    """
    named = [name for name in objects if Path(name).suffix not in _MODELS]
    ex.chosen("objects", named, HOUSEHOLD)
    # All objects in one pose before any in the next.
    return ex.grid(seed=range(seed, seed + trials), object=objects or HOUSEHOLD)


def trial(seed: int, object: str) -> ex.Measures:
    """Drop a thing and try to lift it, until it is held or all attempts failed."""
    known = object in HOUSEHOLD
    thing = household_object(object) if known else ObjectConfig(model=object)
    name = Path(object).stem
    planner = HeightMapGrasps(SrgFingers(), _SURFACE.height, reach=_REACH)
    X_WO = drop(name, thing, default_rng([seed, sum(map(ord, name))]))
    tried: list[TopGrasp] = []
    held, wrong, reasons, planning, image = [], 0, [], [], None
    for number in range(_ATTEMPTS):
        map_ = look(thing, X_WO, seed * 100 + number)
        began = clock.perf_counter()
        plan = planner.plan(map_, tried=tried, seed=seed)
        planning.append(1e3 * (clock.perf_counter() - began))
        if image is None:
            image = picture(map_, X_WO, plan.grasps)
        if not plan.grasps:
            failures = [refusal.failure for refusal in plan.refused]
            reasons.append((failures or [Failure.NOT_SEEN])[0].value)
            held.append(False)
            break
        tried.append(plan.grasps[0])
        try:
            holds, feels, reason, X_WO = lift(name, thing, X_WO, tried[-1])
        except ScenarioError:
            holds, feels, reason = False, False, "simulation"
        held.append(holds)
        if holds:
            break
        wrong += feels
        reasons.append(reason)
        X_WO = settle(name, thing, X_WO)
    return {
        "graspable": len(tried) > 0,
        "first attempt": held[0],
        "any attempt": held[-1],
        "reasons": reasons,
        "felt, was not": wrong,
        "planning": planning,
        "image": image,
    }


def drop(name: str, thing: ObjectConfig, rng: Generator) -> RigidTransform:
    """Drop a thing in a random orientation and return the pose in which it rests."""
    facts = object_facts(name, thing)
    quaternion = rng.normal(size=4)
    R_WO = RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))
    corners = np.array(np.meshgrid(*zip(facts.low, facts.high, strict=True)))
    corners = corners.reshape(3, -1).T @ R_WO.matrix().T
    away = rng.uniform(-_SPREAD, _SPREAD, size=2)
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    p_WO = np.array([*(away - middle[:2]), _FALL - corners[:, 2].min()]) + _MIDDLE
    return settle(name, thing, RigidTransform(R_WO, p_WO))


def placed(thing: ObjectConfig, X_WO: RigidTransform) -> ObjectConfig:
    return dc.replace(thing, pose=Transform(X_WO), position=None)


def settle(name: str, thing: ObjectConfig, X_WO: RigidTransform) -> RigidTransform:
    """Return the pose in which a thing from `X_WO` rests, or that after 4 s."""
    scenario = tabletop({"thing": placed(thing, X_WO)})
    with Rig(scenario, name=name, period=0.05, log_period=0.05) as rig:
        body = body_of(rig, "thing")
        while rig.time < _PATIENCE:
            rig.advance(0.05)
            V = rig.plant.EvalBodySpatialVelocityInWorld(rig.plant_context, body)
            speed = np.linalg.norm(V.translational())
            speed += 0.1 * np.linalg.norm(V.rotational())
            if rig.time > _SETTLE and speed < _REST:
                break
        return rig.X_WO("thing")


def look(thing: ObjectConfig, X_WO: RigidTransform, seed: int) -> HeightMap:
    """Return the height map of the table from the image of `kitchen`'s camera."""
    camera = load_scenario("kitchen").cameras["ceiling"]
    scenario = tabletop({"thing": placed(thing, X_WO)})
    scenario.random_seed = seed
    scenario.cameras = {"ceiling": camera}
    scenario.camera_errors = {"ceiling": _NOISE}
    with Rig(scenario, name="look", period=0.05, log_period=0.05, images=True) as rig:
        context = rig.station.GetMyContextFromRoot(rig.context)
        image, X_WB = (
            rig.station.GetOutputPort(f"camera_ceiling.{port}").Eval(context)
            for port in ("depth_image", "body_pose_in_world")
        )
        depth = image.data[..., 0].copy()
    imager = CameraModel.from_config(camera).imager("depth")
    return height_map([points_of(depth, X_WB, imager, subpixels=SUBPIXELS)], _SURFACE)


def lift(
    name: str, thing: ObjectConfig, X_WO: RigidTransform, grasp: TopGrasp
) -> tuple[bool, bool, str, RigidTransform]:
    """Try a grasp.

    Return whether the hand holds the thing, whether its fingers say so, why not, and
    the thing's pose at the end.
    """
    there, start = grasp.X_WG.translation() - _MIDDLE, X_WO.translation()
    scenario = bench_scenario(
        placed(thing, X_WO),
        gripper_rpy=[0.0, 90.0, np.rad2deg(grasp.yaw) - 90.0],
        home=list(there + _APPROACH * _UP),
        scenario="gripper_bench_fast",
        overrides=_SETTINGS,
    )
    with Rig(scenario, name=name) as rig:
        rig.fix("gripper.closure_commanded", grasp.closure_open)
        rig.advance(0.5)
        rig.move(there, _ARRIVE)
        moved = np.linalg.norm(rig.X_WO("thing").translation() - start)
        rig.advance(_CLOSE, closure=grasp.closure_closed)
        rig.move(there + _LIFT * _UP, _RAISE)
        rig.advance(_HOLD)
        X_WO = rig.X_WO("thing")
        held = is_free(rig)  # it may hang
        q = rig.measured("gripper.state_measured")[:4]
        proximity = rig.measured("gripper.proximity")
        sensed = rig.measured("gripper.grasped")[0] > 0.0
        felt = bool(sensed and grasp.holds(q, proximity))
    reason = "pushed" if moved > 0.01 else "slipped"
    if X_WO.translation()[2] - start[2] > 0.05:
        reason = "dropped"
    return held, felt, reason, X_WO


def picture(
    map_: HeightMap, X_WO: RigidTransform, grasps: Sequence[TopGrasp]
) -> npt.NDArray[np.uint8]:
    """Return the map around a thing: high bright, unknown red, the best grasp blue."""
    # Steps hide the table's noise, which would make a large file.
    height = 0.006 * np.round(map_.height / 0.006)
    grey = np.nan_to_num(255.0 * np.clip(height / 0.12, 0.0, 1.0))
    image = np.repeat(grey[:, :, None], 3, axis=2).astype(np.uint8)
    image[~np.isfinite(height)] = (204, 102, 119)
    for grasp in grasps[:1]:
        gap = grasp.half_gap * np.array([np.cos(grasp.yaw), np.sin(grasp.yaw)])
        xy = grasp.p_WC[:2] + np.linspace(-1.0, 1.0, 200)[:, None] * gap
        j, i = np.round((xy - map_.origin) / map_.resolution).astype(int).T
        image[i, j] = (68, 119, 170)
    j, i = np.round((X_WO.translation()[:2] - map_.origin) / map_.resolution)
    span = round(0.13 / map_.resolution)
    rows = slice(max(int(i) - span, 0), int(i) + span)
    columns = slice(max(int(j) - span, 0), int(j) + span)
    return image[rows, columns][::-1]


def draw(figure: Any, trials: ex.Trials, rows: Sequence[Any]) -> None:
    """Draw each object's first pose, with its number of successful first attempts."""

    def caption(entry: Any) -> str:
        own = trials.where(object=entry["object"])
        return f"{sum(own['first attempt'])} of {len(own)} held"

    first = trials.where(seed=trials[0]["seed"])
    images = ex.Images(caption=caption, across=7)
    images.draw(figure.add_subplot(), first, rows, ("object",))


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    found: dict[str, ex.Values] = {}
    graspable = trials.where(graspable=True)
    for name, own, bound in (
        ("all", trials, None),
        ("with a grasp", graspable, _PUBLISHED),
    ):
        n = len(own)
        found[name] = {"trials []": (n, ex.number(spread=1.0 + n / 8))}
        for what in ("first attempt", "any attempt"):
            held = sum(own[what])
            found[name] |= ex.share(f"held, {what}", held, n, bound, spread=0.1)

    reasons = sorted(reason for t in trials for reason in t["reasons"])
    wrong = int(sum(trials["felt, was not"]))
    some = ex.number(spread=3.0 + 0.3 * wrong)
    plans: Any = np.concatenate([t["planning"] for t in trials])
    return found | {
        "failed": ex.counts(reasons, "attempts", least=3.0),
        "fingers": {"felt held, was not [attempts]": (wrong, some)},
        "planner": {"a plan, median [ms]": (np.median(plans), ex.number(clock="time"))},
    }


grasp_anything = ex.Experiment(
    "Household objects in random poses, grasped from above by the depth image alone.",
    cases,
    trial,
    by=("object", "seed"),
    whole=whole,
    picture=draw,
)
