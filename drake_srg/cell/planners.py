"""Planners of a scenario, for its task or for its script."""

import functools
from typing import Any

import numpy as np
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.framework import DiagramBuilder, System

from drake_srg.arm.driver import AddJerkLimits
from drake_srg.cell.goals import goal_pose
from drake_srg.cell.hands import MakeHand
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.ports import output_ports
from drake_srg.objects.models import object_shape
from drake_srg.objects.solids import planned_solid
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.script.scripted import Script, ScriptedPlanner
from drake_srg.planning.task.pick_and_place import PickAndPlacePlanner
from drake_srg.planning.task.task_motions import TaskPlanner
from drake_srg.planning.taught.taught_planner import (
    Taught,
    TaughtMotions,
    TaughtPlanner,
)
from drake_srg.scenario import Scenario
from drake_srg.station.plant import Models


def MakePlanner(scenario: Scenario) -> PickAndPlacePlanner:
    """Make the planner of a scenario's task."""
    return PickAndPlacePlanner(**planner_arguments(scenario))


def planner_arguments(scenario: Scenario) -> dict[str, Any]:
    """Return the arguments of a scenario's `PickAndPlacePlanner` by name."""
    name, place = scenario.task.pick, scenario.task.place
    config = scenario.objects[name]
    shape = planned_solid(name, config)
    if shape is None and config.known and config.soft is None:
        raise ScenarioError(
            f"objects.{name}.color_range: must be given for {config.model}, which is "
            "no single cylinder, box or sphere, to be localized and planned with"
        )
    shape = shape or object_shape(name, config)
    return {
        "task_planner": MakeTaskPlanner(scenario),
        "object_name": name,
        "shape": shape,
        "goal": goal_pose(scenario, shape),
        "tolerance": place.tolerance,
        "obstacles": {
            other: known
            for other, config in scenario.objects.items()
            if other != name and (known := planned_solid(other, config)) is not None
        },
        "repeat": scenario.task.repeat,
        "config": scenario.planner,
    }


def MakeScriptedPlanner(scenario: Scenario) -> System:
    """Make the planner that plays a scenario's script, `task.repeat` times.

    It is a `ScriptedPlanner`. If the script is of messages, it is a diagram of one
    with an `arm_reference` that makes motion of the arm's targets.
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


def MakeTaskPlanner(scenario: Scenario) -> TaskPlanner:
    """Make the planner of motions, with its own model of arm and furniture."""
    scene = own_scene(scenario)
    assert scenario.arm is not None
    hand = MakeHand(scenario, scene.plant)
    return TaskPlanner(scene, hand, np.array(scenario.arm.home), scenario.planner)


def own_scene(scenario: Scenario) -> PlanningScene:
    """Return a planner's own model of arm and furniture."""
    config = scenario.planner
    return _planning_scene(
        Models.of(scenario), config.clearance, config.hand_clearance, config.payload
    ).copy()


@functools.lru_cache(maxsize=2)
def _planning_scene(
    models: Models, margin: float, hand_margin: float, payload: float
) -> PlanningScene:
    """Return the planner's model. Use copies of it only: it is cached."""
    builder = RobotDiagramBuilder(time_step=0.0)
    models.add_to(builder.plant())
    return PlanningScene(
        builder, margin=margin, hand_margin=hand_margin, payload=payload
    )
