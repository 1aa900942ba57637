"""The SRG's control, wired by hand from its systems.

closure -> UnderactuationLogic -> MinimumJerkReference -> GripperServo -> torques
"""

import sys
from pathlib import Path

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from drake_srg.gripper import (
    SRG_FINGERS,
    GripperServo,
    MinimumJerkReference,
    ProximityConfig,
    SrgPositionDriver,
    UnderactuationLogic,
)
from drake_srg.objects import AddModel
from drake_srg.recording import AddRecording


def main(out: Path) -> np.ndarray:
    """Close the empty hand, and return the joint angles [rad]."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.002)
    gripper = AddModel(plant, "package://drake_srg/sdf/srg.sdf", "gripper")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm", gripper))
    plant.Finalize()

    # The plant has the joints in an order of its own.
    joints = [plant.GetJointByName(n, gripper) for n in SRG_FINGERS.joint_names]
    indices = [joint.index() for joint in joints]
    select = plant.MakeStateSelectorMatrix(indices)
    drive = plant.MakeActuatorSelectorMatrix(indices)
    limits = drive.T @ plant.GetEffortUpperLimits()  # of the joints [N m]
    torques = drive @ np.diag(limits)  # of the actuators, from the joints' PWM

    encoders = builder.AddNamedSystem("encoders", MatrixGain(select))
    amplifiers = builder.AddNamedSystem("amplifiers", MatrixGain(torques))
    sensors = ProximityConfig().AddSensor(builder, plant, gripper, SRG_FINGERS)
    logic = builder.AddNamedSystem("logic", UnderactuationLogic())
    reference = builder.AddNamedSystem("reference", MinimumJerkReference(np.zeros(4)))
    servo = builder.AddNamedSystem("servo", GripperServo(SrgPositionDriver().servo))
    closure = builder.AddNamedSystem("closure", ConstantVectorSource([0.5]))

    measured = encoders.get_output_port()
    for source, target in (
        (plant.get_state_output_port(), encoders.get_input_port()),
        (scene_graph.get_query_output_port(), sensors.GetInputPort("query_object")),
        (closure.get_output_port(), logic.GetInputPort("closure_commanded")),
        (sensors.GetOutputPort("triggered"), logic.GetInputPort("triggered")),
        (measured, logic.GetInputPort("state_measured")),
        (logic.get_output_port(), reference.GetInputPort("position_desired")),
        (reference.get_output_port(), servo.GetInputPort("reference")),
        (measured, servo.GetInputPort("state_measured")),
        (servo.get_output_port(), amplifiers.get_input_port()),
        (amplifiers.get_output_port(), plant.get_actuation_input_port(gripper)),
    ):
        builder.Connect(source, target)

    ports = {
        "targets [rad]": logic.get_output_port(),
        "reference [rad, rad/s, rad/s²]": reference.get_output_port(),
        "joints [rad, rad/s]": measured,
        "PWM": servo.get_output_port(),
    }
    with AddRecording(builder, plant, scene_graph, out, ports=ports):
        diagram = builder.Build()
        simulator = Simulator(diagram)
        simulator.AdvanceTo(1.5)
    context = encoders.GetMyContextFromRoot(simulator.get_context())
    return np.array(measured.Eval(context)[:4])


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "own_systems")
    left_base, right_base, left_tip, right_tip = np.rad2deg(main(folder))
    print(f"The bases are at {left_base:.0f} and {right_base:.0f} degrees,")
    print(f"the tips at {left_tip:.0f} and {right_tip:.0f}. See {folder}/replay.html.")
