"""The base class of gripper drivers, and the sensors of their fingers."""

import abc
import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import ClassVar, Protocol

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
    DiscreteValues,
    InputPort,
    OutputPort,
)
from pydrake.systems.primitives import MatrixGain

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.joint_errors import AddEncoderNoise, AddLatency, JointErrorsConfig
from drake_srg.common.systems import AddUnique, check_prepared, output_ports
from drake_srg.config import Config, positive
from drake_srg.gripper.sensors import (
    FingerLayout,
    FingerSensorConfig,
    ProximityConfig,
    TouchConfig,
)
from drake_srg.gripper.servo import GripperServoConfig
from drake_srg.gripper.tendon import MotorTemperatureConfig, TendonDriveConfig
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector


@dc.dataclass(kw_only=True)
class GraspDetectorConfig(Config):
    """Timing of the grasp detector."""

    # Time for which sensors of all fingers must fire [s]: the arm thesis's post-contact
    # delay.
    post_contact_delay: float = dc.field(default=0.1, metadata={"ge": 0.0})
    # Time between evaluations [s].
    period: float = dc.field(default=0.01, metadata=positive())


class GraspDetector(LeafSystem):
    """Reports a grasp once every finger has sensed contact for some time.

    .. pydrake_system::

        name: GraspDetector
        input_ports:
        - triggered
        output_ports:
        - grasped

    `triggered` (m) is nonzero where a sensor fires. `grasped` (1) is 1 once every
    finger has had a firing sensor without a break for `config.post_contact_delay`, else
    0. The fingers of a closed empty hand sense each other, too; only the joint angles
    distinguish this from a grasp.

    Args:
        fingers: The indices of each finger's sensors.
        config: Timing.
    """

    def __init__(
        self,
        fingers: Sequence[Sequence[int]],
        config: GraspDetectorConfig | None = None,
    ) -> None:
        super().__init__()
        self.config = config or GraspDetectorConfig()
        self._fingers = [list(finger) for finger in fingers]
        self._triggered = self.DeclareVectorInputPort(
            name="triggered", size=sum(len(finger) for finger in fingers)
        )
        # Time since which all fingers have sensed something [s]; inf if they do not.
        self.DeclareDiscreteState([np.inf])
        self.DeclareVectorOutputPort(
            name="grasped",
            size=1,
            calc=self._calc_grasped,
            prerequisites_of_calc={self.time_ticket(), self.xd_ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        fired = self._triggered.Eval(context).tolist()
        since = np.inf
        if all(any(fired[i] for i in finger) for finger in self._fingers):
            since = min(context.get_discrete_state(0).value()[0], context.get_time())
        discrete_state.set_value([since])

    def _calc_grasped(self, context: Context, output: BasicVector) -> None:
        since = context.get_discrete_state(0).value()[0]
        output[0] = context.get_time() - since >= self.config.post_contact_delay


# Inputs from the plant and the scene graph. A driver has only those that its sensors
# read.
PLANT_INPUTS = (
    "plant_state",
    "query_object",
    "contact_results",
    "body_poses",
    "body_spatial_velocities",
    "body_spatial_accelerations",
)


@dc.dataclass(kw_only=True)
class FingerSensingConfig(Config):
    """The sensors of a gripper; the driver's configuration adds their `layout`.

    Each field with a `FingerSensorConfig` adds a sensor; None leaves it out.
    """

    layout: ClassVar[FingerLayout]

    # Name of the field whose sensor detects that a link has reached something. The
    # thesis's V-REP model uses proximity sensors instead of touch.
    trigger: str = "proximity"
    proximity: ProximityConfig = dc.field(default_factory=ProximityConfig)
    touch: TouchConfig = dc.field(default_factory=TouchConfig)
    grasp_detector: GraspDetectorConfig = dc.field(default_factory=GraspDetectorConfig)
    errors: JointErrorsConfig = dc.field(default_factory=JointErrorsConfig)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints' names, in the order of all vectors with one entry per joint."""
        return self.layout.joint_names

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """The sensors' names, in the order of all vectors with one entry per sensor."""
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
    """Output ports of the sensors that the rest of a driver reads."""

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

    Ports of sensors are connected by name. An input port gets the driver's measurement
    (`state_measured`), the output of an earlier sensor, or one of `PLANT_INPUTS`, which
    the driver then exports. Every output port is exported, except `triggered` (m),
    which is nonzero where a sensor fires. The grasp detector reads the `triggered` of
    the sensor `config.trigger`.

    Args:
        builder: The driver under construction.
        plant: Plant with the gripper, finalized.
        gripper: Its model instance.
        config: Configuration of the sensors.
        period: Time between draws of the encoders' noise [s].
        seed: Seed of the noise.

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
    """Connect a sensor's input port to the source of the same name.

    Args:
        builder: The driver under construction.
        port: Port of the sensor.
        sources: Output ports within the driver.
        inputs: Names of the input ports that the driver already has. A new one is
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


# Commands that arrive late if the driver has latency.
_DELAYED = ("closure_commanded", "closure_messages")


@dc.dataclass(frozen=True)
class GripperControl:
    """Ports of a driver's control, by the names under which the driver exports them.

    Attributes:
        inputs: Commands; `closure_commanded` (1) is required.
        outputs: Either `actuation` or `desired_state` is required. `actuation` holds
            the joint torques [N m] in the order of the gripper's actuators.
            `desired_state` is [q; v] in that order, for PD actuators that
            `prepare_plant` has set up.
    """

    inputs: Mapping[str, InputPort]
    outputs: Mapping[str, OutputPort]


class WireMotor(Protocol):
    """The one motor that winds the wires of a gripper."""

    drive: TendonDriveConfig
    temperature: MotorTemperatureConfig
    servo: GripperServoConfig


@dc.dataclass(kw_only=True)
class GripperDriver(FingerSensingConfig, abc.ABC):
    """Configuration of a gripper driver, which turns closure into motion of the joints.

    A driver of your own derives from this class, sets `layout` (the joints and links
    that it measures) and implements `AddControl`; see docs/extending.md.
    """

    # Whether the driver is updated with the plant's steps.
    needs_discrete_plant: ClassVar[bool] = False

    # Gains of the motors' servos, one entry per motor.
    servo: GripperServoConfig

    @property
    def num_motors(self) -> int:
        """Number of motors: one per measured joint unless overridden."""
        return len(self.joint_names)

    @property
    def wire_motor(self) -> WireMotor | None:
        """The motor that winds the gripper's wires; None if it has no wires."""
        return None

    def empty_hand(self, closure: float) -> tuple[float, Vector]:
        """Return the travel of the one motor for an empty hand, and its joints [rad].

        The travel is in the driver's own unit. The joints are in the order of
        `joint_names`.

        Args:
            closure: 0 open .. 1 closed.

        Raises:
            ScenarioError: If no single motor closes this gripper.
        """
        raise ScenarioError(
            f"gripper: no single servo closes the gripper of !{type(self).__name__}"
        )

    def prepare_plant(self, plant: MultibodyPlant, gripper: ModelInstanceIndex) -> None:
        """Prepare the plant for the driver, before the plant is finalized."""

    @abc.abstractmethod
    def AddControl(
        self,
        inner: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        sensing: FingerSensing,
    ) -> GripperControl:
        """Add the systems from commands to the actuators, and return their ports.

        Args:
            inner: The driver under construction.
            plant: Plant with the gripper, finalized.
            gripper: Its model instance.
            sensing: Measurements, already in `inner`.
        """

    def AddDriver(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        seed: int = 0,
        *,
        name: str = "gripper_driver",
        scene_graph: SceneGraph | None = None,
    ) -> Diagram:
        """Add the driver to a diagram and connect it to the plant.

        The caller connects the commands.

        Args:
            builder: Builder of the diagram.
            plant: Plant with the gripper, finalized.
            gripper: Its model instance.
            seed: Seed of the encoders' noise.
            name: Name of the driver in the diagram; it must be unique.
            scene_graph: Scene graph for the driver's `query_object`, if it has that
                port. With None, the caller connects the port.

        Raises:
            ValueError: If the name is taken, or the driver controls PD actuators and
                `prepare_plant` was not called.
        """
        inner = DiagramBuilder()
        period = self.servo.period
        sensing = AddFingerSensing(
            inner, plant, gripper, self, period=period, seed=seed
        )
        control = self.AddControl(inner, plant, gripper, sensing)
        for port, command in control.inputs.items():
            latency = self.errors.latency if port in _DELAYED else 0.0
            inner.ExportInput(AddLatency(inner, command, latency, period), port)
        for port, output in control.outputs.items():
            inner.ExportOutput(output, port)
        if "desired_state" in control.outputs:
            check_prepared(plant, gripper)
        driver = AddUnique(builder, name, inner.Build())
        if scene_graph is not None and driver.HasInputPort("query_object"):
            builder.Connect(
                scene_graph.get_query_output_port(), driver.GetInputPort("query_object")
            )
        for output, port in (
            (plant.get_state_output_port(gripper), "plant_state"),
            (plant.get_contact_results_output_port(), "contact_results"),
            (plant.get_body_poses_output_port(), "body_poses"),
            (
                plant.get_body_spatial_velocities_output_port(),
                "body_spatial_velocities",
            ),
            (
                plant.get_body_spatial_accelerations_output_port(),
                "body_spatial_accelerations",
            ),
        ):
            if driver.HasInputPort(port):
                builder.Connect(output, driver.GetInputPort(port))
        for port, command in (
            ("actuation", plant.get_actuation_input_port(gripper)),
            ("desired_state", plant.get_desired_state_input_port(gripper)),
        ):
            if driver.HasOutputPort(port):
                builder.Connect(driver.GetOutputPort(port), command)
        return driver
