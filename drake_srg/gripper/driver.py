"""Base of every gripper driver: its configuration, and how the driver is built."""

import abc
import dataclasses as dc
from collections.abc import Mapping
from typing import ClassVar, Protocol

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, OutputPort

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.joint_errors import AddLatency
from drake_srg.gripper.sensing import (
    AddFingerSensing,
    FingerSensing,
    FingerSensingConfig,
)
from drake_srg.gripper.servo import GripperServoConfig
from drake_srg.gripper.tendon import MotorTemperatureConfig, TendonDriveConfig
from drake_srg.types import Vector

# Commands that arrive late if the driver has latency.
_DELAYED = ("closure_commanded", "closure_messages")


@dc.dataclass(frozen=True)
class GripperControl:
    """Ports of a driver's control, by the names under which the driver exports them.

    Attributes:
        inputs: Commands; `closure_commanded` (1) is required.
        outputs: `actuation`, the joint torques [N m] in the order of the gripper's
            actuators, is required, or `desired_state` [q; v] in that order, if
            `prepare_plant` made them PD actuators.
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
        """The motor that winds the gripper's wires; None without wires."""
        return None

    def empty_hand(self, closure: float) -> tuple[float, Vector]:
        """Return how far one motor closes an empty hand, and its joints there [rad].

        The way is in any unit. The joints are in the order of `joint_names`.

        Args:
            closure: 0 open .. 1 closed.

        Raises:
            ScenarioError: If no one motor closes this gripper.
        """
        raise ScenarioError(
            f"gripper: no single servo closes the gripper of !{type(self).__name__}"
        )

    def prepare_plant(self, plant: MultibodyPlant, gripper: ModelInstanceIndex) -> None:
        """Change what the driver needs changed in a plant that is not yet finalized."""

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
            plant: With the gripper, finalized.
            gripper: Its model instance.
            sensing: Measurements, already in `inner`.
        """

    def AddDriver(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        seed: int = 0,
    ) -> Diagram:
        """Add the driver `gripper_driver` to a diagram and connect it to the plant.

        The caller connects `query_object` to the scene graph, and the commands.

        Args:
            builder: Of the diagram.
            plant: With the gripper, finalized.
            gripper: Its model instance.
            seed: Of the encoders' noise.
        """
        inner = DiagramBuilder()
        period = self.servo.period
        sensing = AddFingerSensing(
            inner, plant, gripper, self, period=period, seed=seed
        )
        control = self.AddControl(inner, plant, gripper, sensing)
        for name, command in control.inputs.items():
            latency = self.errors.latency if name in _DELAYED else 0.0
            inner.ExportInput(AddLatency(inner, command, latency, period), name)
        for name, output in control.outputs.items():
            inner.ExportOutput(output, name)
        driver = builder.AddNamedSystem("gripper_driver", inner.Build())
        for output, name in (
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
            if driver.HasInputPort(name):
                builder.Connect(output, driver.GetInputPort(name))
        for name, command in (
            ("actuation", plant.get_actuation_input_port(gripper)),
            ("desired_state", plant.get_desired_state_input_port(gripper)),
        ):
            if driver.HasOutputPort(name):
                builder.Connect(driver.GetOutputPort(name), command)
        return driver
