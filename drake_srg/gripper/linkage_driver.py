"""The master-slave linkage gripper: two servos, one per finger."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.gripper.driver import GripperControl, GripperDriver
from drake_srg.gripper.finger_layout import LINKAGE_FINGERS, FingerLayout
from drake_srg.gripper.finger_sensing import FingerSensing
from drake_srg.gripper.joint_servos import AddJointServos
from drake_srg.gripper.linkage import MasterSlaveConfig, MasterSlaveReference
from drake_srg.gripper.plant_joint_servos import SetPlantServos
from drake_srg.gripper.proximity import ProximityConfig
from drake_srg.gripper.servo import PLANT_LAW, GripperServoConfig
from drake_srg.types import Vector, positive


def _default_servo() -> GripperServoConfig:
    # A crank turns almost only its servo's inertia, J = 0.0020 kg m², and its torque
    # limit is tau = 0.52 N m (linkage_gripper.sdf). Stiffness K = J w² with
    # w = 30 rad/s: from the first contact to the end of the post-contact delay a
    # reference goes on by 0.11 rad, which then presses with K 0.11 rad / 45 mm, 4.5 N
    # per finger. The damping is 3 J w. The back-EMF, b = 0.048 N m s/rad, is a part of
    # it, and the first feedforward gain makes up for that part.
    tau, inertia, back_emf, w = 0.52, 0.0020, 0.048, 30.0
    return GripperServoConfig(
        kp=[inertia * w**2 / tau] * 2,
        ki=[0.0] * 2,
        kd=[(3.0 * inertia * w - back_emf) / tau] * 2,
        kff1=[back_emf / tau] * 2,
        kff2=[0.0] * 2,
    )


@dc.dataclass(kw_only=True)
class LinkageDriver(GripperDriver):
    """Two position-controlled cranks, as in the arm thesis.

    closure -> MasterSlaveReference -> GripperServo. The PWM times the servo's stall
    torque is the torque.
    """

    layout: ClassVar[FingerLayout] = LINKAGE_FINGERS

    # A finger that fires 1 mm before it touches does not mistake the table under a
    # lying cylinder, 3 mm away, for an object, even if it looks all round. The table
    # under a standing one, 13 mm away, is out of range, which saves three quarters of
    # the sensors' time.
    proximity: ProximityConfig = dc.field(
        default_factory=lambda: ProximityConfig(range=0.01, trigger_distance=0.001)
    )
    master_slave: MasterSlaveConfig = dc.field(default_factory=MasterSlaveConfig)
    servo: GripperServoConfig = dc.field(default_factory=_default_servo)
    # Torque at full PWM, as a fraction of the model's effort limit: supply voltages sag
    # and motors differ.
    motor_strength: float = dc.field(default=1.0, metadata=positive())

    def empty_hand(self, closure: float) -> tuple[float, Vector]:
        """See `GripperDriver`."""
        angle = closure * self.master_slave.full_scale
        return angle, np.full(2, angle)

    def prepare_plant(self, plant: MultibodyPlant, gripper: ModelInstanceIndex) -> None:
        """See `GripperDriver`; with the law `plant`, gives the joints their servos."""
        if self.servo.law == PLANT_LAW:
            SetPlantServos(
                plant, gripper, self.joint_names, self.servo, self.motor_strength
            )

    def AddControl(
        self,
        inner: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        sensing: FingerSensing,
    ) -> GripperControl:
        """See `GripperDriver`."""
        reference = inner.AddNamedSystem(
            "master_slave_reference", MasterSlaveReference(self.master_slave)
        )
        inner.Connect(sensing.state_measured, reference.GetInputPort("state_measured"))
        inner.Connect(sensing.grasped, reference.GetInputPort("grasped"))
        servos = AddJointServos(
            inner,
            plant,
            gripper,
            self.joint_names,
            self.servo,
            strength=self.motor_strength,
            state_measured=sensing.state_measured,
            reference=reference.get_output_port(),
        )
        commands = ("closure_commanded", "joint_position_commanded", "hold")
        inputs = {name: reference.GetInputPort(name) for name in commands}
        return GripperControl({**inputs, **servos.inputs}, servos.outputs)


def AddLinkageDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: LinkageDriver | None = None,
    seed: int = 0,
) -> Diagram:
    """Add the driver of a linkage gripper and connect it to the (finalized) plant.

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

    The ports are those of `AddSrgPositionDriver`, for two cranks and two fingertips,
    the master's first.

    Args:
        builder: Of the diagram.
        plant: With the gripper, finalized.
        gripper: Its model instance.
        config: Of the driver.
        seed: Of the encoders' noise.
    """
    return (config or LinkageDriver()).AddDriver(builder, plant, gripper, seed)
