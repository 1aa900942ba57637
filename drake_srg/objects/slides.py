"""Slides: furniture that moves objects, such as a tray on a linear axis."""

import dataclasses as dc

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Joint,
    JointActuator,
    PdControllerGains,
    RevoluteJoint,
)
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.common.systems import AddVelocityFeedforward
from drake_srg.config import Config, positive

# Natural frequency of the critically damped controller, like the arm's [rad/s].
_FREQUENCY = 40.0


@dc.dataclass(kw_only=True)
class SlideConfig(Config):
    """Prescribed motion of a model's one actuated joint."""

    # Speed along the joint's axis [m/s] or about it [rad/s].
    speed: float = 0.05
    # Start of the motion [s], and duration of the acceleration and of the stop [s].
    start: float = dc.field(default=0.0, metadata={"ge": 0.0})
    ramp: float = dc.field(default=0.25, metadata=positive())
    # Travel from start to stop, in either direction [m or rad].
    travel: float = dc.field(default=0.4, metadata=positive())


def SetSlideGains(plant: MultibodyPlant, name: str) -> None:
    """Give a slide's actuator its gains, before the plant is finalized.

    Raises:
        ValueError: If there is no such model, or it does not have exactly one actuator.
    """
    if not plant.HasModelInstanceNamed(name):
        raise ValueError(f"slides.{name}: no model of that name among the directives")
    actuator = _actuator(plant, name)
    inertia = _inertia(actuator.joint())
    kp, kd = inertia * _FREQUENCY**2, 2.0 * inertia * _FREQUENCY
    actuator.set_controller_gains(PdControllerGains(p=kp, d=kd))


def AddSlide(
    builder: DiagramBuilder, plant: MultibodyPlant, name: str, config: SlideConfig
) -> TrajectorySource:
    """Add `slide_NAME`, which moves a slide of a finalized plant.

    In a continuous plant, it also adds `slide_NAME_desired_position` and
    `slide_NAME_velocity_feedforward`.

    Args:
        builder: Builder of the diagram that contains the plant.
        plant: Plant with the slide's gains set by `SetSlideGains`.
        name: Name of the model instance.
        config: Motion of the slide.
    """
    actuator = _actuator(plant, name)
    q_start = float(actuator.joint().default_positions()[0])
    source = builder.AddNamedSystem(
        f"slide_{name}",
        TrajectorySource(slide_motion(config, q_start), output_derivative_order=1),
    )
    model, desired = actuator.model_instance(), source.get_output_port()
    if plant.time_step() == 0.0:
        kd = np.array([actuator.get_controller_gains().d])
        desired, torque = AddVelocityFeedforward(builder, desired, kd, f"slide_{name}_")
        builder.Connect(torque, plant.get_actuation_input_port(model))
    builder.Connect(desired, plant.get_desired_state_input_port(model))
    return source


def slide_motion(config: SlideConfig, q_start: float) -> PiecewisePolynomial:
    """Return the joint's position over time, from rest to rest.

    Args:
        config: Motion of the slide.
        q_start: Position at the start [m or rad].
    """
    speed = abs(config.speed)
    if speed == 0.0:
        return PiecewisePolynomial(np.array([[q_start]]))
    # Each ramp takes `ramp`, and both together cover speed * ramp.
    ramp = min(config.ramp, config.travel / speed)
    even = config.travel / speed - ramp
    path = np.cumsum([0.0, 0.0, 0.5 * speed * ramp, speed * even, 0.5 * speed * ramp])
    times = np.cumsum([0.0, max(config.start, 1e-3), ramp, max(even, 1e-6), ramp])
    velocities = np.array([0.0, 0.0, speed, speed, 0.0])
    sign = np.sign(config.speed)
    return PiecewisePolynomial.CubicHermite(
        times, (q_start + sign * path)[np.newaxis], (sign * velocities)[np.newaxis]
    )


def _actuator(plant: MultibodyPlant, name: str) -> JointActuator:
    model = plant.GetModelInstanceByName(name)
    actuators = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    found = [actuator for actuator in actuators if actuator.model_instance() == model]
    if len(found) != 1:
        raise ValueError(
            f"slides.{name}: needs exactly one actuated joint, got {len(found)}"
        )
    return found[0]


def _inertia(joint: Joint) -> float:
    """Return what a joint's actuator accelerates: mass [kg], or inertia [kg m²]."""
    body = joint.child_body()
    if not isinstance(joint, RevoluteJoint):
        return float(body.default_mass())
    X_BJ = joint.frame_on_child().GetFixedPoseInBodyFrame()
    M_BJ_B = body.default_spatial_inertia().Shift(X_BJ.translation())
    axis_B = X_BJ.rotation() @ joint.revolute_axis()
    return float(axis_B @ M_BJ_B.CalcRotationalInertia().CopyToFullMatrix3() @ axis_B)
