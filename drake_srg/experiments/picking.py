"""One unknown thing on a table: look, grasp from above, lift, hold; and again."""

from __future__ import annotations

import dataclasses as dc
import time as clock

import numpy as np
from numpy.random import Generator, default_rng
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.schema import Rotation, Transform
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.sensors import CameraConfig

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.planning.grasps.top_grasps import (
    GraspPlan,
    GraspPlanner,
    Reach,
    TopGrasp,
)
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig, bench_scenario, tabletop
from drake_srg.types import Failure, HeightMap, Vector
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.camera_errors import CameraErrorsConfig
from drake_srg.vision.height_map import SUBPIXELS, height_map, points_of
from drake_srg.vision.surfaces import Surface

MIDDLE = np.array([0.5, 0.0, 0.0])  # of the bench, under the gantry [m]
_UP = np.array([0.0, 0.0, 1.0])
_SPREAD = 0.1  # things start within this of the middle [m]
_FALL, _REST = 0.01, 0.005  # height of the drop [m], speed at rest [m/s]
_SETTLE, _PATIENCE = 1.0, 4.0  # least and greatest time to come to rest [s]
# What the gantry reaches, and more around it.
REACH = Reach((0.5, 0.0), 0.0, 0.38)
SURFACE = Surface((0.0, -0.5), (1.0, 0.5), 0.0)
LIFT, HOLD = 0.15, 1.0  # m, s
_APPROACH = 0.12  # m
_ARRIVE, _CLOSE, _RAISE = 0.8, 1.2, 0.8  # s
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


@dc.dataclass(frozen=True, eq=False)
class Attempt:
    """An attempt to lift a thing.

    Attributes:
        X_WO: Pose of the thing before it.
        map: What the camera saw.
        plan: What the planner made of it.
        grasp: The grasp that was tried; None without one.
        held: Whether the hand alone held the thing at the end.
        felt: Whether the fingers said so.
        reason: Why it failed, or "".
        X_WO_end: Pose of the thing afterwards.
        planning: Wall-clock time of planning [s].
    """

    X_WO: RigidTransform
    map: HeightMap
    plan: GraspPlan
    grasp: TopGrasp | None
    held: bool
    felt: bool
    reason: str
    X_WO_end: RigidTransform
    planning: float


def rest(name: str, thing: ObjectConfig, rng: Generator) -> RigidTransform:
    """Drop a thing in a random orientation and return the pose in which it rests."""
    facts = object_facts(name, thing)
    quaternion = rng.normal(size=4)
    R_WO = RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))
    corners = np.array(np.meshgrid(*zip(facts.low, facts.high, strict=True)))
    corners = corners.reshape(3, -1).T @ R_WO.matrix().T
    away = rng.uniform(-_SPREAD, _SPREAD, size=2)
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    p_WO = np.array([*(away - middle[:2]), _FALL - corners[:, 2].min()]) + MIDDLE
    return settle(name, thing, RigidTransform(R_WO, p_WO))


def settle(name: str, thing: ObjectConfig, X_WO: RigidTransform) -> RigidTransform:
    """Return where a thing that starts at `X_WO` comes to rest, or is after 4 s."""
    scenario = tabletop({"thing": _placed(thing, X_WO)})
    with Rig(scenario, name=name, period=0.05, log_period=0.05) as rig:
        body = rig.plant.get_body(
            rig.plant.GetBodyIndices(rig.plant.GetModelInstanceByName("thing"))[0]
        )
        while rig.time < _PATIENCE:
            rig.advance(0.05)
            V = rig.plant.EvalBodySpatialVelocityInWorld(rig.plant_context, body)
            speed = np.linalg.norm(V.translational())
            speed += 0.1 * np.linalg.norm(V.rotational())
            if rig.time > _SETTLE and speed < _REST:
                break
        return rig.X_WO("thing")


def look(
    thing: ObjectConfig, X_WO: RigidTransform, noise: CameraErrorsConfig, seed: int
) -> HeightMap:
    """Return the height map of the table from the image of a ceiling camera."""
    scenario = tabletop({"thing": _placed(thing, X_WO)})
    scenario.random_seed = seed
    scenario.cameras = {"ceiling": ceiling_camera()}
    scenario.camera_errors = {"ceiling": noise}
    with Rig(scenario, name="look", period=0.05, log_period=0.05, images=True) as rig:
        context = rig.station.GetMyContextFromRoot(rig.context)
        depth, X_WB = (
            rig.station.GetOutputPort(f"camera_ceiling.{port}").Eval(context)
            for port in ("depth_image", "body_pose_in_world")
        )
        depth = depth.data[..., 0].copy()
    imager = CameraModel.from_config(scenario.cameras["ceiling"]).imager("depth")
    return height_map([points_of(depth, X_WB, imager, subpixels=SUBPIXELS)], SURFACE)


def ceiling_camera() -> CameraConfig:
    """Return the camera of `kitchen`."""
    camera = CameraConfig(width=640, height=480)
    camera.focal = CameraConfig.FovDegrees(y=45.0)
    camera.renderer_name = "plain"
    camera.X_PB = Transform(
        RigidTransform(RollPitchYaw(np.pi, 0.0, -np.pi / 2), [0.72, 0.0, 1.55])
    )
    camera.X_PB.base_frame = "world"
    return camera


def lift(
    name: str, thing: ObjectConfig, X_WO: RigidTransform, grasp: TopGrasp
) -> tuple[bool, bool, str, RigidTransform]:
    """Try a grasp.

    Returns:
        Whether the hand holds the thing, whether its fingers say so, why not, and the
        thing's pose at the end.

    Raises:
        ScenarioError: If Drake aborts the simulation.
    """
    there = grasp.X_WG.translation() - MIDDLE
    scenario = bench(thing, X_WO, grasp, there + _APPROACH * _UP)
    start = X_WO.translation()
    with Rig(scenario, name=name) as rig:
        rig.fix("gripper.closure_commanded", grasp.closure_open)
        rig.advance(0.5)
        rig.move(there, _ARRIVE)
        moved = np.linalg.norm(rig.X_WO("thing").translation() - start)
        rig.advance(_CLOSE, closure=grasp.closure_closed)
        rig.move(there + LIFT * _UP, _RAISE)
        rig.advance(HOLD)
        risen = rig.X_WO("thing").translation()[2] - start[2]
        touched = set(rig.contact_forces("thing"))
        q = rig.measured("gripper.state_measured")[:4]
        proximity = rig.measured("gripper.proximity")
        sensed = rig.measured("gripper.grasped")[0] > 0.0
        felt = bool(sensed and grasp.holds(q, proximity))
        X_WO_end = rig.X_WO("thing")
        held = touched == {"gripper"}  # it may hang from the fingers
    reason = "" if held else "pushed" if moved > 0.01 else "slipped"
    if not held and risen > 0.05:
        reason = "dropped"
    return held, felt, reason, X_WO_end


def bench(
    thing: ObjectConfig, X_WO: RigidTransform, grasp: TopGrasp, home: Vector
) -> Scenario:
    """Return the bench with a thing on the table and the hand above it."""
    return bench_scenario(
        _placed(thing, X_WO),
        gripper_rpy=[0.0, 90.0, np.rad2deg(grasp.yaw) - 90.0],
        home=list(home),
        scenario="gripper_bench_fast",
        overrides=_SETTINGS,
    )


def attempts(
    name: str,
    thing: ObjectConfig,
    planner: GraspPlanner,
    *,
    seed: int,
    most: int = 3,
    noise: CameraErrorsConfig | None = None,
) -> list[Attempt]:
    """Drop a thing and try to lift it, until it is held or `most` attempts failed."""
    rng = default_rng([seed, sum(map(ord, name))])
    X_WO = rest(name, thing, rng)
    made: list[Attempt] = []
    tried: list[TopGrasp] = []
    for number in range(most):
        map_ = look(thing, X_WO, noise or CameraErrorsConfig(), seed * 100 + number)
        began = clock.perf_counter()
        plan = planner.plan(map_, tried=tried, seed=seed)
        elapsed = clock.perf_counter() - began
        if not plan.grasps:
            failures = [refusal.failure for refusal in plan.refused]
            reason = (failures or [Failure.NOT_SEEN])[0].value
            made.append(
                Attempt(X_WO, map_, plan, None, False, False, reason, X_WO, elapsed)
            )
            break
        grasp = plan.grasps[0]
        try:
            held, felt, reason, X_WO_end = lift(name, thing, X_WO, grasp)
        except ScenarioError:
            held, felt, reason, X_WO_end = False, False, "simulation", X_WO
        made.append(
            Attempt(X_WO, map_, plan, grasp, held, felt, reason, X_WO_end, elapsed)
        )
        if held:
            break
        tried.append(grasp)
        X_WO = settle(name, thing, X_WO_end)
    return made


def _placed(thing: ObjectConfig, X_WO: RigidTransform) -> ObjectConfig:
    pose = Transform()
    pose.translation = X_WO.translation()
    pose.rotation = Rotation(X_WO.rotation())
    return dc.replace(thing, pose=pose, position=None)
