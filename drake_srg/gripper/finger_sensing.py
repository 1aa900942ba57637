"""Finger sensing: encoders, finger sensors and grasp detector of every driver."""

import dataclasses as dc
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import MatrixGain

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.joint_errors import AddEncoderNoise, JointErrorsConfig
from drake_srg.common.ports import output_ports
from drake_srg.gripper.finger_layout import FingerLayout
from drake_srg.gripper.finger_sensor import FingerSensorConfig
from drake_srg.gripper.grasp_detector import GraspDetector, GraspDetectorConfig
from drake_srg.gripper.proximity import ProximityConfig
from drake_srg.gripper.touch import TouchConfig
from drake_srg.types import Vector

# Inputs that a driver can have besides its commands. The plant and the scene graph
# feed them; a driver has those that its sensors read.
PLANT_INPUTS = (
    "plant_state",
    "query_object",
    "contact_results",
    "body_poses",
    "body_spatial_velocities",
    "body_spatial_accelerations",
)


@dc.dataclass(kw_only=True)
class FingerSensingConfig:
    """The sensors of a gripper; the driver's configuration adds their `layout`.

    Each field that is a `FingerSensorConfig` is a sensor; None leaves it out.
    """

    layout: ClassVar[FingerLayout]

    # Sensor that tells that a link is at something: the name of one of the fields that
    # hold sensors. The thesis's V-REP model used proximity sensors in place of touch.
    trigger: str = "proximity"
    proximity: ProximityConfig = dc.field(default_factory=ProximityConfig)
    touch: TouchConfig = dc.field(default_factory=TouchConfig)
    grasp_detector: GraspDetectorConfig = dc.field(default_factory=GraspDetectorConfig)
    errors: JointErrorsConfig = dc.field(default_factory=JointErrorsConfig)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Order of everything with one entry per joint."""
        return self.layout.joint_names

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Order of everything with one entry per sensor."""
        return self.layout.sensor_names

    def sensors(self) -> dict[str, FingerSensorConfig]:
        """Return the sensors by the names of their fields, in order."""
        values = {field.name: getattr(self, field.name) for field in dc.fields(self)}
        return {
            name: value
            for name, value in values.items()
            if isinstance(value, FingerSensorConfig)
        }


@dc.dataclass(frozen=True)
class FingerSensing:
    """Output ports that the rest of a driver reads."""

    state_measured: OutputPort  # (2n), [q; v] of the n measured joints
    triggered: OutputPort  # (m), one per sensor
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
    """Add encoders, the sensors of a configuration and the grasp detector to a driver.

    Ports of sensors are connected by name. An input port gets what the driver measures
    (`state_measured`), the output of an earlier sensor, or one of `PLANT_INPUTS`, which
    the driver then exports. Every output port is exported, except `triggered` (m),
    nonzero where a sensor fires: the one of `config.trigger` feeds the grasp detector.

    Args:
        builder: The driver under construction.
        plant: With the gripper, finalized.
        gripper: Its model instance.
        config: Of the sensors.
        period: Time between draws of the encoders' noise [s].
        seed: Of that noise.

    Raises:
        ScenarioError: If the sensor of `config.trigger` has no port `triggered`.
        ValueError: If there is no source for an input port of a sensor.
    """
    encoders = builder.AddNamedSystem(
        "encoders", MatrixGain(_joint_selector(plant, gripper, config.joint_names))
    )
    builder.ExportInput(encoders.get_input_port(), "plant_state")
    state_measured = AddEncoderNoise(
        builder, encoders.get_output_port(), config.errors, period, seed, "gripper"
    )
    sources = {"state_measured": state_measured}
    inputs = {"plant_state"}
    triggers: dict[str, OutputPort] = {}
    for name, sensor_config in config.sensors().items():
        sensor = sensor_config.AddSensor(builder, plant, gripper, config.layout)
        for i in range(sensor.num_input_ports()):
            _connect(builder, sensor.get_input_port(i), sources, inputs)
        outputs = output_ports(sensor)
        if "triggered" in outputs:
            triggers[name] = outputs.pop("triggered")
        sources |= outputs
    if config.trigger not in triggers:
        raise ScenarioError(
            f"gripper.trigger: {config.trigger!r} has no port triggered "
            f"(allowed: {', '.join(triggers)})"
        )
    triggered = triggers[config.trigger]
    detector = builder.AddNamedSystem(
        "grasp_detector", GraspDetector(config.layout.fingers, config.grasp_detector)
    )
    builder.Connect(triggered, detector.get_input_port())
    grasped = detector.get_output_port()
    for name, port in {**sources, "grasped": grasped}.items():
        builder.ExportOutput(port, name)
    return FingerSensing(state_measured, triggered, grasped)


def _connect(
    builder: DiagramBuilder,
    port: InputPort,
    sources: dict[str, OutputPort],
    inputs: set[str],
) -> None:
    """Connect a sensor's input port to what has its name.

    Args:
        builder: The driver under construction.
        port: Of the sensor.
        sources: Output ports within the driver.
        inputs: Names of the input ports that the driver has already; a new one is
            added.
    """
    name = port.get_name()
    if name in sources:
        builder.Connect(sources[name], port)
    elif name in inputs:
        builder.ConnectInput(name, port)
    elif name in PLANT_INPUTS:
        builder.ExportInput(port, name)
        inputs.add(name)
    else:
        allowed = ", ".join(sorted({*sources, *PLANT_INPUTS}))
        sensor = port.get_system().get_name()
        raise ValueError(
            f"{sensor}: input port {name!r} has no source (allowed: {allowed})"
        )


def _joint_selector(
    plant: MultibodyPlant, gripper: ModelInstanceIndex, names: Sequence[str]
) -> Vector:
    """Return the matrix that picks [q; v] of some joints from the gripper's state."""
    positions = plant.GetPositionsFromArray(gripper, np.arange(plant.num_positions()))
    speeds = plant.GetVelocitiesFromArray(gripper, np.arange(plant.num_velocities()))
    joints = [plant.GetJointByName(name, gripper) for name in names]
    return np.array(
        [[*(positions == j.position_start()), *(speeds < 0)] for j in joints]
        + [[*(positions < 0), *(speeds == j.velocity_start())] for j in joints],
        dtype=float,
    )
