"""The base joints of an SRG under a servo law alone.

The palm is fixed and the fingers move horizontally, so that their weight has no effect.
The reference bypasses the minimum-jerk generator.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, MatrixGain, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.gripper.servo import GripperServo, GripperServoConfig
from drake_srg.gripper.underactuation import JOINT_NAMES
from drake_srg.parsing import AddModel
from drake_srg.types import Vector

STEP = 0.001  # of the plant, the log and the tabulated references [s]
_BASES = np.array([1.0, 1.0, 0.0, 0.0])  # moving and loaded joints of JOINT_NAMES


@dc.dataclass(frozen=True)
class Motion:
    """A motion of the base joints; all functions take times (K,) [s].

    Attributes:
        reference: Returns angle [rad], speed [rad/s] and acceleration [rad/s²], (K,)
            each.
        force_limit: kappa, a fraction of full PWM.
        load: Returns the torque on each base joint, positive where it closes, (K,)
            [N m].
        target: Returns the target of the base joints, (K,) [rad]; None if the reference
            is its own target.
        duration: Of the motion [s].
        servo_period: Sample time of the servo [s]; None for that of its config.
    """

    reference: Callable[[Vector], tuple[Vector, Vector, Vector]]
    force_limit: float
    load: Callable[[Vector], Vector] = np.zeros_like
    target: Callable[[Vector], Vector] | None = None
    duration: float = 2.0
    servo_period: float | None = None


@dc.dataclass(frozen=True)
class Response:
    """The left base joint over time, (K,) each; in s, rad, rad/s and full PWM."""

    time: Vector
    reference: Vector
    reference_speed: Vector
    q: Vector
    pwm: Vector

    @property
    def error(self) -> Vector:
        """Reference minus measurement [rad]."""
        return self.reference - self.q


@dc.dataclass(frozen=True)
class Joint:
    """Properties of the plant's left base joint."""

    torque_limit: float  # N m, at full PWM
    inertia: float  # kg m², motor and straight finger
    damping: float  # N m s/rad


def simulate(config: GripperServoConfig, motion: Motion) -> tuple[Response, Joint]:
    """Move the base joints under a servo law."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=STEP, discrete_contact_approximation="lagged"),
        builder,
    )
    gripper = AddModel(plant, "package://drake_srg/sdf/srg.sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm", gripper))
    plant.Finalize()

    joints = [plant.GetJointByName(f"{name}_joint", gripper) for name in JOINT_NAMES]
    order = [joint.index() for joint in joints]
    torque_limits = [
        plant.get_joint_actuator(i).effort_limit()
        for i in plant.GetJointActuatorIndices()
    ]
    to_ours = plant.MakeStateSelectorMatrix(order)  # of [q; v]
    encoders = builder.AddSystem(MatrixGain(to_ours))
    motors = builder.AddSystem(
        MatrixGain(np.diag(torque_limits) @ plant.MakeActuatorSelectorMatrix(order))
    )
    servo = builder.AddSystem(
        GripperServo(
            dc.replace(
                config,
                force_limit=motion.force_limit,
                period=motion.servo_period or config.period,
            )
        )
    )
    time = np.arange(0.0, motion.duration + 1.5 * STEP, STEP)
    q, v, a = (np.outer(_BASES, row) for row in motion.reference(time))
    reference = _table(builder, time, np.vstack([q, v, a]))
    targets = q if motion.target is None else np.outer(_BASES, motion.target(time))
    target = _table(builder, time, targets)
    loaded = to_ours[len(order) :, len(order) :].T @ _BASES
    load = _table(builder, time, np.outer(loaded, motion.load(time)))
    for output, port in (
        (plant.get_state_output_port(gripper), encoders.get_input_port()),
        (encoders.get_output_port(), servo.GetInputPort("state_measured")),
        (reference.get_output_port(), servo.GetInputPort("reference")),
        (target.get_output_port(), servo.GetInputPort("position_desired")),
        (servo.get_output_port(), motors.get_input_port()),
        (motors.get_output_port(), plant.get_actuation_input_port(gripper)),
        (load.get_output_port(), plant.get_applied_generalized_force_input_port()),
    ):
        builder.Connect(output, port)
    logs = [
        LogVectorOutput(system.get_output_port(), builder, STEP)
        for system in (reference, encoders, servo)
    ]
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    for joint, angle in zip(joints, q[:, 0], strict=True):
        joint.set_angle(plant_context, angle)
    simulator.AdvanceTo(motion.duration)

    asked, measured, pwm = (log.FindLog(context).data() for log in logs)
    times = logs[0].FindLog(context).sample_times()
    i = joints[0].velocity_start()
    return (
        Response(times, asked[0], asked[len(joints)], measured[0], pwm[0]),
        Joint(
            plant.GetJointActuatorByName("left_base_joint", gripper).effort_limit(),
            plant.CalcMassMatrix(plant_context)[i, i],
            joints[0].default_damping(),
        ),
    )


def _table(builder: DiagramBuilder, time: Vector, values: Vector) -> Any:
    trajectory = PiecewisePolynomial.FirstOrderHold(time, values)
    return builder.AddSystem(TrajectorySource(trajectory))
