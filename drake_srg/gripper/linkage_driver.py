"""The master-slave linkage gripper: two servos, one a finger."""

import dataclasses as dc
from typing import ClassVar

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.common.joint_errors import AddLatency
from drake_srg.gripper.driver_wiring import AddDriver, AddJointServos
from drake_srg.gripper.finger_layout import LINKAGE_FINGERS, FingerLayout
from drake_srg.gripper.finger_sensing import AddFingerSensing, FingerSensingConfig
from drake_srg.gripper.linkage import MasterSlaveConfig, MasterSlaveReference
from drake_srg.gripper.proximity import ProximityConfig
from drake_srg.gripper.servo import GripperServoConfig
from drake_srg.types import positive


def _default_servo() -> GripperServoConfig:
    # A crank turns almost only its servo's inertia, J = 0.0020 kg m², and can be given
    # tau = 0.52 N m (linkage_gripper.sdf). Stiffness K = J w² with w = 30 rad/s: from
    # the first contact to the end of the post-contact delay a reference goes on by 0.11
    # rad, which then presses with K 0.11 rad / 45 mm, 4.5 N a finger. Damping 3 J w, of
    # which the back-EMF, b = 0.048 N m s/rad, is a part; the first feedforward gain
    # makes up for that.
    tau, inertia, back_emf, w = 0.52, 0.0020, 0.048, 30.0
    return GripperServoConfig(
        kp=[inertia * w**2 / tau] * 2,
        ki=[0.0] * 2,
        kd=[(3.0 * inertia * w - back_emf) / tau] * 2,
        kff1=[back_emf / tau] * 2,
        kff2=[0.0] * 2,
    )


@dc.dataclass(kw_only=True)
class LinkageDriver(FingerSensingConfig):
    """Two position-controlled cranks, as in the arm thesis.

    closure -> MasterSlaveReference -> GripperServo; the PWM times the servo's stall
    torque is the torque.
    """

    layout: ClassVar[FingerLayout] = LINKAGE_FINGERS

    # A finger that fires 1 mm before it touches does not take a table under a lying
    # cylinder, 3 mm away, for an object. The table under a standing one, 13 mm, is out
    # of range, which spares three quarters of the sensors' time.
    proximity: ProximityConfig = dc.field(
        default_factory=lambda: ProximityConfig(range=0.01, trigger_distance=0.001)
    )
    master_slave: MasterSlaveConfig = dc.field(default_factory=MasterSlaveConfig)
    servo: GripperServoConfig = dc.field(default_factory=_default_servo)
    # Torque at full PWM, over the model's effort limit: supplies sag, motors differ.
    motor_strength: float = dc.field(default=1.0, metadata=positive())


def AddLinkageDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: LinkageDriver | None = None,
    seed: int = 0,
) -> Diagram:
    """Add the driver of a linkage gripper to a diagram with its (finalized) plant.

    .. pydrake_system::

        name: LinkageDriver
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

    The ports are those of `AddSrgPositionDriver`, for both cranks and both fingertips,
    the master's first.
    """
    config = config or LinkageDriver()
    inner = DiagramBuilder()
    period = config.servo.period
    sensing = AddFingerSensing(inner, plant, gripper, config, period=period, seed=seed)
    reference = inner.AddNamedSystem(
        "master_slave_reference", MasterSlaveReference(config.master_slave)
    )
    inner.Connect(sensing.state_measured, reference.GetInputPort("state_measured"))
    inner.Connect(sensing.grasped, reference.GetInputPort("grasped"))
    latency = config.errors.latency
    closure = AddLatency(
        inner, reference.GetInputPort("closure_commanded"), latency, period
    )
    inner.ExportInput(closure, "closure_commanded")
    for name in ("joint_position_commanded", "hold"):
        inner.ExportInput(reference.GetInputPort(name), name)
    AddJointServos(
        inner,
        plant,
        gripper,
        config.joint_names,
        config.servo,
        strength=config.motor_strength,
        state_measured=sensing.state_measured,
        reference=reference.get_output_port(),
    )
    return AddDriver(builder, plant, gripper, inner)
