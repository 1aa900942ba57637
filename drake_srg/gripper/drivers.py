"""Gripper drivers: what stands between a closure command and joint torques."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import MatrixGain

from drake_srg.gripper.grasp_detector import GraspDetector, GraspDetectorConfig
from drake_srg.gripper.minimum_jerk import MinimumJerkConfig, MinimumJerkReference
from drake_srg.gripper.proximity import AddSrgProximitySensors, ProximityConfig
from drake_srg.gripper.servo import GripperServo, GripperServoConfig
from drake_srg.gripper.underactuation import (
    FINGERS,
    UnderactuationConfig,
    UnderactuationLogic,
)

JOINT_NAMES = ("left_base", "right_base", "left_tip", "right_tip")


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
class SrgPositionDriver:
    """Four position-controlled joints, as in the SRG thesis's V-REP model.

    closure -> UnderactuationLogic -> MinimumJerkReference -> GripperServo; the PWM
    times the joint's torque limit is the torque.

    Attributes:
        joint_names: Order of everything that has an entry a joint.
        sensor_names: Order of everything that has an entry a sensor.
    """

    joint_names: ClassVar[tuple[str, ...]] = tuple(f"{n}_joint" for n in JOINT_NAMES)
    sensor_names: ClassVar[tuple[str, ...]] = JOINT_NAMES

    underactuation: UnderactuationConfig = dc.field(
        default_factory=UnderactuationConfig
    )
    minimum_jerk: MinimumJerkConfig = dc.field(default_factory=MinimumJerkConfig)
    servo: GripperServoConfig = dc.field(default_factory=_default_servo)
    proximity: ProximityConfig = dc.field(default_factory=ProximityConfig)
    grasp_detector: GraspDetectorConfig = dc.field(default_factory=GraspDetectorConfig)


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
        - closure_commanded
        - joint_position_commanded (optional)
        - hold (optional)
        - force_limit (optional)
        output_ports:
        - actuation
        - state_measured
        - pwm
        - proximity
        - grasped

    `plant_state` is the gripper's state in the plant's order, `actuation` its torques
    [N m] in the order of its actuators; both and `query_object` are connected here.
    The others are as in the table of station ports, in the order of `JOINT_NAMES`.
    """
    config = config or SrgPositionDriver()
    inner = DiagramBuilder()
    joints = [plant.GetJointByName(f"{name}_joint", gripper) for name in JOINT_NAMES]
    actuators = [plant.get_joint_actuator(a) for a in plant.GetJointActuatorIndices()]
    actuators = [a for a in actuators if a.model_instance() == gripper]
    driven = {a.joint().index(): row for row, a in enumerate(actuators)}
    n = len(joints)

    # Encoders: the plant's order of states to ours.
    velocity_start = {j.index(): j.velocity_start() for j in joints}
    rank = np.argsort(np.argsort([velocity_start[j.index()] for j in joints]))
    select = np.zeros((2 * n, 2 * n))
    for row, column in enumerate(rank):
        select[row, column] = select[n + row, n + column] = 1.0
    encoders = inner.AddNamedSystem("encoders", MatrixGain(select))
    torque = np.zeros((len(actuators), n))
    for column, joint in enumerate(joints):
        row = driven[joint.index()]
        torque[row, column] = actuators[row].effort_limit()
    motors = inner.AddNamedSystem("motors", MatrixGain(torque))

    sensors = AddSrgProximitySensors(inner, plant, gripper, config.proximity)
    logic = inner.AddNamedSystem(
        "underactuation_logic", UnderactuationLogic(config.underactuation)
    )
    reference = inner.AddNamedSystem(
        "minimum_jerk_reference",
        MinimumJerkReference(np.zeros(n), config.minimum_jerk),
    )
    servo = inner.AddNamedSystem("servo", GripperServo(config.servo))
    detector = inner.AddNamedSystem(
        "grasp_detector", GraspDetector(FINGERS, config.grasp_detector)
    )

    for system in (logic, servo):
        inner.Connect(encoders.get_output_port(), system.GetInputPort("state_measured"))
    for system in (logic, detector):
        inner.Connect(
            sensors.GetOutputPort("triggered"), system.GetInputPort("triggered")
        )
    inner.Connect(logic.get_output_port(), reference.get_input_port())
    inner.Connect(reference.get_output_port(), servo.GetInputPort("reference"))
    inner.Connect(servo.get_output_port(), motors.get_input_port())

    inner.ExportInput(encoders.get_input_port(), "plant_state")
    inner.ExportInput(sensors.get_input_port(), "query_object")
    for name in ("closure_commanded", "joint_position_commanded", "hold"):
        inner.ExportInput(logic.GetInputPort(name), name)
    inner.ExportInput(servo.GetInputPort("force_limit"), "force_limit")
    inner.ExportOutput(motors.get_output_port(), "actuation")
    inner.ExportOutput(encoders.get_output_port(), "state_measured")
    inner.ExportOutput(servo.get_output_port(), "pwm")
    inner.ExportOutput(sensors.GetOutputPort("proximity"), "proximity")
    inner.ExportOutput(detector.get_output_port(), "grasped")

    driver = builder.AddNamedSystem("gripper_driver", inner.Build())
    builder.Connect(
        plant.get_state_output_port(gripper), driver.GetInputPort("plant_state")
    )
    builder.Connect(
        driver.GetOutputPort("actuation"), plant.get_actuation_input_port(gripper)
    )
    return driver
