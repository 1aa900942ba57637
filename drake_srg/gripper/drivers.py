"""Gripper drivers: what stands between a closure command and joint torques."""

import dataclasses as dc

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuator, ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import MatrixGain

from drake_srg.gripper.finger_sensing import AddFingerSensing, FingerSensingConfig
from drake_srg.gripper.minimum_jerk import MinimumJerkConfig, MinimumJerkReference
from drake_srg.gripper.servo import GripperServo, GripperServoConfig
from drake_srg.gripper.spool_command import SpoolCommand, SpoolCommandConfig
from drake_srg.gripper.tendon import TendonDrive, TendonDriveConfig
from drake_srg.gripper.underactuation import (
    JOINT_NAMES,
    UnderactuationConfig,
    UnderactuationLogic,
)
from drake_srg.types import Vector


def _default_servo() -> GripperServoConfig:
    # Joint torque limits tau are 2.0 N m (base) and 1.4 N m (tip), the inertia J that
    # a joint turns is almost only its motor's, 0.0037 and 0.0019 kg m² (srg.sdf).
    # Stiffness K = J w²: the base gets w = 40 rad/s, a thirtieth of the sample rate. A
    # fingertip pinch presses with the middle of its pad, 34 mm beyond the tip hinge
    # and 85 mm beyond the base hinge, when base and tip torque are as 85 : 34; both
    # joints have the same error there (Algorithm 1), so K_tip = K_base / 2.5.
    # K_P = K / tau; K_D = 2 sqrt(K J) / tau (critical); K_FF1 the joint's damping
    # over tau; K_FF2 = J / tau.
    base, tip = 0, 1
    tau = np.array([2.0, 1.4])
    inertia = np.array([0.0037, 0.0019])
    stiffness = inertia[base] * 40.0**2 * np.array([1.0, 1.0 / 2.5])
    damping = 0.01

    def per_joint(gain: np.ndarray) -> list[float]:
        return [float(gain[i]) for i in (base, base, tip, tip)]

    return GripperServoConfig(
        kp=per_joint(stiffness / tau),
        ki=[0.0] * 4,
        kd=per_joint(2.0 * np.sqrt(stiffness * inertia) / tau),
        kff1=per_joint(damping / tau),
        kff2=per_joint(inertia / tau),
    )


@dc.dataclass(kw_only=True)
class SrgPositionDriver(FingerSensingConfig):
    """Four position-controlled joints, as in the SRG thesis's V-REP model.

    closure -> UnderactuationLogic -> MinimumJerkReference -> GripperServo; the PWM
    times the joint's torque limit is the torque.
    """

    underactuation: UnderactuationConfig = dc.field(
        default_factory=UnderactuationConfig
    )
    minimum_jerk: MinimumJerkConfig = dc.field(default_factory=MinimumJerkConfig)
    servo: GripperServoConfig = dc.field(default_factory=_default_servo)


def _default_motor_servo() -> GripperServoConfig:
    # As for the joints: K = J w² with w = 40 rad/s and J the motor's at the spool, over
    # its full torque. The back-EMF damps more than critically (0.91 against 2 J w =
    # 0.8 N m s/rad), and the first feedforward gain makes up for it.
    drive = TendonDriveConfig()
    return GripperServoConfig(
        kp=[drive.reflected_inertia * 40.0**2 / drive.full_torque],
        ki=[0.0],
        kd=[0.0],
        kff1=[drive.motor_damping / drive.full_torque],
        kff2=[drive.reflected_inertia / drive.full_torque],
        # Stiff as it is, the servo presses with what this allows: 103 N at each wire.
        force_limit=1 / 3,
    )


@dc.dataclass(kw_only=True)
class SrgTendonDriver(FingerSensingConfig):
    """One motor that winds a wire per finger, as in the real SRG.

    closure -> SpoolCommand -> MinimumJerkReference -> GripperServo on the motor ->
    TendonDrive.
    """

    spool: SpoolCommandConfig = dc.field(default_factory=SpoolCommandConfig)
    # 4.5 rad/s at the spool is 0.87 of the motor's no-load speed at full scale.
    minimum_jerk: MinimumJerkConfig = dc.field(
        default_factory=lambda: MinimumJerkConfig(max_velocity=4.5)
    )
    servo: GripperServoConfig = dc.field(default_factory=_default_motor_servo)
    drive: TendonDriveConfig = dc.field(default_factory=TendonDriveConfig)


SrgDriver = SrgPositionDriver | SrgTendonDriver


def AddSrgDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: SrgDriver,
) -> Diagram:
    """Add the driver that a configuration asks for."""
    if isinstance(config, SrgTendonDriver):
        return AddSrgTendonDriver(builder, plant, gripper, config)
    return AddSrgPositionDriver(builder, plant, gripper, config)


def AddSrgPositionDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: SrgPositionDriver | None = None,
) -> Diagram:
    """Add the driver of an SRG to a diagram and connect it to the (finalized) plant.

    .. pydrake_system::

        name: SrgPositionDriver
        input_ports:
        - plant_state
        - query_object
        - contact_results
        - body_poses
        - closure_commanded
        - joint_position_commanded (optional)
        - hold (optional)
        - force_limit (optional)
        output_ports:
        - state_measured
        - proximity
        - contact_force
        - contact_wrench
        - grasped
        - pwm
        - actuation

    `actuation` is the joints' torques [N m] in the order of the gripper's actuators. It
    and the inputs up to `body_poses` are connected here, but for `query_object`, which
    is the scene graph's. The others are as in the table of station ports, in the order
    of `JOINT_NAMES`.
    """
    config = config or SrgPositionDriver()
    inner = DiagramBuilder()
    sensing = AddFingerSensing(inner, plant, gripper, config)
    n = len(JOINT_NAMES)
    limits = [actuator.effort_limit() for actuator in _actuators(plant, gripper)]
    motors = inner.AddNamedSystem(
        "motors", MatrixGain(np.diag(limits) @ _joint_to_actuator(plant, gripper))
    )
    logic = inner.AddNamedSystem(
        "underactuation_logic", UnderactuationLogic(config.underactuation)
    )
    reference = inner.AddNamedSystem(
        "minimum_jerk_reference",
        MinimumJerkReference(np.zeros(n), config.minimum_jerk),
    )
    servo = inner.AddNamedSystem("servo", GripperServo(config.servo))

    for system in (logic, servo):
        inner.Connect(sensing.state_measured, system.GetInputPort("state_measured"))
    inner.Connect(sensing.triggered, logic.GetInputPort("triggered"))
    inner.Connect(logic.get_output_port(), reference.get_input_port())
    inner.Connect(reference.get_output_port(), servo.GetInputPort("reference"))
    inner.Connect(servo.get_output_port(), motors.get_input_port())

    for name in ("closure_commanded", "joint_position_commanded", "hold"):
        inner.ExportInput(logic.GetInputPort(name), name)
    inner.ExportInput(servo.GetInputPort("force_limit"), "force_limit")
    inner.ExportOutput(servo.get_output_port(), "pwm")
    inner.ExportOutput(motors.get_output_port(), "actuation")
    return _AddDriver(builder, plant, gripper, inner)


def SetTendonDynamics(
    plant: MultibodyPlant, gripper: ModelInstanceIndex, config: TendonDriveConfig
) -> None:
    """Prepare an SRG's joints for `AddSrgTendonDriver`, before the plant is finalized.

    The model's joints carry a share of the motor's inertia, friction and torque limit,
    for drivers without a motor of their own; with wires, the motor is on their other
    side.
    """
    for actuator in _actuators(plant, gripper):
        actuator.set_default_rotor_inertia(0.0)
        actuator.set_effort_limit(np.inf)
        actuator.joint().set_default_damping(config.joint_damping)


def AddSrgTendonDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: SrgTendonDriver | None = None,
) -> Diagram:
    """Add the driver of an SRG to a diagram and connect it to the (finalized) plant.

    .. pydrake_system::

        name: SrgTendonDriver
        input_ports:
        - plant_state
        - query_object
        - contact_results
        - body_poses
        - closure_commanded
        - hold (optional)
        - force_limit (optional)
        output_ports:
        - state_measured
        - proximity
        - contact_force
        - contact_wrench
        - grasped
        - pwm
        - motor_state
        - wire_force
        - actuation

    As `AddSrgPositionDriver`, but `pwm` (1) is the motor's, so that `force_limit`
    limits its torque and its speed, and single joints cannot be commanded.
    `motor_state` and `wire_force` are those of `TendonDrive`. Call `SetTendonDynamics`
    before the plant is finalized.

    Raises:
        ValueError: If that was not done, or the plant is continuous.
    """
    config = config or SrgTendonDriver()
    if any(a.default_rotor_inertia() != 0.0 for a in _actuators(plant, gripper)):
        raise ValueError(
            "the gripper's joints have rotors of their own: call SetTendonDynamics "
            "before the plant is finalized"
        )
    inner = DiagramBuilder()
    sensing = AddFingerSensing(inner, plant, gripper, config)
    command = inner.AddNamedSystem(
        "spool_command", SpoolCommand(config.drive.spool_radius, config.spool)
    )
    reference = inner.AddNamedSystem(
        "minimum_jerk_reference", MinimumJerkReference(np.zeros(1), config.minimum_jerk)
    )
    servo = inner.AddNamedSystem("servo", GripperServo(config.servo))
    # The wires are a spring of the fingers' own time scale: as often as the plant.
    period = plant.time_step()
    if period == 0.0:
        raise ValueError("wires need a discrete plant, this one is continuous")
    drive = inner.AddNamedSystem("tendon_drive", TendonDrive(config.drive, period))
    joints = inner.AddNamedSystem(
        "joints", MatrixGain(_joint_to_actuator(plant, gripper))
    )

    motor_state = drive.GetOutputPort("motor_state")
    inner.Connect(motor_state, command.GetInputPort("motor_state"))
    inner.Connect(motor_state, servo.GetInputPort("state_measured"))
    inner.Connect(sensing.triggered, command.GetInputPort("triggered"))
    inner.Connect(sensing.state_measured, drive.GetInputPort("state_measured"))
    inner.Connect(command.get_output_port(), reference.get_input_port())
    inner.Connect(reference.get_output_port(), servo.GetInputPort("reference"))
    inner.Connect(servo.get_output_port(), drive.GetInputPort("pwm"))
    inner.Connect(drive.GetOutputPort("joint_torque"), joints.get_input_port())

    for name in ("closure_commanded", "hold"):
        inner.ExportInput(command.GetInputPort(name), name)
    inner.ExportInput(servo.GetInputPort("force_limit"), "force_limit")
    inner.ExportOutput(servo.get_output_port(), "pwm")
    for name in ("motor_state", "wire_force"):
        inner.ExportOutput(drive.GetOutputPort(name), name)
    inner.ExportOutput(joints.get_output_port(), "actuation")
    return _AddDriver(builder, plant, gripper, inner)


def _actuators(
    plant: MultibodyPlant, gripper: ModelInstanceIndex
) -> list[JointActuator]:
    actuators = [plant.get_joint_actuator(a) for a in plant.GetJointActuatorIndices()]
    return [a for a in actuators if a.model_instance() == gripper]


def _joint_to_actuator(plant: MultibodyPlant, gripper: ModelInstanceIndex) -> Vector:
    """The matrix that turns torques in our order into the actuators' order."""
    joints = [a.joint().name() for a in _actuators(plant, gripper)]
    return np.array(
        [[float(f"{n}_joint" == joint) for n in JOINT_NAMES] for joint in joints]
    )


def _AddDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    inner: DiagramBuilder,
) -> Diagram:
    """Add the driver to a diagram and connect it to the plant."""
    driver = builder.AddNamedSystem("gripper_driver", inner.Build())
    for output, name in (
        (plant.get_state_output_port(gripper), "plant_state"),
        (plant.get_contact_results_output_port(), "contact_results"),
        (plant.get_body_poses_output_port(), "body_poses"),
    ):
        builder.Connect(output, driver.GetInputPort(name))
    builder.Connect(
        driver.GetOutputPort("actuation"), plant.get_actuation_input_port(gripper)
    )
    return driver
