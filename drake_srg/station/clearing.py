"""The planner of a cell that clears its table."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.clearing.choosing import (
    ChoosingPlanner,
    ChosenGrasps,
    PickPlanner,
)
from drake_srg.planning.clearing.clearing_planner import ClearingPlanner
from drake_srg.planning.clearing.destination import Destination
from drake_srg.planning.clearing.motions import (
    ClearingMotions,
    posture_aside,
    reach_with_hand_down,
)
from drake_srg.planning.clearing.placing import BinMotions, RowMotions, row_destination
from drake_srg.planning.clearing.pushing import PushMotions
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.grasps import Hand
from drake_srg.planning.grasps.top_grasps import HeightMapGrasps, Reach, palm_pose
from drake_srg.planning.motion.inverse_kinematics import (
    HandTarget,
    IkFailure,
    IkSolution,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.scenario import Scenario
from drake_srg.station.perception import (
    bin_boxes,
    bin_floor,
    bin_key,
    chooses,
    labels,
    row_places,
)
from drake_srg.station.planners import MakeHand, own_scene
from drake_srg.types import Vector

# Height of the fingers' ends above the table where the arm's reach counts [m].
_TIPS = 0.02
_ANY_YAW = tuple(np.linspace(-np.pi, np.pi, 8, endpoint=False))
# Height of the palm above the bin's rim before the hand goes down to let go [m].
_OVER = 0.44


def without_cut_corners(scenario: Scenario) -> Scenario:
    """Return a scenario whose arm rests between any two motions.

    A motion that begins late would not begin where the one before has ended at speed.
    """
    planner = dc.replace(scenario.planner, cut_corners=False)
    return dc.replace(scenario, planner=planner)


def MakeClearingPlanner(scenario: Scenario) -> ClearingPlanner:
    """Make the planner that clears a scenario's table into its bins.

    Raises:
        ScenarioError: If the gripper does not pinch from above, the arm does not reach
            over a bin, or a bin has no collision geometry or is no bin.
    """
    if scenario.safety is not None:  # the monitor may slow or stop the arm at any time
        scenario = without_cut_corners(scenario)
    assert scenario.task.clear is not None
    config, table = scenario.planner, scenario.table.height
    scene = own_scene(scenario)
    hand, fingers = _pinching_hand(scene, scenario)
    into = _motions(scene, hand, scenario)
    q_over = into[0].q_over
    reach = _reach(scene, fingers, q_over, scenario)
    places = [motions.destination.middle for motions in into]
    q_aside = posture_aside(scene, q_over, places)
    choosing = chooses(scenario)
    kind = ChosenGrasps if choosing else HeightMapGrasps
    grasps = kind(fingers, table, reach=reach)
    if choosing:
        found = labels(scenario)
        planner: PickPlanner = ChoosingPlanner(
            grasps,
            into,
            [label.name for label in found],
            [label.named for label in found],
            table,
            config,
            q_aside,
        )
    else:  # then nothing needs to stay where it is, and heaps may be pushed
        pushes = PushMotions(
            scene,
            Moves(scene, hand.p_GT, config),
            q_over,
            fingers=fingers,
            table=table,
            reach=reach,
            segment=grasps.segment,
            period=config.period if config.cut_corners else None,
        )
        planner = PickPlanner(grasps, into[0], config, pushes, q_aside)
    return ClearingPlanner(planner, hand.num_joints, hand.num_sensors)


def MakeReach(scenario: Scenario) -> Reach:
    """Return where a scenario's hand can point down with its tips on the table.

    Raises:
        ScenarioError: As `MakeClearingPlanner` does, or if the hand cannot in the
            middle of `task.clear.region`.
    """
    scene = own_scene(scenario)
    hand, fingers = _pinching_hand(scene, scenario)
    q_over = _motions(scene, hand, scenario)[0].q_over
    reach = _reach(scene, fingers, q_over, scenario)
    if reach is None:
        raise ScenarioError(
            "task.clear.region: the hand must reach down to the table in its middle"
        )
    return reach


def _pinching_hand(scene: PlanningScene, scenario: Scenario) -> tuple[Hand, Fingers]:
    """Return the planner's model of the gripper, and of its fingers in pinches.

    Raises:
        ScenarioError: If the gripper does not pinch from above.
    """
    hand = MakeHand(scenario, scene.plant)
    if hand.pinch is None:
        driver = type(scenario.gripper).__name__
        raise ScenarioError(
            f"gripper: must pinch from above with task.pick all, which the hand of "
            f"!{driver} does not"
        )
    return hand, hand.pinch


def _reach(
    scene: PlanningScene, fingers: Fingers, q_over: Vector, scenario: Scenario
) -> Reach | None:
    assert scenario.task.clear is not None
    region, table = scenario.task.clear.region, scenario.table.height
    middle = 0.5 * (np.array(region.min) + region.max)
    p_WG = np.array([*middle, table + _TIPS + fingers.deepest])
    return reach_with_hand_down(scene, q_over, p_WG)


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
            destination=row_destination(p_WO),
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
) -> BinMotions:
    """Return the motions into a bin between two corners of `box` [m].

    Raises:
        ScenarioError: If the arm does not reach over the bin.
    """
    assert scenario.arm is not None
    low, high = box
    size = (high - low)[:2]
    q_home = np.array(scenario.arm.home)
    p_WO = np.array([*(0.5 * (low + high))[:2], high[2] + _OVER])
    # Long loads lie across the direction of closing: along the bin, if the arm can.
    along = 0.0 if size[0] < size[1] else 0.5 * np.pi
    try:
        q_over = _posture_over(scene, q_home, p_WO, [along, along + np.pi], _ANY_YAW)
    except ScenarioError as error:
        raise ScenarioError(f"{bin_key(scenario, name)}: {error}") from None
    return BinMotions(
        scene,
        Moves(scene, hand.p_GT, scenario.planner),
        q_home,
        q_over,
        destination=Destination(
            low[:2], high[:2], rim=float(high[2]), floor=bin_floor(scenario, name)
        ),
        table=scenario.table.height,
        config=scenario.planner,
    )


def _posture_over(
    scene: PlanningScene,
    q_home: Vector,
    p_WO: Vector,
    *yaws: Iterable[float],
) -> Vector:
    """Return the posture nearest to home with the hand down over a place, (N,) [rad].

    Args:
        scene: The arm, and what stands around it.
        q_home: The arm's home, shape (N,) [rad].
        p_WO: Where the palm must be, shape (3,) [m].
        *yaws: Directions in which the fingers may close, from the world's x [rad];
            later ones only where the arm cannot do any of the earlier ones.

    Raises:
        ScenarioError: If there is none.
    """
    scene.SetFingers({})
    for some in yaws:
        found = [
            solve_inverse_kinematics(
                scene,
                HandTarget.from_pose(palm_pose(p_WO, yaw)),
                q_nominal=q_home,
            )
            for yaw in some
        ]
        solved = [ik for ik in found if isinstance(ik, IkSolution)]
        if solved:
            return min(solved, key=lambda ik: ik.cost).q
    failed = [ik for ik in found if isinstance(ik, IkFailure)]
    reason = min(failed, key=lambda ik: ik.violation).message
    raise ScenarioError(f"out of reach: {reason}")
