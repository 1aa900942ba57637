"""The SRG driven by PD actuators of the plant, for fast simulations."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, DiscreteValues
from pydrake.systems.primitives import MatrixGain, Multiplexer, Saturation

from drake_srg.common.srg_geometry import SRG
from drake_srg.common.systems import (
    input_ports,
    joint_to_actuator,
    model_actuators,
    value_or_none,
)
from drake_srg.config import positive
from drake_srg.gripper.driver import (
    FingerSensing,
    GraspDetectorConfig,
    GripperControl,
)
from drake_srg.gripper.joint_servos import JointServoDriver, SetPlantServos
from drake_srg.gripper.sensors import SRG_FINGERS, FingerLayout, ProximityConfig
from drake_srg.gripper.servo import GripperServoConfig
from drake_srg.gripper.srg_position_driver import SrgPositionDriver
from drake_srg.gripper.tendon import empty_hand
from drake_srg.gripper.underactuation import UnderactuationConfig, UnderactuationLogic
from drake_srg.types import Vector


class PlantServoLogic(UnderactuationLogic):
    """Algorithm 1, with targets that limit the force of the servos.

    .. pydrake_system::

        name: PlantServoLogic
        input_ports:
        - closure_commanded
        - state_measured
        - triggered
        - joint_position_commanded (optional)
        - hold (optional)
        - closure_messages (with per_message)
        - force_limit (optional)
        output_ports:
        - position_desired

    A proportional servo whose error e satisfies K_P e = kappa presses with the fraction
    kappa of its torque. `force_limit` (1) is kappa, 0 .. 1: every `config.period`, the
    targets are limited to within kappa / K_P of the measured angles. If the port is not
    connected or is NaN, the argument `force_limit` applies. The other ports are those
    of `UnderactuationLogic`.

    Args:
        kp: Gains K_P, shape (4,) [1/rad].
        force_limit: Default of kappa.
        config: Parameters of the algorithm.
    """

    def __init__(
        self,
        kp: Vector,
        force_limit: float = 1.0,
        config: UnderactuationConfig | None = None,
    ) -> None:
        super().__init__(config)
        self._kp = kp
        self._default_limit = force_limit
        self._limit = self.DeclareVectorInputPort(name="force_limit", size=1)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        super()._update(context, discrete_state)
        kappa, force_limit = self._default_limit, value_or_none(self._limit, context)
        if force_limit is not None and np.isfinite(force_limit[0]):
            kappa = min(max(float(force_limit[0]), 0.0), 1.0)
        if kappa == 1.0:
            return  # the plant limits the torque
        q, ahead = self._measured.Eval(context)[:4], kappa / self._kp
        desired = discrete_state.value(self._desired)
        desired = np.clip(desired, q - ahead, q + ahead)
        discrete_state.set_value(self._desired, desired)


# Control period [s]. It must be exact in binary: otherwise, some steps would be as
# short as a rounding error.
_PERIOD = 3 / 64


def _default_servo() -> GripperServoConfig:
    # The stiffness of SrgPositionDriver. The motor's back-EMF overdamps the joint, so
    # K_D is zero.
    zero = [0.0] * 4
    return GripperServoConfig(
        kp=SrgPositionDriver().servo.kp,
        ki=zero,
        kd=list(zero),
        kff1=list(zero),
        kff2=list(zero),
        period=_PERIOD,
    )


@dc.dataclass(kw_only=True)
class PlantServoDriver(JointServoDriver):
    """Four joints that the plant controls, commanded once per control period.

    closure -> PlantServoLogic -> the plant's PD actuators. Between two evaluations of
    Algorithm 1, only the plant is computed. It solves the servos' stiffness and torque
    limits implicitly. There is no reference for the motion: the motors' back-EMF limits
    the speed. A joint without load turns at `no_load_speed` at full torque, and slows
    down near its target.

    .. pydrake_system::

        name: PlantServoDriver
        input_ports:
        - plant_state
        - query_object (with proximity)
        - contact_results
        - body_poses
        - closure_commanded
        - joint_position_commanded (optional)
        - hold (optional)
        - force_limit (optional)
        - closure_messages (with per_message)
        output_ports:
        - state_measured
        - proximity (with proximity)
        - contact_force
        - contact_wrench
        - grasped
        - pwm
        - desired_state

    The ports are those of `SrgPositionDriver`, except that `desired_state` (8), [q; v]
    in the order of the gripper's actuators, goes to the plant in place of torques, and
    that `pwm` (4) is the servos' share of the torque, without the back-EMF.

    Call `prepare_plant` before the plant is finalized.
    """

    layout: ClassVar[FingerLayout] = SRG_FINGERS

    trigger: str = "touch"
    # Null leaves out these sensors and the port `proximity`, which the planners need. A
    # reading takes as much time as four steps of the plant.
    proximity: ProximityConfig | None = dc.field(  # type: ignore[assignment]  # optional here alone
        default_factory=lambda: ProximityConfig(period=_PERIOD)
    )
    grasp_detector: GraspDetectorConfig = dc.field(
        default_factory=lambda: GraspDetectorConfig(period=_PERIOD)
    )
    underactuation: UnderactuationConfig = dc.field(
        default_factory=lambda: UnderactuationConfig(period=_PERIOD)
    )
    # The plant's actuators have only K_P, K_D and a limit, so all other gains must be
    # zero.
    servo: GripperServoConfig = dc.field(default_factory=_default_servo)
    # Speed of a joint without load at full torque [rad/s].
    no_load_speed: float = dc.field(default=SRG.joint_speed, metadata=positive())

    def empty_hand(self, closure: float) -> tuple[float, Vector]:
        """Return the travel of one motor for an empty hand, and its joints [rad]."""
        config = self.underactuation
        return empty_hand(closure, config.full_scale, config.base_limit)

    def prepare_plant(self, plant: MultibodyPlant, gripper: ModelInstanceIndex) -> None:
        """Give the joints their gains, limits and back-EMF.

        Raises:
            ValueError: If the servos have other terms than K_P and K_D.
        """
        servo = self.servo
        if any([*servo.ki, *servo.kff1, *servo.kff2, servo.pwm_steps]) or (
            servo.law != "pid"
        ):
            raise ValueError(
                "gripper.servo: the plant's servos have only kp and kd (allowed: "
                "law pid; ki, kff1, kff2 and pwm_steps 0)"
            )
        SetPlantServos(plant, gripper, self.joint_names, servo, self.motor_strength)
        for actuator in model_actuators(plant, gripper):
            damping = actuator.effort_limit() / self.no_load_speed
            actuator.joint().set_default_damping(damping)

    def AddControl(
        self,
        inner: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        sensing: FingerSensing,
    ) -> GripperControl:
        """Add the systems from commands to the actuators, and return their ports."""
        kp, kd = np.array(self.servo.kp), np.array(self.servo.kd)
        logic = inner.AddNamedSystem(
            "plant_servo_logic",
            PlantServoLogic(kp, self.servo.force_limit, self.underactuation),
        )
        inner.Connect(sensing.state_measured, logic.GetInputPort("state_measured"))
        inner.Connect(sensing.triggered, logic.GetInputPort("triggered"))
        order = joint_to_actuator(plant, gripper, self.joint_names)
        desired = inner.AddNamedSystem(
            "desired_state", MatrixGain(np.vstack([order, np.zeros_like(order)]))
        )
        inner.Connect(logic.get_output_port(), desired.get_input_port())
        pwm = _AddPwm(inner, kp, kd)
        inner.Connect(logic.get_output_port(), pwm.get_input_port(0))
        inner.Connect(sensing.state_measured, pwm.get_input_port(1))
        measured = ("state_measured", "triggered")
        return GripperControl(
            {k: v for k, v in input_ports(logic).items() if k not in measured},
            {
                "pwm": pwm.get_output_port(),
                "desired_state": desired.get_output_port(),
            },
        )


def _AddPwm(inner: DiagramBuilder, kp: Vector, kd: Vector) -> Diagram:
    """Add `pwm`, which evaluates the plant's law for a target (4) and a state (8)."""
    builder = DiagramBuilder()
    mux = builder.AddSystem(Multiplexer([4, 8]))
    law = builder.AddSystem(
        MatrixGain(np.hstack([np.diag(kp), -np.diag(kp), -np.diag(kd)]))
    )
    limit = builder.AddSystem(Saturation(-np.ones(4), np.ones(4)))
    builder.Connect(mux.get_output_port(), law.get_input_port())
    builder.Connect(law.get_output_port(), limit.get_input_port())
    builder.ExportInput(mux.get_input_port(0), "position_desired")
    builder.ExportInput(mux.get_input_port(1), "state_measured")
    builder.ExportOutput(limit.get_output_port(), "pwm")
    return inner.AddNamedSystem("pwm", builder.Build())
