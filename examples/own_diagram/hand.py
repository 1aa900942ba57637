"""The SRG on an arm of your own: a slide lifts a box, and the run is recorded."""

import sys
from pathlib import Path

import numpy as np
from own_world import RED, AddBox
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import (
    PdControllerGains,
    PrismaticJoint,
    SpatialInertia,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.gripper import SrgPositionDriver
from drake_srg.objects import AddModel
from drake_srg.recording import AddRecording


def main(out: Path) -> float:
    """Grasp the box, lift it, and return how far it has risen [m]."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.002)

    # The arm: a carriage on a vertical slide, driven by the plant's own PD control.
    arm = plant.AddModelInstance("arm")
    inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.05)
    carriage = plant.AddRigidBody("carriage", arm, inertia)
    up = np.array([0.0, 0.0, 1.0])
    slide = PrismaticJoint("slide", plant.world_frame(), carriage.body_frame(), up)
    motor = plant.AddJointActuator("slide", plant.AddJoint(slide), 200.0)
    motor.set_controller_gains(PdControllerGains(p=2e4, d=600.0))

    # The hand: its palm's x, along the fingers, points down.
    gripper = AddModel(plant, "package://drake_srg/sdf/srg.sdf", "gripper")
    palm = plant.GetFrameByName("palm", gripper)
    down = RigidTransform(RollPitchYaw(0.0, np.pi / 2, 0.0), [0.0, 0.0, 0.2])
    plant.WeldFrames(carriage.body_frame(), palm, down)

    # The box, and what it stands on.
    at = RigidTransform([0.0, 0.0, 0.05])
    box = AddBox(plant, "box", [0.05, 0.05, 0.1], at, RED, mass=0.3)
    AddBox(plant, "ground", [1.0, 1.0, 0.1], RigidTransform([0.0, 0.0, -0.05]))
    plant.Finalize()

    # The hand's driver, and commands: close, then lift.
    config = SrgPositionDriver()
    driver = config.AddDriver(builder, plant, gripper, scene_graph=scene_graph)
    closure = builder.AddSystem(ConstantVectorSource([0.8]))
    builder.Connect(closure.get_output_port(), driver.GetInputPort("closure_commanded"))
    height = PiecewisePolynomial.CubicShapePreserving(
        [0.0, 1.0, 2.0, 2.5], [[0.0, 0.0, 0.2, 0.2]], zero_end_point_derivatives=True
    )
    lift = builder.AddSystem(TrajectorySource(height, output_derivative_order=1))
    target = plant.get_desired_state_input_port(arm)
    builder.Connect(lift.get_output_port(), target)

    ports = {
        "gripper.joints [rad, rad/s]": driver.GetOutputPort("state_measured"),
        "gripper.proximity [m]": driver.GetOutputPort("proximity"),
        "gripper.pwm": driver.GetOutputPort("pwm"),
        "gripper.grasped": driver.GetOutputPort("grasped"),
        "arm.state [m, m/s]": plant.get_state_output_port(arm),
    }
    with AddRecording(builder, plant, scene_graph, out, ports=ports, objects=["box"]):
        simulator = Simulator(builder.Build())
        simulator.AdvanceTo(2.5)
    context = plant.GetMyContextFromRoot(simulator.get_context())
    return float(box.EvalPoseInWorld(context).translation()[2]) - 0.05


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "own_hand")
    print(f"The box has risen {1e3 * main(folder):.0f} mm. See {folder}/replay.html.")
