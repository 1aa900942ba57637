"""What an SRG senses of itself and of what it holds, for every driver alike."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain

from drake_srg.gripper.grasp_detector import GraspDetector, GraspDetectorConfig
from drake_srg.gripper.proximity import AddSrgProximitySensors, ProximityConfig
from drake_srg.gripper.touch import AddSrgContactForceSensors, TouchConfig
from drake_srg.gripper.underactuation import FINGERS, JOINT_NAMES

TRIGGERS = ("proximity", "touch")


@dc.dataclass(kw_only=True)
class FingerSensingConfig:
    """The sensors of an SRG.

    Attributes:
        joint_names: Order of everything that has an entry a joint.
        sensor_names: Order of everything that has an entry a sensor.
    """

    joint_names: ClassVar[tuple[str, ...]] = tuple(f"{n}_joint" for n in JOINT_NAMES)
    sensor_names: ClassVar[tuple[str, ...]] = JOINT_NAMES

    # Which sensors tell that a link is at something: the thesis's V-REP model had
    # proximity sensors in place of touch.
    trigger: str = dc.field(default="proximity", metadata={"among": TRIGGERS})
    proximity: ProximityConfig = dc.field(default_factory=ProximityConfig)
    touch: TouchConfig = dc.field(default_factory=TouchConfig)
    grasp_detector: GraspDetectorConfig = dc.field(default_factory=GraspDetectorConfig)


@dc.dataclass(frozen=True)
class FingerSensing:
    """Output ports that the rest of a driver needs."""

    state_measured: OutputPort  # (8), [q; v] in the order of `JOINT_NAMES`
    triggered: OutputPort  # (4)


def AddFingerSensing(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: FingerSensingConfig,
) -> FingerSensing:
    """Add encoders, proximity and touch sensors and the grasp detector to a driver.

    Exports the inputs `plant_state` (the gripper's, in the plant's order),
    `query_object`, `contact_results` and `body_poses`, and the outputs
    `state_measured`, `proximity`, `contact_force`, `contact_wrench` and `grasped`.
    """
    n = len(JOINT_NAMES)
    joints = [plant.GetJointByName(f"{name}_joint", gripper) for name in JOINT_NAMES]
    rank = np.argsort(np.argsort([joint.velocity_start() for joint in joints]))
    select = np.zeros((2 * n, 2 * n))
    for row, column in enumerate(rank):
        select[row, column] = select[n + row, n + column] = 1.0
    encoders = builder.AddNamedSystem("encoders", MatrixGain(select))
    proximity = AddSrgProximitySensors(builder, plant, gripper, config.proximity)
    touch = AddSrgContactForceSensors(builder, plant, gripper, config.touch)
    detector = builder.AddNamedSystem(
        "grasp_detector", GraspDetector(FINGERS, config.grasp_detector)
    )
    sensors = touch if config.trigger == "touch" else proximity
    triggered = sensors.GetOutputPort("triggered")
    builder.Connect(triggered, detector.get_input_port())

    builder.ExportInput(encoders.get_input_port(), "plant_state")
    builder.ExportInput(proximity.get_input_port(), "query_object")
    for name in ("contact_results", "body_poses"):
        builder.ExportInput(touch.GetInputPort(name), name)
    builder.ExportOutput(encoders.get_output_port(), "state_measured")
    builder.ExportOutput(proximity.GetOutputPort("proximity"), "proximity")
    for name in ("contact_force", "contact_wrench"):
        builder.ExportOutput(touch.GetOutputPort(name), name)
    builder.ExportOutput(detector.get_output_port(), "grasped")
    return FingerSensing(encoders.get_output_port(), triggered)
