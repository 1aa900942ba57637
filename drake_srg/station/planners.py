"""The planners of a scenario, their models of hands, and their goals.

Gripper drivers know nothing about planning, so this module makes the `Hand` of each,
from the driver's configuration. Register a gripper driver of your own with
`register_gripper`, for scenario files and for the planner.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.framework import DiagramBuilder, System

from drake_srg.arm.driver import AddJerkLimits
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.geometry import Solid
from drake_srg.common.systems import output_ports
from drake_srg.gripper.driver import GripperDriver
from drake_srg.gripper.linkage_driver import LinkageDriver
from drake_srg.gripper.plant_servo_driver import PlantServoDriver
from drake_srg.gripper.srg_position_driver import SrgPositionDriver
from drake_srg.gripper.srg_tendon_driver import SrgTendonDriver
from drake_srg.objects.models import object_shape, simple_shape
from drake_srg.objects.solids import planned_solid
from drake_srg.planning.carrying.config import CarryTogether
from drake_srg.planning.carrying.motions import CarryTaskPlanner, end_walls
from drake_srg.planning.carrying.planner import CarryPlanner
from drake_srg.planning.grasps.grasps import Hand
from drake_srg.planning.grasps.linkage_hand import LinkageFingers, LinkageHand
from drake_srg.planning.grasps.srg_hand import SrgHand
from drake_srg.planning.handover.config import Handover
from drake_srg.planning.handover.motions import GivingHand, HandoverTaskPlanner
from drake_srg.planning.handover.planner import HandoverPlanner
from drake_srg.planning.insertion.config import Insert
from drake_srg.planning.insertion.planner import InsertionPlanner
from drake_srg.planning.motion.arm_pair import ArmPair, PairedArm
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.pick_and_place.planner import PickAndPlacePlanner
from drake_srg.planning.pick_and_place.sightings import (
    PickTask,
    lean,
    set_down_at,
    standing_at,
)
from drake_srg.planning.pick_and_place.task_motions import TaskPlanner
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.scenario.schema import (
    RobotArm,
    Scenario,
    accept_driver,
    robot_arms,
    script_of,
)
from drake_srg.station.plant import Models
from drake_srg.theses.script import Script, ScriptedPlanner
from drake_srg.theses.taught import Taught, TaughtMotions, TaughtPlanner
from drake_srg.types import Cylinder, Sphere, Vector


def goal_pose(scenario: Scenario, shape: Solid) -> RigidTransform:
    """Return the upright pose at which the planner places the object, X_WO [m]."""
    place = scenario.task.place
    height = scenario.table.height if place.height is None else place.height
    below = shape.half_extent(np.array([0.0, 0.0, -1.0]))
    return RigidTransform([*place.position, height + below])


def final_pose(scenario: Scenario, X_WO_start: RigidTransform) -> RigidTransform:
    """Return the pose at which the object must be at the end of a run, X_WO [m].

    With a script, the object keeps its height and orientation. With a planner, only an
    object without a simple shape keeps its orientation; others stand upright. After an
    even number of cycles, the object is back at its start.

    Args:
        scenario: The scenario of the run.
        X_WO_start: Pose at which the object was first found [m].
    """
    pick, place = scenario.task.pick, scenario.task.place
    shape = simple_shape(pick, scenario.objects[pick])
    solid = shape or planned_solid(pick, scenario.objects[pick])
    if script_of(scenario) or solid is None:
        height = X_WO_start.translation()[2]
        return RigidTransform(X_WO_start.rotation(), [*place.position, height])
    if scenario.task.repeat % 2 == 0:
        return X_WO_start if shape is None else standing_at(X_WO_start, shape)
    if shape is None:
        return set_down_at(goal_pose(scenario, solid), X_WO_start, solid)
    return goal_pose(scenario, shape)


def final_tilt(
    scenario: Scenario, X_WO_start: RigidTransform, X_WO: RigidTransform
) -> float | None:
    """Return the angle of the object's axis from its goal [rad]; None for a sphere.

    An object that did not stand at the start may be placed on either end.

    Args:
        scenario: The scenario of the run.
        X_WO_start: Pose at which the object was first found [m].
        X_WO: Pose of the object at the end [m].
    """
    pick = scenario.task.pick
    shape = simple_shape(pick, scenario.objects[pick])
    if isinstance(shape, Sphere):
        return None
    if shape is None:  # turns about the vertical do not count
        up_O, up_O_end = (X.rotation().matrix()[2] for X in (X_WO_start, X_WO))
        sine = float(np.linalg.norm(np.cross(up_O, up_O_end)))
        return float(np.arctan2(sine, up_O @ up_O_end))
    X_WO_goal = final_pose(scenario, X_WO_start)
    goal = X_WO_goal.rotation().col(2)
    axis = X_WO.rotation().col(2)
    tilt = lean(goal, axis)
    stood = goal @ X_WO_start.rotation().col(2) > np.cos(0.25 * np.pi)
    return np.pi - tilt if stood and goal @ axis < 0.0 else tilt


# Makes a Hand from a driver's configuration, the planner's, and a finalized plant of
# the scenario's models with the model instance `gripper`. The Hand must not keep the
# plant or references into it.
HandMaker = Callable[[Any, PlannerConfig, MultibodyPlant], Hand]


def register_gripper(
    driver: type[GripperDriver], make_hand: HandMaker | None = None
) -> None:
    """Make a gripper driver known to scenario files and to the planner.

    Args:
        driver: Class of its configuration; the class name is its tag.
        make_hand: Makes the planner's model of the gripper. With None, it is that of
            the class from which `driver` derives, if there is one.
    """
    accept_driver(driver)
    if make_hand is not None:
        _HANDS[driver] = make_hand


def MakeHand(
    scenario: Scenario, plant: MultibodyPlant, arm: RobotArm | None = None
) -> Hand:
    """Make the planner's model of a scenario's gripper.

    Args:
        scenario: With a gripper.
        plant: A finalized plant of the scenario's models. The Hand does not keep it.
        arm: The arm whose gripper it is; None: the first.

    Raises:
        ScenarioError: If there is no Hand for the gripper's driver.
    """
    arm = arm or robot_arms(scenario)[0]
    for kind in type(arm.gripper).__mro__:
        if kind in _HANDS:
            return _HANDS[kind](arm.gripper, scenario.planner, plant)
    known = ", ".join(f"!{driver.__name__}" for driver in _HANDS)
    raise ScenarioError(
        f"{arm.key}gripper: the planner needs a Hand for !{type(arm.gripper).__name__}:"
        f" give one to register_gripper (allowed: {known})"
    )


def _srg_hand(
    driver: SrgPositionDriver | PlantServoDriver | SrgTendonDriver,
    config: PlannerConfig,
    _: MultibodyPlant,
) -> SrgHand:
    if isinstance(driver, SrgTendonDriver):
        full_scale = driver.spool.full_scale
    else:
        full_scale = driver.underactuation.full_scale
    return SrgHand(
        config.approaches,
        config.tilts,
        config.squeeze,
        full_scale,
        clearance=config.hand_clearance,
        turn_counts=isinstance(config, Insert),
    )


def _linkage_hand(
    driver: LinkageDriver, _: PlannerConfig, plant: MultibodyPlant
) -> LinkageHand:
    gripper = plant.GetModelInstanceByName("gripper")

    def p_GF(name: str) -> Vector:
        frame = plant.GetFrameByName(name, gripper)
        X_GF = frame.GetFixedPoseInBodyFrame()
        return np.array(X_GF.translation())  # a copy, independent of the plant

    def calibrated(name: str, otherwise: Vector) -> Vector:
        return p_GF(name) if plant.HasFrameNamed(name, gripper) else otherwise

    p_GT = calibrated("tip", p_GF("grasp_center"))
    return LinkageHand(
        p_GT,
        calibrated("released", p_GT) - p_GT,
        LinkageFingers(full_scale=driver.master_slave.full_scale),
    )


_HANDS: dict[type[GripperDriver], HandMaker] = {
    SrgPositionDriver: _srg_hand,
    PlantServoDriver: _srg_hand,
    SrgTendonDriver: _srg_hand,
    LinkageDriver: _linkage_hand,
}


def MakePlanner(scenario: Scenario, **own: Any) -> PickAndPlacePlanner:
    """Make the planner of a scenario's task.

    Args:
        scenario: The scenario.
        own: Arguments of `PickAndPlacePlanner` in place of the scenario's, such as
            `make_modes` and `transition`.
    """
    arguments = {
        "task_planner": MakeTaskPlanner(scenario),
        "task": pick_task(scenario),
        "config": scenario.planner,
    }
    return PickAndPlacePlanner(**{**arguments, **own})


def MakeInsertionPlanner(scenario: Scenario) -> InsertionPlanner:
    """Make the planner that inserts the peg of a scenario's task."""
    config = scenario.planner
    assert isinstance(config, Insert)
    return InsertionPlanner(MakeTaskPlanner(scenario), pick_task(scenario), config)


def pick_task(scenario: Scenario) -> PickTask:
    """Return the object that a scenario's planner takes, and its goal."""
    name, place = scenario.task.pick, scenario.task.place
    config = scenario.objects[name]
    shape = planned_solid(name, config)
    if shape is None and config.known and config.soft is None:
        raise ScenarioError(
            f"objects.{name}.color_range: must be given for {config.model}, which is "
            "no single cylinder, box or sphere, to be localized and planned with"
        )
    shape = shape or object_shape(name, config)
    obstacles = {
        other: known
        for other, config in scenario.objects.items()
        if other != name and (known := planned_solid(other, config)) is not None
    }
    goal, repeat = goal_pose(scenario, shape), scenario.task.repeat
    return PickTask(name, shape, goal, place.tolerance, obstacles, repeat)


def MakeScriptedPlanner(scenario: Scenario) -> System:
    """Make the planner that plays a scenario's script, `task.repeat` times.

    It is a `ScriptedPlanner`. If the script consists of messages, it is a diagram of a
    `ScriptedPlanner` and an `arm_reference`, which turns the arm's targets into motion.
    """
    assert scenario.arm is not None
    home = np.array(scenario.arm.home)
    assert isinstance(scenario.planner, Script)
    script = scenario.task.repeat * scenario.planner.steps
    if scenario.planner.messages is None:
        return ScriptedPlanner(home, script)
    builder = DiagramBuilder()
    messages = builder.AddNamedSystem(
        "messages", ScriptedPlanner(home, script, jumps=True)
    )
    reference = AddJerkLimits(builder, scenario.arm)
    position = "position_commanded"
    builder.Connect(
        messages.GetOutputPort(position), reference.GetInputPort("position_desired")
    )
    builder.ExportOutput(reference.get_output_port(), position)
    for name, port in output_ports(messages).items():
        if name != position:
            builder.ExportOutput(port, name)
    return builder.Build()


def MakeTaughtPlanner(scenario: Scenario) -> TaughtPlanner:
    """Make the planner that moves through a scenario's taught waypoints."""
    return TaughtPlanner(MakeTaughtMotions(scenario), scenario.task.pick)


def MakeTaughtMotions(scenario: Scenario) -> TaughtMotions:
    """Make the planner of the motions through a scenario's taught waypoints."""
    assert isinstance(scenario.planner, Taught)
    assert scenario.arm is not None
    scene = own_scene(scenario)
    moves = Moves(scene, MakeHand(scenario, scene.plant).p_GT, scenario.planner)
    return TaughtMotions(scene, moves, np.array(scenario.arm.home), scenario.planner)


def MakeTaskPlanner(scenario: Scenario, arm: RobotArm | None = None) -> TaskPlanner:
    """Make the planner of motions, with its own model of arm and furniture.

    Args:
        scenario: The scenario.
        arm: The arm that moves; None: the first. Others are obstacles to it.
    """
    arm = arm or robot_arms(scenario)[0]
    scene = own_scene(scenario, arm)
    assert arm.arm is not None
    hand = MakeHand(scenario, scene.plant, arm)
    return TaskPlanner(scene, hand, np.array(arm.arm.home), scenario.planner)


def own_scene(scenario: Scenario, arm: RobotArm | None = None) -> PlanningScene:
    """Return a planner's own model of arm and furniture.

    Args:
        scenario: The scenario.
        arm: The arm that moves; None: the first. Others are obstacles to it.
    """
    arm, config = arm or robot_arms(scenario)[0], scenario.planner
    margins = config.clearance, config.hand_clearance, config.payload
    names = arm.arm_model, arm.gripper_model
    return _planning_scene(Models.of(scenario), names, *margins).copy()


@functools.lru_cache(maxsize=2)
def _planning_scene(
    models: Models,
    names: tuple[str, str],
    margin: float,
    hand_margin: float,
    payload: float,
) -> PlanningScene:
    """Return the planner's model. It is cached, so use only copies."""
    builder = RobotDiagramBuilder(time_step=0.0)
    models.add_to(builder.plant())
    arm, gripper = names
    return PlanningScene(
        builder,
        arm=arm,
        gripper=gripper,
        margin=margin,
        hand_margin=hand_margin,
        payload=payload,
    )


def MakeHandoverPlanner(scenario: Scenario) -> HandoverPlanner:
    """Make the planner of two arms that hand over the object of a scenario's task.

    Raises:
        ScenarioError: If the object is no cylinder.
    """
    config = scenario.planner
    assert isinstance(config, Handover)
    arms = {arm.name: arm for arm in robot_arms(scenario)}
    giver, receiver = arms[config.giver], arms[config.receiver]
    plans = MakeTaskPlanner(scenario, giver)
    receives = MakeTaskPlanner(scenario, receiver)
    task = pick_task(scenario)
    if not isinstance(task.shape, Cylinder):
        raise ScenarioError(
            f"objects.{scenario.task.pick}: must be a cylinder to be handed over, got "
            f"{task.shape}"
        )
    motions = HandoverTaskPlanner(
        plans.scene,
        GivingHand(plans.hand),
        plans.q_home,
        config,
        receives,
        _pair((giver, receiver), (plans, receives)),
    )
    return HandoverPlanner(motions, task, config)


def MakeCarryPlanner(scenario: Scenario) -> CarryPlanner:
    """Make the planner of two arms that carry the object of a scenario's task.

    Raises:
        ScenarioError: If the object has no end walls for two hands, or fits into one.
    """
    config, name = scenario.planner, scenario.task.pick
    assert isinstance(config, CarryTogether)
    by_name = {arm.name: arm for arm in robot_arms(scenario)}
    arms = by_name[config.first], by_name[config.second]
    plans = MakeTaskPlanner(scenario, arms[0]), MakeTaskPlanner(scenario, arms[1])
    task = pick_task(scenario)
    shape, hand = task.shape, plans[0].hand
    walls = end_walls(shape)
    if walls is None:
        raise ScenarioError(
            f"objects.{name}: must be a model with two end walls, equally thick and as "
            f"high as itself, to be carried by two hands, got {shape} (allowed: such "
            "as package://drake_srg/sdf/crate.sdf)"
        )
    for arm, plan in zip(arms, plans, strict=True):
        if any(not wall.grasps(plan.hand) for wall in walls):
            thick = 1e3 * walls[0].box.size[0]
            raise ScenarioError(
                f"{arm.key}gripper: cannot grasp an end wall of objects.{name}, "
                f"{thick:g} mm thick, from above"
            )
    narrow = float(min(shape.bounding_size[:2]))
    most = hand.pinch.max_width if hand.pinch else 0.0
    if narrow <= most:
        raise ScenarioError(
            f"objects.{name}: must be wider than one hand opens ({1e3 * most:.0f} mm) "
            f"with planner: !CarryTogether, got {1e3 * narrow:.0f} mm (use "
            "!PickAndPlace)"
        )
    motions = CarryTaskPlanner(plans, _pair(arms, plans), config)
    return CarryPlanner(motions, task, config)


def _pair(
    arms: tuple[RobotArm, RobotArm], plans: tuple[TaskPlanner, TaskPlanner]
) -> ArmPair:
    first, second = (
        PairedArm(arm.name, arm.arm_model, arm.gripper_model, plan.scene)
        for arm, plan in zip(arms, plans, strict=True)
    )
    return ArmPair(first, second)
