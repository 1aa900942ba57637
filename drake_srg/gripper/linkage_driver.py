"""The master-slave linkage gripper: its reference and its driver."""

import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
)

from drake_srg.common.systems import value_or_none
from drake_srg.config import Config, positive
from drake_srg.gripper.driver import FingerSensing, GripperControl
from drake_srg.gripper.joint_servos import AddJointServos, JointServoDriver
from drake_srg.gripper.sensors import LINKAGE_FINGERS, FingerLayout, ProximityConfig
from drake_srg.gripper.servo import GripperServoConfig
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

# Entries of the discrete state: reference angles and speeds of both cranks, the time of
# their last update, the last closure, and whether something is gripped.
_ANGLES, _SPEEDS, _TIME, _CLOSURE, _GRIPPED = slice(0, 2), slice(2, 4), 4, 5, 6

# Gain of the slave: its speed over its lag behind the master [1/s].
SLAVE_GAIN = 20.0


@dc.dataclass(kw_only=True)
class MasterSlaveConfig(Config):
    """Parameters of the fingers' motion, with the arm thesis's values."""

    # Crank angle of the master at closure 1 [rad]: a little beyond 0.681, where flat
    # pads meet.
    full_scale: float = dc.field(default=0.69, metadata=positive(le=0.69))
    # Speed of either crank [rad/s]: 60 degrees/s.
    max_velocity: float = dc.field(default=np.pi / 3, metadata=positive())
    # Time between evaluations [s]: the period of the proximity sensors.
    period: float = dc.field(default=0.01, metadata=positive())


class MasterSlaveReference(LeafSystem):
    """Turns one closure command into the motion of the master's and the slave's crank.

    .. pydrake_system::

        name: MasterSlaveReference
        input_ports:
        - closure_commanded
        - state_measured
        - grasped
        - joint_position_commanded (optional)
        - hold (optional)
        output_ports:
        - reference

    The cranks are in the order master, slave. Their angles increase as they close.
    Every `config.period`, the system chooses their speeds:

    * The master moves at `config.max_velocity` to the angle that `closure_commanded`
      (1) commands: 0 open .. 1 closed, clipped, NaN ignored.
    * The slave follows at clip(gain (master - slave), +-max_velocity), with the angles
      of `state_measured` (4), [q; v]. (The thesis has -master because its joints turn
      against each other.) At full speed, it lags by max_velocity / gain, 3 degrees.
    * Once `grasped` (1) is nonzero while the master closes, both stand still. Their
      references are then beyond the contact, so the fingers press. The grip ends only
      when the command opens the master. If the object is lost, both cranks stay at
      rest.
    * While the hand opens and the slave's reference still presses, the slave does not
      follow the master. Both references return at full speed, so the grip fades equally
      on both sides and neither finger pushes the object. After that, the slave follows
      but never closes while the master opens.
    * A finite entry of `joint_position_commanded` (2) [rad] overrides these rules for
      its crank, which moves to that angle at `config.max_velocity`.
    * While `hold` (1) is nonzero, both stand still and keep their grip.

    `reference` (6) is [q; v; a] in rad, rad/s, rad/s² for a servo. q is continuous in
    time and within 0 .. full_scale; a is zero. When a simulation starts, q is the
    cranks' position.
    """

    def __init__(self, config: MasterSlaveConfig | None = None) -> None:
        super().__init__()
        self.config = config or MasterSlaveConfig()
        self._closure, self._measured, self._grasped, self._commanded, self._hold = (
            self.DeclareVectorInputPort(name=name, size=size)
            for name, size in (
                ("closure_commanded", 1),
                ("state_measured", 4),
                ("grasped", 1),
                ("joint_position_commanded", 2),
                ("hold", 1),
            )
        )
        self.DeclareDiscreteState([0.0] * 7)
        self.DeclareVectorOutputPort(
            name="reference",
            size=6,
            calc=self._calc_reference,
            prerequisites_of_calc={self.time_ticket(), self.xd_ticket()},
        )
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _initialize(self, context: Context, discrete_state: DiscreteValues) -> None:
        config = self.config
        angles = np.clip(self._measured.Eval(context)[:2], 0.0, config.full_scale)
        closure = angles[0] / config.full_scale
        time = context.get_time()
        discrete_state.set_value([*angles, 0.0, 0.0, time, closure, 0.0])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        config, time = self.config, context.get_time()
        state = context.get_discrete_state(0).value()
        angles, gripped = _angles(time, state), bool(state[_GRIPPED])
        closure = self._closure.Eval(context)[0]
        if not np.isfinite(closure):
            closure = state[_CLOSURE]
        closure = min(max(closure, 0.0), 1.0)
        hold = value_or_none(self._hold, context)
        if hold is not None and hold[0] != 0.0:
            speeds = np.zeros(2)
        else:
            measured = self._measured.Eval(context)[:2]
            target = config.full_scale * closure
            opens = target < angles[0]
            grasped = self._grasped.Eval(context)[0] != 0.0
            gripped = not opens and (gripped or grasped)
            follow = SLAVE_GAIN * (measured[0] - measured[1])
            if opens:
                presses = angles[1] > measured[1]
                follow = -config.max_velocity if presses else min(follow, 0.0)
            lead = (target - angles[0]) / config.period
            speeds = np.zeros(2) if gripped else np.array([lead, follow])
            wanted = value_or_none(self._commanded, context)
            if wanted is not None:
                to_wanted = (wanted - angles) / config.period
                speeds = np.where(np.isfinite(wanted), to_wanted, speeds)
        speeds = np.clip(speeds, -config.max_velocity, config.max_velocity)
        last = np.clip(angles + speeds * config.period, 0.0, config.full_scale)
        speeds = (last - angles) / config.period
        discrete_state.set_value([*angles, *speeds, time, closure, float(gripped)])

    def _calc_reference(self, context: Context, output: BasicVector) -> None:
        state = context.get_discrete_state(0).value()
        angles = _angles(context.get_time(), state)
        output.SetFromVector([*angles, *state[_SPEEDS], 0.0, 0.0])


def _angles(time: float, state: Vector) -> Vector:
    """Return the angles of the references now, shape (2,) [rad]."""
    return state[_ANGLES] + state[_SPEEDS] * (time - state[_TIME])


def _default_servo() -> GripperServoConfig:
    # A crank's inertia is almost only its servo's, J = 0.0020 kg m², and its torque
    # limit is tau = 0.52 N m (linkage_gripper.sdf). Stiffness K = J w² with w = 30
    # rad/s. From the first contact to the end of the post-contact delay, a reference
    # advances by 0.11 rad, which presses with K 0.11 rad / 45 mm, 4.5 N per finger. The
    # damping is 3 J w. It includes the back-EMF, b = 0.048 N m s/rad, for which the
    # first feedforward gain compensates.
    tau, inertia, back_emf, w = 0.52, 0.0020, 0.048, 30.0
    return GripperServoConfig(
        kp=[inertia * w**2 / tau] * 2,
        ki=[0.0] * 2,
        kd=[(3.0 * inertia * w - back_emf) / tau] * 2,
        kff1=[back_emf / tau] * 2,
        kff2=[0.0] * 2,
    )


@dc.dataclass(kw_only=True)
class LinkageDriver(JointServoDriver):
    """Two position-controlled cranks, as in the arm thesis.

    closure -> MasterSlaveReference -> GripperServo. The torque is the PWM times the
    servo's stall torque.

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

    The ports are those of `SrgPositionDriver`, for two cranks and two fingertips, the
    master's first.
    """

    layout: ClassVar[FingerLayout] = LINKAGE_FINGERS

    # Sensors fire 1 mm before contact. In a grasp of a lying cylinder, the table is 3
    # mm away, so they do not mistake it for an object, even if they look all round. In
    # a grasp of a standing cylinder, the table is 13 mm away and out of range, which
    # saves three quarters of the sensors' time.
    proximity: ProximityConfig = dc.field(
        default_factory=lambda: ProximityConfig(range=0.01, trigger_distance=0.001)
    )
    master_slave: MasterSlaveConfig = dc.field(default_factory=MasterSlaveConfig)
    servo: GripperServoConfig = dc.field(default_factory=_default_servo)

    def empty_hand(self, closure: float) -> tuple[float, Vector]:
        """Return the travel of one motor for an empty hand, and its joints [rad]."""
        angle = closure * self.master_slave.full_scale
        return angle, np.full(2, angle)

    def AddControl(
        self,
        inner: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        sensing: FingerSensing,
    ) -> GripperControl:
        """Add the systems from commands to the actuators, and return their ports."""
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
