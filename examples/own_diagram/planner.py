"""Our planner in your own diagram: your table, box, camera and arm, no scenario."""

import sys
from pathlib import Path

import numpy as np
from camera import AddLocalizer
from own_world import RED, AddBox
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.arm import AddArmDriver, ArmPositionDriver
from drake_srg.gripper import SrgPositionDriver
from drake_srg.objects import AddModel
from drake_srg.planning import (
    PickAndPlace,
    PickAndPlacePlanner,
    PickTask,
    PlanningScene,
    SrgHand,
    TaskPlanner,
)
from drake_srg.recording import AddRecording
from drake_srg.types import Box, PlannerStatus

BOX = Box([0.05, 0.05, 0.1])
START, GOAL = RigidTransform([0.6, 0.1, 0.05]), RigidTransform([0.55, -0.35, 0.05])
HOME = [0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0]  # [rad]


def AddCell(plant: MultibodyPlant) -> tuple[ModelInstanceIndex, ModelInstanceIndex]:
    """Add a table and an arm with the SRG, and return arm and gripper."""
    AddBox(plant, "table", [2.0, 2.0, 0.1], RigidTransform([0.4, 0.0, -0.05]))
    arm = AddModel(plant, "package://drake_srg/sdf/iiwa14.sdf", "arm")
    gripper = AddModel(plant, "package://drake_srg/sdf/srg.sdf", "gripper")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("link_0", arm))
    flange, palm = plant.GetFrameByName("flange"), plant.GetFrameByName("palm")
    turn = RollPitchYaw(0.0, -np.pi / 2, 0.0)  # the palm's x is the flange's z
    plant.WeldFrames(flange, palm, RigidTransform(turn, np.zeros(3)))
    return arm, gripper


def main(out: Path) -> tuple[PlannerStatus, float]:
    """Return the planner's last report, and how far the box is from its goal [m]."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.002)
    arm, gripper = AddCell(plant)
    box = AddBox(plant, "box", BOX.size, START, RED, mass=0.3)
    arm_config, srg_config = ArmPositionDriver(home=HOME), SrgPositionDriver()
    arm_config.prepare_plant(plant, arm)
    plant.Finalize()
    down = RigidTransform(RollPitchYaw(np.pi, 0.0, -np.pi / 2), [0.7, 0.0, 1.55])
    eye, localizer = AddLocalizer(builder, scene_graph, down, BOX)
    # The planner's model of the cell knows of no box. It also weighs the arm.
    models, config = RobotDiagramBuilder(time_step=0.0), PickAndPlace()
    AddCell(models.plant())
    scene = PlanningScene(models)
    hand = SrgHand(config.approaches, config.tilts, config.squeeze)
    motions = TaskPlanner(scene, hand, np.array(HOME), config)
    planner = PickAndPlacePlanner(motions, PickTask("box", BOX, GOAL), config)
    builder.AddNamedSystem("planner", planner)
    arm_driver = AddArmDriver(builder, plant, arm, gripper, scene.plant, arm_config)
    hand_driver = srg_config.AddDriver(builder, plant, gripper, scene_graph=scene_graph)
    for source, system, port in (
        (localizer.GetOutputPort("blobs"), planner, "blobs"),
        (arm_driver.GetOutputPort("state_measured"), planner, "arm_state"),
        (hand_driver.GetOutputPort("state_measured"), planner, "gripper_state"),
        (hand_driver.GetOutputPort("grasped"), planner, "grasped"),
        (hand_driver.GetOutputPort("proximity"), planner, "proximity"),
        (planner.GetOutputPort("position_commanded"), arm_driver, "position_commanded"),
        (planner.GetOutputPort("closure_commanded"), hand_driver, "closure_commanded"),
    ):
        builder.Connect(source, system.GetInputPort(port))
    ports, seen = {"mode": planner.GetOutputPort("mode")}, {"eye": eye}
    with AddRecording(builder, plant, scene_graph, out, ports=ports, cameras=seen):
        simulator = Simulator(builder.Build())
        simulator.AdvanceTo(8.0)
    root = simulator.get_context()
    report = planner.GetOutputPort("status").Eval(planner.GetMyContextFromRoot(root))
    X_WO = box.EvalPoseInWorld(plant.GetMyContextFromRoot(root))
    return report, float(np.linalg.norm((X_WO.inverse() @ GOAL).translation()))


if __name__ == "__main__":
    report, error = main(Path(sys.argv[1] if len(sys.argv) > 1 else "own_planner"))
    print(f"{report.mode} {report.message}: the box is {1e3 * error:.1f} mm off.")
