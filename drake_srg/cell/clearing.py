"""The parts of a cell that clears its table: height mapper, bins and planner."""

from __future__ import annotations

import functools
from collections.abc import Iterable

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.cell.choosing import chooses, labels, row_places
from drake_srg.cell.hands import MakeHand
from drake_srg.cell.perception import camera_models
from drake_srg.cell.planners import own_scene
from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.corners import body_corners
from drake_srg.planning.clearing.choosing import ChoosingPlanner, ChosenGrasps
from drake_srg.planning.clearing.clearing_motions import ClearingMotions
from drake_srg.planning.clearing.clearing_planner import ClearingPlanner
from drake_srg.planning.clearing.picking import PickPlanner
from drake_srg.planning.clearing.push_motions import PushMotions
from drake_srg.planning.clearing.reach import reach_with_hand_down
from drake_srg.planning.clearing.row_motions import RowMotions
from drake_srg.planning.grasps.grasps import Hand
from drake_srg.planning.grasps.height_map_grasps import HeightMapGrasps
from drake_srg.planning.grasps.top_grasp import palm_pose
from drake_srg.planning.motion.hand_target import HandTarget
from drake_srg.planning.motion.inverse_kinematics import (
    IkFailure,
    IkSolution,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.scenario import Scenario
from drake_srg.station.plant import Models
from drake_srg.types import Vector
from drake_srg.vision.config import HeightMapConfig
from drake_srg.vision.height_mapper import HeightMapper
from drake_srg.vision.surface import Surface

# Height of the fingers' ends above the table where the arm's reach counts [m].
_TIPS = 0.02
# The map leaves out the bin and as much around it, for errors of the map [m].
_AROUND_BIN = 0.006
_ANY_YAW = tuple(np.linspace(-np.pi, np.pi, 8, endpoint=False))
_AROUND_ROW = 0.08  # and this much around the middles of a row [m]
# Height of the palm above the bin's rim before the hand goes down to let go [m].
_OVER = 0.44
# Distance between the bin's middle and other places to let go, a share of its length.
_ASIDE = 0.22
# A bin's rim is at least that high above the table [m].
_LEAST_RIM = 0.02


def AddHeightMapper(
    builder: DiagramBuilder, scenario: Scenario, station: Diagram
) -> HeightMapper:
    """Add the height mapper of a scenario and connect it to the station's cameras."""
    clear = scenario.task.clear
    assert clear is not None
    low, high = clear.region.min, clear.region.max
    surface = Surface((low[0], low[1]), (high[0], high[1]), scenario.table.height)
    cameras = camera_models(scenario)
    taken = [(*box, _AROUND_BIN) for box in bin_boxes(scenario).values()]
    if row := list(row_places(scenario).values()):
        taken.append((np.min(row, axis=0), np.max(row, axis=0), _AROUND_ROW))
    ignored = []
    for corner, opposite, around in taken:
        (x0, y0), (x1, y1) = corner[:2] - around, opposite[:2] + around
        ignored.append(Surface((x0, y0), (x1, y1), surface.height))
    # The planner looks with the arm out of the way.
    config = HeightMapConfig(over_edge=True)
    mapper = HeightMapper(cameras, surface, ignored=ignored, config=config)
    builder.AddNamedSystem("height_mapper", mapper)
    for name in cameras:
        for port in ("depth_image", "body_pose_in_world"):
            source = station.GetOutputPort(f"camera_{name}.{port}")
            builder.Connect(source, mapper.GetInputPort(f"{name}.{port}"))
    return mapper


def MakeClearingPlanner(scenario: Scenario) -> ClearingPlanner:
    """Make the planner that clears a scenario's table into its bins.

    Raises:
        ScenarioError: If the gripper does not pinch from above, the arm does not reach
            over a bin, or a bin has no collision geometry or is no bin.
    """
    assert scenario.task.clear is not None
    config, table = scenario.planner, scenario.table.height
    scene = own_scene(scenario)
    hand = MakeHand(scenario, scene.plant)
    if hand.pinch is None:
        driver = type(scenario.gripper).__name__
        raise ScenarioError(
            f"gripper: must pinch from above with task.pick all, which the hand of "
            f"!{driver} does not"
        )
    into = _motions(scene, hand, scenario)
    region = scenario.task.clear.region
    middle = 0.5 * (np.array(region.min) + region.max)
    p_WG = np.array([*middle, table + _TIPS + hand.pinch.deepest])
    q_over = into[0].q_over
    reach = reach_with_hand_down(scene, q_over, p_WG)
    choosing = chooses(scenario)
    kind = ChosenGrasps if choosing else HeightMapGrasps
    grasps = kind(hand.pinch, table, reach=reach)
    if choosing:
        found = labels(scenario)
        planner: PickPlanner = ChoosingPlanner(
            grasps,
            into,
            [label.name for label in found],
            [label.named for label in found],
            table,
            config,
        )
    else:  # then nothing needs to stay where it is, and heaps may be pushed
        pushes = PushMotions(
            scene,
            Moves(scene, hand.p_GT, config),
            q_over,
            fingers=hand.pinch,
            table=table,
            reach=reach,
            relief=grasps.relief,
        )
        planner = PickPlanner(grasps, into[0], config, pushes)
    return ClearingPlanner(planner, hand.num_joints, hand.num_sensors)


def _motions(
    scene: PlanningScene, hand: Hand, scenario: Scenario
) -> list[ClearingMotions]:
    """Return the motions to where each label belongs.

    Raises:
        ScenarioError: If the arm does not reach over a bin or the row.
    """
    place = scenario.task.place
    if place.row is None:
        into = {
            name: _motions_to(name, box, scene, hand, scenario)
            for name, box in bin_boxes(scenario).items()
        }
        return [into[label.bin] for label in labels(scenario)]
    assert scenario.arm is not None
    q_home, places = np.array(scenario.arm.home), list(row_places(scenario).values())
    over: Vector = np.mean(places, axis=0)
    over[2] += _OVER
    across = place.row.direction + 0.5 * np.pi
    try:
        q_over = _posture_over(scene, q_home, over, [across, across + np.pi])
    except ScenarioError as error:
        raise ScenarioError(f"task.place.row: {error}") from None
    moves = Moves(scene, hand.p_GT, scenario.planner)
    return [
        RowMotions(
            scene,
            moves,
            q_home,
            q_over,
            table=scenario.table.height,
            place=p_WO,
            config=scenario.planner,
        )
        for p_WO in places
    ]


def _motions_to(
    name: str,
    box: tuple[Vector, Vector],
    scene: PlanningScene,
    hand: Hand,
    scenario: Scenario,
) -> ClearingMotions:
    """Return the motions into a bin between two corners of `box` [m].

    Raises:
        ScenarioError: If the arm does not reach over the bin.
    """
    assert scenario.arm is not None
    low, high = box
    size = (high - low)[:2]
    q_home = np.array(scenario.arm.home)
    p_WO = np.array([*(0.5 * (low + high))[:2], high[2] + _OVER])
    try:
        q_over = _posture_over(scene, q_home, p_WO)
    except ScenarioError as error:
        raise ScenarioError(f"{_key(scenario, name)}: {error}") from None
    return ClearingMotions(
        scene,
        Moves(scene, hand.p_GT, scenario.planner),
        q_home,
        q_over,
        table=scenario.table.height,
        rim=float(high[2]),
        aside=_ASIDE * np.where(size == size.max(), size, 0.0),
        config=scenario.planner,
    )


def _posture_over(
    scene: PlanningScene,
    q_home: Vector,
    p_WO: Vector,
    yaws: Iterable[float] = _ANY_YAW,
) -> Vector:
    """Return the posture nearest to home with the hand down over the bin, (N,) [rad].

    Args:
        scene: The arm and the bin.
        q_home: The arm's home, shape (N,) [rad].
        p_WO: Where the palm must be, shape (3,) [m].
        yaws: Directions in which the fingers may close, from the world's x [rad].

    Raises:
        ScenarioError: If there is none.
    """
    scene.SetFingers({})
    found = [
        solve_inverse_kinematics(
            scene,
            HandTarget.from_pose(palm_pose(p_WO, yaw)),
            q_nominal=q_home,
        )
        for yaw in yaws
    ]
    solved = [ik for ik in found if isinstance(ik, IkSolution)]
    if solved:
        return min(solved, key=lambda ik: ik.cost).q
    failed = [ik for ik in found if isinstance(ik, IkFailure)]
    reason = min(failed, key=lambda ik: ik.violation).message
    raise ScenarioError(f"out of reach: {reason}")


def bin_boxes(scenario: Scenario) -> dict[str, tuple[Vector, Vector]]:
    """Return the least and greatest corner of each bin by name, in world, (3,) [m].

    Raises:
        ScenarioError: If a model has no collision geometry, or does not rise above the
            table.
    """
    models = Models.of(scenario)
    boxes = {}
    for name in scenario.task.place.bins:
        try:
            boxes[name] = _bin_box(models, name)
        except ScenarioError as error:
            raise ScenarioError(f"{_key(scenario, name)}: {error}") from None
        rise = boxes[name][1][2] - scenario.table.height
        if rise < _LEAST_RIM:
            raise ScenarioError(
                f"{_key(scenario, name)}: {name!r} is no bin: it must rise at least "
                f"{_LEAST_RIM} m above the table, got {rise:.3f} m"
            )
    return boxes


def _key(scenario: Scenario, name: str) -> str:
    """Return the key that names a bin, for messages."""
    return "task.place.bin" if scenario.task.place.bin else f"task.place.bins.{name}"


@functools.lru_cache(maxsize=4)
def _bin_box(models: Models, name: str) -> tuple[Vector, Vector]:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    models.add_to(plant)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    inspector = scene_graph.model_inspector()
    corners = [np.zeros((0, 3))]
    for index in plant.GetBodyIndices(plant.GetModelInstanceByName(name)):
        body = plant.get_body(index)
        X_WB: RigidTransform = plant.EvalBodyPoseInWorld(context, body)
        if plant.GetCollisionGeometriesForBody(body):
            corners.append((X_WB @ body_corners(plant, inspector, body).T).T)
    points = np.concatenate(corners)
    if not len(points):
        raise ScenarioError(f"{name!r} has no collision geometry")
    return points.min(axis=0), points.max(axis=0)
