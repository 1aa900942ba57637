"""Placement of an arm with the gripper in the kitchen: base, home and scenario file."""

from __future__ import annotations

import dataclasses as dc
import functools
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.random import default_rng
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import JacobianWrtVariable

from drake_srg.common.exceptions import ScenarioError
from drake_srg.importing.arm_file import ArmFile
from drake_srg.importing.arm_model import BASE
from drake_srg.objects.household import Image
from drake_srg.planning.motion.inverse_kinematics import (
    AxisTarget,
    HandTarget,
    find_posture,
)
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.scenario.load import load_scenario
from drake_srg.scenario.schema import Scenario
from drake_srg.station.planners import own_scene
from drake_srg.types import Cylinder, Vector

SCENARIO = "kitchen"
# Heights of the grasp above the table: those that the task needs, and the map's [m].
_HEIGHTS = (0.05, 0.15)
MAP_STEP = 0.05  # between the map's radii [m]
_MAP_HEIGHTS = np.arange(0.05, 0.96, 0.1)
_TILT = 0.1745  # largest lean of the hand, as in the planner [rad]
_STARTS = 6  # starts of the solver for each place on the map
# Grid of places for the base, and its least distance from the table's edges [m].
_BASE_STEP, _EDGE = 0.05, 0.12
# Least distance of the base from places of objects: room for open fingers [m].
_BASE_ROOM = 0.18
_AZIMUTHS = np.radians([0.0, 30.0, -30.0, 60.0, -60.0, 90.0, -90.0, 135.0, -135.0])
_HOMES = 6  # random starts in the search for a home
_SIGHT = 0.06  # radius of the cylinder that must be free between camera and place [m]
_OBJECT_HEIGHT = 0.1  # height of the objects that the camera must see [m]
_FAR = np.pi  # angles beyond this count against a home [rad]


@dc.dataclass(frozen=True, eq=False)
class Placement:
    """The place of an arm in the kitchen, and its reach.

    Attributes:
        base: Place of the base in world, x, y [m] and yaw [rad].
        home: Positions of the joints at the start, shape (N,) [rad or m].
        radii: Distances from the base's axis on the map, shape (R,) [m].
        heights: Heights of the grasp above the base on the map, shape (Z,) [m].
        reached: Whether the hand can point down at each point of the map, shape (Z, R).
        places: Share of the task's places that are within reach, 0 .. 1.
        sees: Whether the camera sees all places while the arm is home.
    """

    base: tuple[float, float, float]
    home: Vector
    radii: Vector
    heights: Vector
    reached: Vector
    places: float
    sees: bool


def place_arm(arm: ArmFile, path: Path) -> Placement:
    """Find base and home of an arm in the kitchen, and write its scenario.

    Args:
        arm: The arm; its model is `model.sdf` in the scenario's folder.
        path: The scenario's file.

    Raises:
        ScenarioError: If the hand cannot point down anywhere within the arm's reach.
    """
    middle = np.array([_middle(j.lower, j.upper) for j in arm.joints])
    _write(arm, path, (0.0, 0.0, 0.0), middle)
    scenario = load_scenario(path)
    at_origin = _Hand(own_scene(scenario))
    radii = np.arange(0.1, at_origin.scene.levers[0], MAP_STEP)
    reached = np.array(
        [[at_origin.reaches([r, 0.0, z], middle) for r in radii] for z in _MAP_HEIGHTS]
    )
    low = np.isin(_MAP_HEIGHTS.round(3), _HEIGHTS)
    near = radii[reached[low].all(axis=0)]
    if not len(near):
        raise ScenarioError(
            f"{arm.path}: its hand reaches no place on the table from above (allowed: "
            "an arm that stands upright on z = 0, with enough joints)"
        )
    places = np.array(list(_places(scenario)))
    base, share = _base(scenario, places, near)
    _write(arm, path, base, middle)
    hand = _Hand(own_scene(load_scenario(path)))
    sights = list(_sights(scenario, places))
    home, sees = _home(hand, base, near, middle, places, sights)
    _write(arm, path, base, home)
    return Placement(base, home, radii, _MAP_HEIGHTS, reached, share, sees)


def _middle(lower: float, upper: float) -> float:
    """Return the middle of a joint's range; 0 if the range is more than a full turn."""
    return 0.0 if upper - lower > 2.0 * np.pi else 0.5 * (lower + upper)


def _write(
    arm: ArmFile, path: Path, base: tuple[float, float, float], home: Vector
) -> None:
    x, y, yaw = base
    text = f"""\
# {arm.path.name}, imported; `drake-srg run` takes this file. Other cells with this
# table and this gripper may be its base, too, such as kitchen_fast.
base: {SCENARIO}

directives:
  arm:
    add_model:
      file: model.sdf
  arm::{BASE}:
    add_weld:
      X_PC:
        translation: [{x:.3f}, {y:.3f}, 0.0]
        rotation: !Rpy {{deg: [0, 0, {np.degrees(yaw):.2f}]}}

arm: !ArmPositionDriver
  home: [{", ".join(f"{value:.4f}" for value in home)}]
  # Null: from inertia and effort limits; see `stiff_gains`.
  kp: null
  kd: null
"""
    path.write_text(text, encoding="utf-8")


def draw_reach(picture: Image, placement: Placement) -> Image:
    """Return a picture of the arm beside a map of the hand's reach.

    On the map, the base is at the lower left; dark squares are within reach.

    Args:
        picture: Picture of the arm, RGB.
        placement: Placement with the map.
    """
    height, side = picture.shape[0], picture.shape[0] // (len(placement.heights) + 2)
    colors = np.array([[235, 235, 235], [60, 110, 170]], np.uint8)
    # Squares have sides of `MAP_STEP`, but heights are two of these apart.
    tall = 2 * len(placement.heights)
    rows = np.repeat(placement.reached[::-1].astype(int), 2, axis=0)
    scale = max(1, min(side // 2, picture.shape[1] // max(rows.shape[1], 1)))
    squares = colors[rows].repeat(scale, axis=0).repeat(scale, axis=1)
    canvas = np.full((height, squares.shape[1] + 60, 3), 255, np.uint8)
    top = (height - tall * scale) // 2
    canvas[top : top + tall * scale, 40 : 40 + squares.shape[1]] = squares
    for text, x, y in (
        (f"{placement.heights[-1]:.2f} m", 2, top + 10),
        (f"{placement.heights[0]:.2f} m", 2, top + tall * scale),
        (f"{placement.radii[0]:.1f} m", 40, top + tall * scale + 16),
        (f"{placement.radii[-1]:.1f} m", squares.shape[1], top + tall * scale + 16),
    ):
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(canvas, text, (x, y), font, 0.32, (60, 60, 60), 1, cv2.LINE_AA)
    return np.hstack([picture, canvas])


class _Hand:
    """The gripper on the arm, with open fingers, pointing down."""

    def __init__(self, scene: PlanningScene) -> None:
        self.scene = scene
        gripper = scene.plant.GetModelInstanceByName("gripper")
        center = scene.plant.GetFrameByName("grasp_center", gripper)
        self._center = center
        self._X_GC = center.CalcPose(scene.context, scene.hand_frame)

    def posture(
        self,
        p_WC: Sequence[float],
        nominal: Vector,
        starts: int = _STARTS,
    ) -> Vector | None:
        """Return a posture without collisions, with the grasp's centre at a place."""
        down = AxisTarget(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), _TILT)
        target = HandTarget(
            np.asarray(p_WC, float), axes=(down,), p_GT=self._X_GC.translation()
        )
        found = find_posture(self.scene, target, q_nominal=nominal, max_starts=starts)
        return None if found is None else found.q

    def reaches(self, p_WC: Sequence[float], nominal: Vector) -> bool:
        """Return whether the hand can point down at a place."""
        return self.posture(p_WC, nominal) is not None

    def score(self, q: Vector, places: Vector) -> float:
        """Return a score of a posture as a home.

        The score is mainly the number of places over which a nearby posture is free of
        collisions. High joints, and distance from limits and singularities, add to it.
        """
        over = [
            self.posture([*xy, height], q, starts=1) is not None
            for xy, height in itertools.product(places, _HEIGHTS)
        ]
        scene = self.scene
        scene.plant.SetPositions(scene.context, scene.positions(q))
        joints = [
            scene.plant.GetJointByName(name, scene.plant.GetModelInstanceByName("arm"))
            for name in scene.joint_names
        ]
        heights = [
            joint.frame_on_child().CalcPoseInWorld(scene.context).translation()[2]
            for joint in joints
        ]
        room = float(np.minimum(q - scene.lower, scene.upper - q).min())
        J = scene.plant.CalcJacobianSpatialVelocity(
            scene.context,
            JacobianWrtVariable.kV,
            self._center,
            np.zeros(3),
            scene.plant.world_frame(),
            scene.plant.world_frame(),
        )[:, scene.arm_indices]
        least = float(np.linalg.svd(J, compute_uv=False)[-1])
        turned = float(np.maximum(np.abs(q) - _FAR, 0.0).sum())
        ease = float(np.mean(heights)) + min(room, 0.5) + 2.0 * min(least, 0.2) - turned
        return float(np.sum(over)) + 0.1 * ease


def _places(scenario: Scenario) -> Iterator[Vector]:
    """Yield places in the task's region, then the goal: x, y in world, (2,) [m]."""
    low, high = scenario.task.region.min, scenario.task.region.max
    rows = [np.linspace(a, b, 3) for a, b in zip(low, high, strict=True)]
    for place in itertools.product(*rows):
        yield np.array(place)
    yield np.array(scenario.task.place.position)


def _base(
    scenario: Scenario, places: Vector, near: Vector
) -> tuple[tuple[float, float, float], float]:
    """Return the base from which most places are well within reach, and their share.

    Args:
        scenario: The scenario with the table.
        places: Places of the task, the goal last, shape (n, 2) [m].
        near: Distances from the base that the hand reaches [m].
    """
    low = np.array(scenario.table.min) + _EDGE
    high = np.array(scenario.table.max) - _EDGE
    grid = (np.arange(a, b, _BASE_STEP) for a, b in zip(low, high, strict=True))

    def score(xy: Sequence[float]) -> tuple[float, float]:
        """Return the share of places within reach, and the margin of reach [m]."""
        distances = np.linalg.norm(places - xy, axis=1)
        if distances.min() < _BASE_ROOM:
            return 0.0, 0.0
        gaps = np.abs(distances[:, None] - near).min(axis=1)
        ends = np.minimum(distances - near[0], near[-1] - distances)
        inside = (gaps < 0.51 * MAP_STEP) & (ends >= 0.0)
        share = float(inside.mean() * inside[-1])  # 0 without the goal
        return share, round(float(np.minimum(ends, MAP_STEP).min()), 3)

    # Among equals, `max` takes the place nearest to that of the kitchen's own arm.
    nearest = sorted(itertools.product(*grid), key=lambda xy: float(np.hypot(*xy)))
    best = max(nearest, key=score)
    x, y = places.mean(axis=0) - best
    base = (float(best[0]), float(best[1]), float(np.arctan2(y, x)))
    return base, score(best)[0]


def _sights(
    scenario: Scenario, places: Vector
) -> Iterator[tuple[Cylinder, RigidTransform]]:
    """Yield the first camera's line of sight to each place, as a cylinder."""
    camera = scenario.cameras[scenario.localizer.cameras[0]]
    p_WC = camera.X_PB.GetDeterministicValue().translation()
    for x, y in places:
        p_WP = np.array([x, y, scenario.table.height + _OBJECT_HEIGHT])
        way = p_WC - p_WP
        length = float(np.linalg.norm(way))
        R = RotationMatrix.MakeFromOneVector(way / length, 2)
        yield Cylinder(_SIGHT, length), RigidTransform(R, 0.5 * (p_WC + p_WP))


def _home(
    hand: _Hand,
    base: tuple[float, float, float],
    near: Vector,
    middle: Vector,
    places: Vector,
    sights: Sequence[tuple[Cylinder, RigidTransform]],
) -> tuple[Vector, bool]:
    """Return a home with the hand down, and whether the camera sees all places."""
    x, y, yaw = base
    radius = near[len(near) // 2]
    scene, random = hand.scene, default_rng(0)
    wide = scene.upper - scene.lower > 2.0 * _FAR
    low, high = np.where(wide, -_FAR, scene.lower), np.where(wide, _FAR, scene.upper)
    starts = [middle, *(random.uniform(low, high) for _ in range(_HOMES))]
    seen: list[tuple[float, Vector]] = []
    hidden: list[tuple[float, Vector]] = []
    for azimuth, height in itertools.product(_AZIMUTHS, (0.45, 0.35, 0.25, 0.15)):
        angle = yaw + azimuth
        p_WC = [x + radius * np.cos(angle), y + radius * np.sin(angle), height]
        found = [hand.posture(p_WC, start) for start in starts]
        for q in [q for q in found if q is not None]:
            blocks = functools.partial(hand.scene.touches, q)
            blocked = any(itertools.starmap(blocks, sights))
            (hidden if blocked else seen).append((hand.score(q, places), q))
        if len(seen) > 2 * _HOMES:
            break
    if not seen and not hidden:
        raise ScenarioError("no home: the hand cannot point down over the table")
    _, home = max(seen or hidden, key=lambda choice: choice[0])
    return home, bool(seen)
