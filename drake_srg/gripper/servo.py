"""The SRG thesis's servo: its minimum-jerk reference, and the law of equation 2.3.

Equation 2.3 of the thesis reads

    PWM = floor(K_FF1 q' + K_FF2 q'' + K_P (q* - q) + K_I (q* - q) q'
                + K_D (q* - q) / q')_kappa

with q the minimum-jerk trajectory and q*, 0 .. 100, the target. No measurement appears
in the equation. `GripperServo` offers three interpretations of it.
"""

import dataclasses as dc
import math

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.common.srg_geometry import SRG
from drake_srg.common.systems import value_or_none
from drake_srg.config import Config, positive
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

# Columns of the discrete state, which has one row per joint.
_START, _DURATION, _TARGET = 0, 1, 2
_COEFFICIENTS = slice(3, 9)

# The peak speed of a rest-to-rest minimum-jerk motion is 15/8 of its mean speed.
_PEAK_TO_MEAN_SPEED = 15.0 / 8.0


@dc.dataclass(kw_only=True)
class MinimumJerkConfig(Config):
    """Limits of the reference's motion."""

    # Peak speed of a rest-to-rest motion [rad/s].
    max_velocity: float = dc.field(default=SRG.joint_speed, metadata=positive())
    # Duration of the shortest motion, such as a small correction [s].
    min_duration: float = dc.field(default=0.08, metadata=positive())
    # Time between readings of the target [s]. Algorithm 1 changes the target at 100 Hz.
    period: float = dc.field(default=0.01, metadata=positive())


def minimum_jerk_coefficients(
    q: float, v: float, a: float, target: float, duration: float
) -> tuple[float, ...]:
    """Return the quintic from (q, v, a) to rest at `target`.

    A quintic is the motion of least integrated squared jerk between given end states
    (T. Flash, N. Hogan, J. Neurosci. 5(7), 1985).

    Args:
        q: Position at the start [rad].
        v: Velocity at the start [rad/s].
        a: Acceleration at the start [rad/s²].
        target: Position at the end [rad].
        duration: Time from start to end [s], positive.

    Returns:
        Its six coefficients in normalised time s = t / duration, lowest power first
        [rad].
    """
    c1 = v * duration
    c2 = 0.5 * a * (duration * duration)
    d = target - q
    return (
        q,
        c1,
        c2,
        10.0 * d - 6.0 * c1 - 3.0 * c2,
        -15.0 * d + 8.0 * c1 + 3.0 * c2,
        6.0 * d - 3.0 * c1 - c2,
    )


class MinimumJerkReference(LeafSystem):
    """Moves n joints to their newest targets with minimum jerk.

    .. pydrake_system::

        name: MinimumJerkReference
        input_ports:
        - position_desired
        - state_measured (optional)
        output_ports:
        - reference

    Every `config.period`, the system compares the targets, `position_desired` (n)
    [rad], with those in use. A joint whose target has changed starts a new quintic from
    its present reference to rest at the target, continuous in position, velocity and
    acceleration. The motion takes the longer of `config.min_duration` and the time that
    keeps a rest-to-rest motion below `config.max_velocity`.

    `reference` (3n) is [q; v; a] in rad, rad/s, rad/s², continuous in time. When a
    simulation starts, it rests at the joints' position according to `state_measured`
    (2n), [q; v].

    Args:
        initial_position: Rest position without `state_measured`, shape (n,) [rad].
        config: Limits of the motion.
    """

    def __init__(
        self, initial_position: Vector, config: MinimumJerkConfig | None = None
    ) -> None:
        super().__init__()
        self.config = config or MinimumJerkConfig()
        self._n = n = len(initial_position)
        rows = np.zeros((n, 9))
        rows[:, _DURATION] = self.config.min_duration
        rows[:, _TARGET] = initial_position
        rows[:, 3] = initial_position
        self._desired = self.DeclareVectorInputPort(name="position_desired", size=n)
        self._measured = self.DeclareVectorInputPort(name="state_measured", size=2 * n)
        self.DeclareDiscreteState(rows.flatten())
        self.DeclareVectorOutputPort(
            name="reference",
            size=3 * n,
            calc=self._calc_reference,
            prerequisites_of_calc={self.time_ticket(), self.xd_ticket()},
        )
        # A simulation need not start at time zero.
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def SetPosition(self, context: Context, position: Vector) -> None:
        """Set the reference to a position at rest.

        Args:
            context: Context of this system.
            position: Position of the joints, shape (n,) [rad].
        """
        context.SetDiscreteState(self._at_rest(context, position))

    def _initialize(self, context: Context, discrete_state: DiscreteValues) -> None:
        measured = value_or_none(self._measured, context)
        if measured is None:
            rows = self._rows(context)
            rows[:, _START] = context.get_time()
            discrete_state.set_value(rows.flatten())
        else:
            discrete_state.set_value(self._at_rest(context, measured[: self._n]))

    def _at_rest(self, context: Context, position: Vector) -> Vector:
        """Return the state of a reference that rests at a position, shape (9n,)."""
        rows = self._rows(context)
        rows[:, _START] = context.get_time()
        rows[:, _TARGET] = position
        rows[:, _COEFFICIENTS] = 0.0
        rows[:, 3] = position
        return rows.flatten()

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        rows, time = self._rows(context).tolist(), context.get_time()
        desired = self._desired.Eval(context).tolist()
        if desired == [row[_TARGET] for row in rows]:
            return
        # Joint by joint, as in `_calc_reference`.
        for row, target in zip(rows, desired, strict=True):
            if row[_TARGET] == target:
                continue
            q, v, a = _evaluate_joint(row, time)
            duration = max(
                self.config.min_duration,
                _PEAK_TO_MEAN_SPEED * abs(target - q) / self.config.max_velocity,
            )
            quintic = minimum_jerk_coefficients(q, v, a, target, duration)
            row[:] = [time, duration, target, *quintic]
        discrete_state.set_value(np.ravel(rows))

    def _calc_reference(self, context: Context, output: BasicVector) -> None:
        # Joint by joint: for so few joints, floats are faster than arrays.
        rows, time = self._rows(context).tolist(), context.get_time()
        q, v, a = zip(*(_evaluate_joint(row, time) for row in rows), strict=True)
        output.SetFromVector([*q, *v, *a])

    def _rows(self, context: Context) -> Vector:
        """Return a copy of the state, one row per joint."""
        state: Vector = context.get_discrete_state(0).CopyToVector()
        return state.reshape(self._n, 9)


def _evaluate_joint(row: list[float], time: float) -> tuple[float, float, float]:
    """Return q, v, a of a row of the state at a time [s]."""
    start, duration, _, c0, c1, c2, c3, c4, c5 = row
    s = min(max((time - start) / duration, 0.0), 1.0)
    q = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
    v = c1 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))
    a = 2 * c2 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))
    return q, v / duration, a / duration**2


LAWS = ("pid", "printed", "literal")
PLANT_LAW = "plant"  # `pid` without integral, solved by the plant (PlantJointServos)


@dc.dataclass(kw_only=True)
class GripperServoConfig(Config):
    """Gains of n servos. PWM is a fraction of full scale, -1 .. 1."""

    kp: list[float] = dc.field(metadata={"ge": 0.0})  # K_P [1/rad]
    # K_I [1/(rad s)]. Zero suits the SRG: to press on an object, Algorithm 1 leaves a
    # position error, which an integral would wind up. In the laws `printed` and
    # `literal`, it multiplies e q' [s/rad²].
    ki: list[float] = dc.field(metadata={"ge": 0.0})
    # K_D [s/rad]. In the laws `printed` and `literal`, it multiplies e / q' [1/s].
    kd: list[float] = dc.field(metadata={"ge": 0.0})
    kff1: list[float]  # K_FF1, on the reference's velocity [s/rad]
    kff2: list[float]  # K_FF2, on the reference's acceleration [s²/rad]
    law: str = dc.field(default="pid", metadata={"among": (*LAWS, PLANT_LAW)})
    # kappa if the port `force_limit` is not connected.
    force_limit: float = dc.field(default=1.0, metadata={"ge": 0.0, "le": 1.0})
    # Time constant with which the integral follows the saturation [s] (anti-windup by
    # back-calculation).
    tracking_time: float = dc.field(default=0.05, metadata=positive())
    # Share of K_FF1 that torque control applies to the measured speed. If K_FF1
    # compensates for back-EMF, 1 would be perfect current control, and a motor on wires
    # would ring for seconds. The default keeps a fifth of the damping, in place of a
    # real motor's friction.
    current_control: float = dc.field(default=0.8, metadata={"ge": 0.0, "le": 1.0})
    # PWM steps from 0 to full scale, such as 1023 for the register of an MX-64; 0 for
    # a continuous PWM.
    pwm_steps: int = dc.field(default=0, metadata={"ge": 0})
    # The laws `printed` and `literal` divide by q'. Below this speed [rad/s], the
    # division fades out.
    printed_law_min_speed: float = dc.field(default=0.05, metadata=positive())
    period: float = dc.field(default=0.005, metadata=positive())  # sample time [s]


def _clip(value: float, limit: float) -> float:
    """Return a value within +-limit."""
    return min(max(value, -limit), limit)


class GripperServo(LeafSystem):
    """Controls n positions by PWM.

    .. pydrake_system::

        name: GripperServo
        input_ports:
        - reference
        - state_measured
        - position_desired (optional)
        - force_limit (optional)
        - torque_commanded (optional)
        output_ports:
        - pwm

    `reference` (3n) is [q; v; a] of the minimum-jerk reference, `state_measured`
    (2n) is [q; v], and `position_desired` (n) is the target that the reference
    moves to, in rad, rad/s, rad/s². Every `config.period`, the servo evaluates
    equation 2.3 of the SRG thesis and holds its output:

        PWM = clip(K_FF1 q' + K_FF2 q'' + feedback, -kappa, kappa)

    where q is the reference. kappa is `force_limit` (1), clipped to 0 .. 1, or
    `config.force_limit` if that port is not connected or NaN.

    * Law `pid`, ours: feedback = K_P e + K_I integral(e) + K_D (v - v_measured),
      where e is the reference minus the measured position. The integral follows the
      saturation (back-calculation), so it does not wind up.
    * Law `printed` takes the terms as printed, and the error as in `pid`: feedback
      = K_P e + K_I e q' + K_D e / q'. It takes q* for the reference, and the q of
      q* - q for the measurement.
    * Law `literal` also takes the symbols as the thesis defines them: the same
      terms with e = `position_desired` minus reference. It uses no measurement, so
      the servo cannot resist a load.

    The laws `printed` and `literal` are for comparison, not for use. They evaluate
    e / q' as e q' / (q'² + s²) with a small s, so that the term fades out at rest.

    The thesis's q* is 0 .. 100 percent of closure. The drivers convert it: one
    percent is `full_scale` / 100 radians of base plus tip angle, from which
    Algorithm 1, or the spool, computes each motor's target. The unit only scales
    the gains; the laws stay the same.

    We interpret the floor brackets with kappa as a symmetric limit. With
    `config.pwm_steps` = N, they also round down: the PWM and kappa become the next
    lower multiples of 1 / N. Negative values become lower, too, so on average the
    PWM shifts by half a step towards opening.

    A finite entry of `torque_commanded` (n), a fraction of the torque at rest at
    full PWM, switches its servo from position to torque control:

        PWM = clip(clip(torque, -kappa, kappa) + c K_FF1 v_measured, -1, 1)

    with c = `config.current_control`, so the torque hardly falls with the speed.
    `config.pwm_steps` applies here, too. The integral does not change during torque
    control.

    `pwm` (n) is the held PWM, a fraction of full scale.
    """

    def __init__(self, config: GripperServoConfig) -> None:
        super().__init__()
        if config.law not in LAWS:
            raise ValueError(
                f"gripper.servo.law: must be one of {', '.join(LAWS)} with this "
                f"driver, got {config.law!r}"
            )
        gains = (config.kp, config.ki, config.kd, config.kff1, config.kff2)
        if len({len(gain) for gain in gains}) != 1:
            raise ValueError(
                "kp, ki, kd, kff1, kff2: need one entry per motor each, got "
                f"{[len(gain) for gain in gains]}"
            )
        self.config = config
        self._gains = gains
        self._n = n = len(config.kp)
        self._reference, self._measured, self._target, self._limit, self._torque = (
            self.DeclareVectorInputPort(name=name, size=size)
            for name, size in (
                ("reference", 3 * n),
                ("state_measured", 2 * n),
                ("position_desired", n),
                ("force_limit", 1),
                ("torque_commanded", n),
            )
        )
        # The integral term of the PWM, and the held PWM.
        self._integral, self._pwm = (self.DeclareDiscreteState(n) for _ in range(2))
        self.DeclareStateOutputPort("pwm", self._pwm)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=config.period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        n, kappa = self._n, self._kappa(value_or_none(self._limit, context))
        absent = [math.nan] * n
        if self.config.law == "literal":
            target = self._target.Eval(context)  # this law needs it
        else:
            target = value_or_none(self._target, context)
        torque = value_or_none(self._torque, context)
        wanted = self._reference.Eval(context).tolist()
        measured = self._measured.Eval(context).tolist()
        integrals = context.get_discrete_state(self._integral).CopyToVector()
        # Motor by motor: for so few of them, floats are faster than arrays.
        motors = zip(
            *self._gains,
            wanted[:n],
            wanted[n : 2 * n],
            wanted[2 * n :],
            measured[:n],
            measured[n:],
            absent if target is None else target.tolist(),
            absent if torque is None else torque.tolist(),
            integrals.tolist(),
            strict=True,
        )
        results = [self._motor(kappa, *values) for values in motors]
        for index, values in zip(
            (self._integral, self._pwm), zip(*results, strict=True), strict=True
        ):
            discrete_state.set_value(index, values)

    def _motor(
        self,
        kappa: float,
        kp: float,
        ki: float,
        kd: float,
        kff1: float,
        kff2: float,
        q: float,
        v: float,
        a: float,
        q_measured: float,
        v_measured: float,
        target: float,
        torque: float,
        integral: float,
    ) -> tuple[float, float]:
        """Return the next integral and PWM of a motor."""
        config = self.config
        error = target - q if config.law == "literal" else q - q_measured
        pwm = kff1 * v + kff2 * a + kp * error
        if config.law == "pid":
            pwm = pwm + kd * (v - v_measured) + integral
        else:
            guard = config.printed_law_min_speed**2
            pwm = pwm + ki * error * v + kd * error * v / (v * v + guard)
        limit, saturated = kappa, _clip(pwm, kappa)
        if math.isfinite(torque):
            compensated = config.current_control * kff1 * v_measured
            saturated = _clip(_clip(torque, kappa) + compensated, 1.0)
            limit = 1.0
        elif ki > 0:
            rate = ki * error + (saturated - pwm) / config.tracking_time
            integral = integral + config.period * rate
        if config.pwm_steps:
            steps = config.pwm_steps  # the PWM rounds down, the limit towards zero
            saturated = max(np.floor(steps * saturated), -np.floor(steps * limit))
            saturated = saturated / steps
        return integral, saturated

    def _kappa(self, force_limit: Vector | None) -> float:
        if force_limit is None or math.isnan(force_limit[0]):
            return self.config.force_limit
        return min(max(float(force_limit[0]), 0.0), 1.0)
