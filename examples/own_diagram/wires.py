"""The SRG by its wires: one motor winds a spool, and springs open the fingers."""

import sys
from pathlib import Path

import numpy as np
from pydrake.geometry import Cylinder
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.gripper import SrgTendonDriver
from drake_srg.objects import AddModel
from drake_srg.recording import AddRecording


def main(out: Path) -> float:
    """Close on a peg, open again, and return the larger wire force at 2 s [N]."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    gripper = AddModel(plant, "package://drake_srg/sdf/srg.sdf", "gripper")
    palm = plant.GetFrameByName("palm", gripper)
    plant.WeldFrames(plant.world_frame(), palm)

    # A peg between the fingers, fixed a little aside.
    peg_model = plant.AddModelInstance("peg")
    inertia = SpatialInertia.SolidCylinderWithMass(
        0.2, 0.02, 0.1, np.array([0, 0, 1.0])
    )
    peg = plant.AddRigidBody("peg", peg_model, inertia)
    shape, color = Cylinder(0.02, 0.1), np.array([0.1, 0.4, 0.7, 1.0])
    friction = CoulombFriction(0.8, 0.8)
    plant.RegisterCollisionGeometry(peg, RigidTransform(), shape, "peg", friction)
    plant.RegisterVisualGeometry(peg, RigidTransform(), shape, "peg", color)
    plant.WeldFrames(palm, peg.body_frame(), RigidTransform([0.13, 0.005, 0.0]))

    # The motor is on the other side of the wires, so it goes off the joints.
    config = SrgTendonDriver()
    config.prepare_plant(plant, gripper)
    plant.Finalize()
    driver = config.AddDriver(builder, plant, gripper, scene_graph=scene_graph)
    closure = PiecewisePolynomial.FirstOrderHold(
        [0.0, 1.0, 2.0, 3.0], [[0.0, 0.8, 0.8, 0.0]]
    )
    for name, source in (
        ("closure_commanded", TrajectorySource(closure)),
        ("force_limit", ConstantVectorSource([0.3])),  # largest PWM, of full scale
    ):
        builder.AddNamedSystem(name, source)
        builder.Connect(source.get_output_port(), driver.GetInputPort(name))

    units = {
        "wire_force": "N",
        "motor_state": "rad, rad/s",
        "pwm": "of full scale",
        "state_measured": "rad, rad/s",
        "contact_force": "N",
    }
    ports = {f"{n} [{unit}]": driver.GetOutputPort(n) for n, unit in units.items()}
    with AddRecording(builder, plant, scene_graph, out, ports=ports):
        diagram = builder.Build()
        simulator = Simulator(diagram)
        # The closure is held at 0.8 from 1 s to 2 s: read the wires at the end of that.
        simulator.AdvanceTo(2.0)
        context = driver.GetMyContextFromRoot(simulator.get_context())
        force = driver.GetOutputPort("wire_force").Eval(context)
        simulator.AdvanceTo(4.0)
    return float(np.max(force))


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "own_wires")
    force = main(folder)
    print(
        f"At 2 s, the tighter wire pulls with {force:.1f} N. See {folder}/replay.html."
    )
