"""Two SRGs on slides of their own lift a bar together."""

import sys
from pathlib import Path

import numpy as np
from own_world import RED, AddBox
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import PdControllerGains, PrismaticJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.gripper import SrgPositionDriver
from drake_srg.objects import AddModel
from drake_srg.recording import AddRecording

PLACES = {"left": -0.18, "right": 0.18}  # of the hands, along x [m]


def main(out: Path) -> RigidTransform:
    """Grasp the bar, lift it, and return its pose."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.002)
    grippers, arms = {}, {}
    for side, x in PLACES.items():
        arms[side] = arm = plant.AddModelInstance(f"{side}_arm")
        inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.05)
        carriage = plant.AddRigidBody(f"{side}_carriage", arm, inertia)
        up, frame = np.array([0.0, 0.0, 1.0]), carriage.body_frame()
        slide = PrismaticJoint(f"{side}_slide", plant.world_frame(), frame, up)
        motor = plant.AddJointActuator(f"{side}_motor", plant.AddJoint(slide), 200.0)
        motor.set_controller_gains(PdControllerGains(p=2e4, d=600.0))
        gripper = AddModel(plant, "package://drake_srg/sdf/srg.sdf", f"{side}_gripper")
        grippers[side] = gripper
        palm = plant.GetFrameByName("palm", gripper)
        down = RigidTransform(RollPitchYaw(0.0, np.pi / 2, 0.0), [x, 0.0, 0.2])
        plant.WeldFrames(frame, palm, down)
    at = RigidTransform([0.0, 0.0, 0.05])
    bar = AddBox(plant, "bar", [0.5, 0.05, 0.1], at, RED, mass=0.5)
    AddBox(plant, "ground", [1.0, 1.0, 0.1], RigidTransform([0.0, 0.0, -0.05]))
    plant.Finalize()

    closure = builder.AddSystem(ConstantVectorSource([0.8]))
    height = PiecewisePolynomial.CubicShapePreserving(
        [0.0, 1.0, 2.0, 2.5], [[0.0, 0.0, 0.2, 0.2]], zero_end_point_derivatives=True
    )
    lift = builder.AddSystem(TrajectorySource(height, output_derivative_order=1))
    ports = {}
    for side, gripper in grippers.items():
        driver = SrgPositionDriver().AddDriver(
            builder,
            plant,
            gripper,
            name=f"{side}_driver",
            scene_graph=scene_graph,
        )
        closed = driver.GetInputPort("closure_commanded")
        builder.Connect(closure.get_output_port(), closed)
        target = plant.get_desired_state_input_port(arms[side])
        builder.Connect(lift.get_output_port(), target)
        ports[f"{side}.contact_force [N]"] = driver.GetOutputPort("contact_force")
        ports[f"{side}.grasped"] = driver.GetOutputPort("grasped")
    with AddRecording(builder, plant, scene_graph, out, ports=ports, objects=["bar"]):
        simulator = Simulator(builder.Build())
        simulator.AdvanceTo(2.5)
    return bar.EvalPoseInWorld(plant.GetMyContextFromRoot(simulator.get_context()))


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "own_two_hands")
    X_WO = main(folder)
    rise, lean = (
        X_WO.translation()[2] - 0.05,
        RollPitchYaw(X_WO.rotation()).pitch_angle(),
    )
    print(
        f"The bar has risen {1e3 * rise:.0f} mm and leans {np.rad2deg(lean):.2f} deg."
    )
