"""What a gripper senses of itself and of what it holds, for every driver alike."""

import dataclasses as dc
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain

from drake_srg.common.joint_errors import AddEncoderNoise, JointErrorsConfig
from drake_srg.gripper.finger_layout import FingerLayout
from drake_srg.gripper.grasp_detector import GraspDetector, GraspDetectorConfig
from drake_srg.gripper.proximity import AddProximitySensors, ProximityConfig
from drake_srg.gripper.touch import AddContactForceSensors, TouchConfig
from drake_srg.types import Vector

TRIGGERS = ("proximity", "touch")


@dc.dataclass(kw_only=True)
class FingerSensingConfig:
    """The sensors of a gripper; a driver's configuration adds their `layout`."""

    layout: ClassVar[FingerLayout]

    # Which sensors tell that a link is at something: the thesis's V-REP model had
    # proximity sensors in place of touch.
    trigger: str = dc.field(default="proximity", metadata={"among": TRIGGERS})
    proximity: ProximityConfig = dc.field(default_factory=ProximityConfig)
    touch: TouchConfig = dc.field(default_factory=TouchConfig)
    grasp_detector: GraspDetectorConfig = dc.field(default_factory=GraspDetectorConfig)
    errors: JointErrorsConfig = dc.field(default_factory=JointErrorsConfig)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Order of everything that has an entry a joint."""
        return self.layout.joint_names

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Order of everything that has an entry a sensor."""
        return self.layout.sensor_names


@dc.dataclass(frozen=True)
class FingerSensing:
    """Output ports that the rest of a driver needs."""

    state_measured: OutputPort  # (2n), [q; v] of the n measured joints
    triggered: OutputPort  # (m), one a sensor
    grasped: OutputPort  # (1)


def AddFingerSensing(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: FingerSensingConfig,
    *,
    period: float,
    seed: int,
) -> FingerSensing:
    """Add encoders, proximity and touch sensors and the grasp detector to a driver.

    Exports the inputs `plant_state` (the gripper's, in the plant's order),
    `query_object`, `contact_results` and `body_poses`, and the outputs
    `state_measured`, `proximity`, `contact_force`, `contact_wrench` and `grasped`.
    The encoders' noise is drawn every `period` [s], from `seed`.
    """
    encoders = builder.AddNamedSystem(
        "encoders", MatrixGain(_joint_selector(plant, gripper, config.joint_names))
    )
    state_measured = AddEncoderNoise(
        builder, encoders.get_output_port(), config.errors, period, seed, "gripper"
    )
    layout = config.layout
    proximity = AddProximitySensors(builder, plant, gripper, layout, config.proximity)
    touch = AddContactForceSensors(builder, plant, gripper, layout, config.touch)
    detector = builder.AddNamedSystem(
        "grasp_detector", GraspDetector(layout.fingers, config.grasp_detector)
    )
    sensors = touch if config.trigger == "touch" else proximity
    triggered = sensors.GetOutputPort("triggered")
    builder.Connect(triggered, detector.get_input_port())

    builder.ExportInput(encoders.get_input_port(), "plant_state")
    builder.ExportInput(proximity.get_input_port(), "query_object")
    for name in ("contact_results", "body_poses"):
        builder.ExportInput(touch.GetInputPort(name), name)
    builder.ExportOutput(state_measured, "state_measured")
    builder.ExportOutput(proximity.GetOutputPort("proximity"), "proximity")
    for name in ("contact_force", "contact_wrench"):
        builder.ExportOutput(touch.GetOutputPort(name), name)
    builder.ExportOutput(detector.get_output_port(), "grasped")
    return FingerSensing(state_measured, triggered, detector.get_output_port())


def _joint_selector(
    plant: MultibodyPlant, gripper: ModelInstanceIndex, names: Sequence[str]
) -> Vector:
    """The matrix that turns the gripper's state into [q; v] of some of its joints."""
    positions = plant.GetPositionsFromArray(gripper, np.arange(plant.num_positions()))
    speeds = plant.GetVelocitiesFromArray(gripper, np.arange(plant.num_velocities()))
    joints = [plant.GetJointByName(name, gripper) for name in names]
    return np.array(
        [[*(positions == j.position_start()), *(speeds < 0)] for j in joints]
        + [[*(positions < 0), *(speeds == j.velocity_start())] for j in joints],
        dtype=float,
    )
