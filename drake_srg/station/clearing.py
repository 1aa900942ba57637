"""The planner of a cell that clears its table."""

from __future__ import annotations

import dataclasses as dc
import functools
import itertools
from collections.abc import Iterable

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.systems import export_outputs, input_ports, output_ports
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
from drake_srg.planning.clearing.sharing import (
    JointStatus,
    SharingPickPlanner,
    SharingPlanner,
)
from drake_srg.planning.clearing.walls import (
    BEYOND,
    HALF,
    SIDE,
    Frontier,
    Wall,
    WalledMotions,
)
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
from drake_srg.scenario import Scenario, robot_arms
from drake_srg.station.perception import (
    bin_boxes,
    bin_floor,
    bin_key,
    labels,
    needs_labels,
    row_places,
)
from drake_srg.station.planners import MakeHand, own_scene
from drake_srg.types import Vector

# Height of the fingertips above the table at which the arm's reach is computed [m].
_TIPS = 0.02
_ANY_YAW = tuple(np.linspace(-np.pi, np.pi, 8, endpoint=False))
# Height of the palm above the bin's rim before the hand descends to release a load [m].
_OVER = 0.44


def without_cut_corners(scenario: Scenario) -> Scenario:
    """Return a scenario whose arm rests between any two motions.

    Otherwise, the arm is still moving when one motion ends, so the next must not begin
    late.
    """
    planner = dc.replace(scenario.planner, cut_corners=False)
    return dc.replace(scenario, planner=planner)


def MakeClearingPlanner(scenario: Scenario) -> ClearingPlanner:
    """Make the planner that clears a scenario's table into its bins.

    Raises:
        ScenarioError: If the gripper does not pinch from above, the arm does not reach
            over a bin, or a bin has no collision geometry or is too low.
    """
    # A safety monitor may slow or stop the arm at any time.
    if robot_arms(scenario)[0].safety is not None:
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
    choosing = needs_labels(scenario)
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
    else:  # nothing needs to stay where it is, so heaps may be pushed
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


def shares_of(scenario: Scenario) -> dict[str, tuple[Scenario, Frontier | None]]:
    """Return the share of work and the side of each of one or two arms, by name.

    An arm's share is a scenario with this arm alone, the bin and the cameras on its
    side, and all objects. A single arm gets the whole scenario, and None as its side.

    Raises:
        ScenarioError: If a side has no camera, or does not have exactly one bin, at
            least `SIDE` from the plane between the arms.
    """
    arms, boxes = robot_arms(scenario), bin_boxes(scenario)
    if len(arms) == 1:
        return {arms[0].name: (scenario, None)}
    bases = [own_scene(scenario, arm).p_WA for arm in arms]
    place, localizer = scenario.task.place, scenario.localizer
    shares: dict[str, tuple[Scenario, Frontier | None]] = {}
    for arm, base, other in zip(arms, bases, bases[::-1], strict=True):
        side = Frontier.between(base, other)
        own = [
            n for n, box in boxes.items() if side.depth(0.5 * (box[0] + box[1])) > 0.0
        ]
        if len(own) != 1:
            raise ScenarioError(
                f"task.place.bins: must have one bin on the side of arm {arm.name!r}, "
                f"got {', '.join(own) or 'none'}"
            )
        x, y = np.array(boxes[own[0]])[:, :2].T
        corners = np.array([[a, b] for a in x for b in y])
        if (depth := float(side.depth(corners).min())) < SIDE:
            raise ScenarioError(
                f"{bin_key(scenario, own[0])}: {own[0]!r} must be at least "
                f"{SIDE:g} m from the middle between the arms, got {depth:.3f}"
            )
        cameras = {
            name for name in scenario.cameras if _hangs_over(scenario, name, side)
        }
        look = [name for name in localizer.cameras if name in cameras]
        if not look:
            raise ScenarioError(
                "localizer.cameras: must have one that is fixed on the side of arm "
                f"{arm.name!r}, got {', '.join(localizer.cameras) or 'none'}"
            )
        into = dc.replace(
            place,
            bin=own[0],
            bins={own[0]: place.bins[own[0]]},
            cameras=[name for name in place.cameras if name in cameras],
        )
        share = dc.replace(
            scenario,
            arms={arm.name: scenario.arms[arm.name]},
            task=dc.replace(scenario.task, place=into),
            localizer=dc.replace(localizer, cameras=look),
        )
        shares[arm.name] = share, side
    return shares


def _hangs_over(scenario: Scenario, camera: str, side: Frontier) -> bool:
    X_PB = scenario.cameras[camera].X_PB
    fixed = X_PB.base_frame in (None, "world")
    return fixed and bool(side.depth(np.ravel(X_PB.translation)) > 0.0)


def MakeClearingPair(scenario: Scenario) -> Diagram:
    """Make the planners of one or two `arms` that clear one table, as one system.

    .. pydrake_system::

        name: ClearingPair
        input_ports:
        - ARM.height_map
        - ARM.destination_map
        - ARM.arm_state
        - ARM.gripper_state
        - ARM.grasped
        - ARM.proximity
        output_ports:
        - ARM.position_commanded
        - ARM.closure_commanded
        - ARM.mode
        - mode
        - status

    ARM stands for the name of each arm. The planners of two arms are `SharingPlanner`s.
    `mode` and `status` describe both arms; see `JointStatus`.

    Raises:
        ScenarioError: As `shares_of` and `MakeClearingPlanner` do, or if an arm's home
            is not on its own side.
    """
    builder, shares = DiagramBuilder(), shares_of(scenario)
    planners = {
        name: builder.AddNamedSystem(
            name,
            _MakeSharingPlanner(share, side, first=name == next(iter(shares)))
            if side
            else MakeClearingPlanner(share),
        )
        for name, (share, side) in shares.items()
    }
    joint = builder.AddNamedSystem("joint_status", JointStatus(list(planners)))
    claims, others = "claim", "other_claim"
    for name, other in itertools.permutations(planners, 2):
        builder.Connect(
            planners[other].GetOutputPort(claims), planners[name].GetInputPort(others)
        )
    for name, planner in planners.items():
        builder.Connect(
            planner.GetOutputPort("status"), joint.GetInputPort(f"{name}.status")
        )
        for port, source in input_ports(planner).items():
            if port != others:
                builder.ExportInput(source, f"{name}.{port}")
        for port, source in output_ports(planner).items():
            if port not in (claims, "status"):
                builder.ExportOutput(source, f"{name}.{port}")
    export_outputs(builder, joint)
    return builder.Build()


def _MakeSharingPlanner(
    scenario: Scenario, side: Frontier, *, first: bool
) -> SharingPlanner:
    (arm,) = robot_arms(scenario)
    if arm.safety is not None:
        scenario = without_cut_corners(scenario)
    ((name, box),) = bin_boxes(scenario).items()
    motions = []
    for depth in (SIDE, HALF, BEYOND):
        scene, wall = own_scene(scenario), Wall(side, depth)
        wall.AddTo(scene)
        hand, fingers = _pinching_hand(scene, scenario)
        q_home = _home(scenario)
        if not scene.is_free(q_home):
            raise ScenarioError(
                f"{arm.key}arm.home: must be free, and on the arm's own side, got: "
                f"{scene.clearance(q_home)}"
            )
        made = _motions_to(name, box, scene, hand, scenario, wall)
        assert isinstance(made, WalledMotions)
        motions.append(made)
    own = motions[0]
    reach = _reach(own.scene, fingers, own.q_over, scenario)
    q_aside = posture_aside(own.scene, own.q_over, [own.destination.middle])
    grasps = HeightMapGrasps(fingers, scenario.table.height, reach=reach)
    planner = SharingPickPlanner(
        grasps, motions, scenario.planner, q_aside, first=first
    )
    return SharingPlanner(planner, hand.num_joints, hand.num_sensors)


def MakeReach(scenario: Scenario) -> Reach:
    """Return the region in which the hand reaches the table, pointing down.

    Raises:
        ScenarioError: As `MakeClearingPlanner` does, or if the hand does not reach the
            table in the middle of `task.clear.region`.
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
    """Return the motions to the destination of each label.

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
    q_home, places = _home(scenario), list(row_places(scenario).values())
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


def _home(scenario: Scenario) -> Vector:
    arm = robot_arms(scenario)[0].arm
    assert arm is not None
    return np.array(arm.home)


def _motions_to(
    name: str,
    box: tuple[Vector, Vector],
    scene: PlanningScene,
    hand: Hand,
    scenario: Scenario,
    wall: Wall | None = None,
) -> BinMotions:
    """Return the motions into a bin, whose least and greatest corner are `box` [m].

    Raises:
        ScenarioError: If the arm does not reach over the bin.
    """
    low, high = box
    size = (high - low)[:2]
    q_home = _home(scenario)
    p_WO = np.array([*(0.5 * (low + high))[:2], high[2] + _OVER])
    # Long loads are held across the closing direction, and so lie along the bin, if the
    # arm reaches that posture.
    along = 0.0 if size[0] < size[1] else 0.5 * np.pi
    try:
        q_over = _posture_over(scene, q_home, p_WO, [along, along + np.pi], _ANY_YAW)
    except ScenarioError as error:
        raise ScenarioError(f"{bin_key(scenario, name)}: {error}") from None
    make = BinMotions if wall is None else functools.partial(WalledMotions, wall)
    return make(
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
        p_WO: Position of the palm, shape (3,) [m].
        *yaws: Groups of directions in which the fingers may close, from the world's x
            [rad]. A group counts only if the arm reaches none of the earlier ones.

    Raises:
        ScenarioError: If there is no such posture.
    """
    scene.SetFingers({})
    for group in yaws:
        found = [
            solve_inverse_kinematics(
                scene,
                HandTarget.from_pose(palm_pose(p_WO, yaw)),
                q_nominal=q_home,
            )
            for yaw in group
        ]
        solved = [ik for ik in found if isinstance(ik, IkSolution)]
        if solved:
            return min(solved, key=lambda ik: ik.cost).q
    failed = [ik for ik in found if isinstance(ik, IkFailure)]
    reason = min(failed, key=lambda ik: ik.violation).message
    raise ScenarioError(f"out of reach: {reason}")
