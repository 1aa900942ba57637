"""The servo's reference: minimum-jerk motion to the newest target."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.common.srg_geometry import SRG
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector, positive

# Columns of the discrete state, which has one row per joint.
_START, _DURATION, _TARGET = 0, 1, 2
_COEFFICIENTS = slice(3, 9)

# The peak speed of a rest-to-rest minimum-jerk motion is 15/8 of its mean speed.
_PEAK_TO_MEAN_SPEED = 15.0 / 8.0


@dc.dataclass(kw_only=True)
class MinimumJerkConfig:
    """How fast the reference moves."""

    # Peak speed of a rest-to-rest motion [rad/s].
    max_velocity: float = dc.field(default=SRG.joint_speed, metadata=positive())
    # Shortest motion [s]: small corrections take this long.
    min_duration: float = dc.field(default=0.08, metadata=positive())
    # Time between readings of the target [s]: Algorithm 1 changes it at 100 Hz.
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
        output_ports:
        - reference

    Every `config.period`, the system compares the targets, `position_desired` (n)
    [rad], with those in use. A joint whose target has changed starts a new quintic from
    its reference (position, velocity and acceleration stay continuous) to rest at the
    target. It takes the longer of `config.min_duration` and the time that keeps a
    rest-to-rest motion below `config.max_velocity`.

    `reference` (3n) is [q; v; a] in rad, rad/s, rad/s², continuous in time.

    Args:
        initial_position: Of the joints, shape (n,) [rad].
        config: How fast the reference moves.
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
        """Put the reference at rest.

        Args:
            context: This system's.
            position: Of the joints, shape (n,) [rad].
        """
        rows = self._rows(context)
        rows[:, _TARGET] = position
        rows[:, _COEFFICIENTS] = 0.0
        rows[:, 3] = position
        context.SetDiscreteState(rows.flatten())

    def _initialize(self, context: Context, discrete_state: DiscreteValues) -> None:
        rows = self._rows(context)
        rows[:, _START] = context.get_time()
        discrete_state.set_value(rows.flatten())

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        rows, time = self._rows(context).tolist(), context.get_time()
        desired = self._desired.Eval(context).tolist()
        if desired == [row[_TARGET] for row in rows]:
            return
        # Joint by joint, like the output.
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
