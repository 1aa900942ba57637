"""Disturbances: forces on objects that do not come from the robot."""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex, SpatialInertia
from pydrake.systems.framework import Context, EventStatus, State

from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.common.shared import Shared
from drake_srg.config import Config, positive
from drake_srg.lifetime import LeafSystem
from drake_srg.types import (
    AnyMode,
    Box,
    Cylinder,
    Mode,
    Shape,
    Vector,
    mode_name,
)


@dc.dataclass(kw_only=True)
class Disturbance(Config):
    """A disturbance: its object and its time."""

    # The planner's mode that triggers it.
    at: str = dc.field(
        default=Mode.PRE_GRASP.value,
        metadata={
            "among": tuple(m.value for m in Mode if m not in (Mode.DONE, Mode.FAILED))
        },
    )
    # Delay from the mode's beginning [s]; the mode may end before.
    after: float = dc.field(default=0.0, metadata={"ge": 0.0})
    # Largest number of repetitions, one for each beginning of the mode.
    times: int = dc.field(default=1, metadata={"ge": 1})
    object: str | None = None  # null: the picked one


@dc.dataclass(kw_only=True)
class Push(Disturbance):
    """A hand lifts the object a little, moves it without turning it, and lets go.

    Its force is at most three times the object's weight, so a firmly held object stays.
    """

    # Displacement of the object, in world [m].
    displacement: list[float] = dc.field(
        default_factory=lambda: [0.03, 0.0, 0.0], metadata={"length": 3}
    )
    duration: float = dc.field(default=0.4, metadata=positive())  # s, rest to rest


@dc.dataclass(kw_only=True)
class Topple(Disturbance):
    """A hand pushes at the top of a cylinder or box, ever harder, until it falls."""

    # Horizontal, [x, y] in world, of any length.
    direction: list[float] = dc.field(
        default_factory=lambda: [1.0, 0.0], metadata={"length": 2}
    )


@dc.dataclass(kw_only=True)
class Force(Disturbance):
    """A constant force at the object's centre of mass, and a constant torque."""

    force: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 0.0], metadata={"length": 3}
    )  # N, in world
    torque: list[float] = dc.field(
        default_factory=lambda: [0.0, 0.0, 0.0], metadata={"length": 3}
    )  # N m, in world
    duration: float = dc.field(default=0.1, metadata=positive())  # s


AnyDisturbance: TypeAlias = Push | Topple | Force


_GRAVITY = 9.81  # m/s²
# Height by which a pushing hand lifts the object [m]. Sliding would depend on friction,
# and with steps above 2 ms, a stiff object rattles as it slides on a table.
_PUSH_LIFT = 0.002
# Natural frequency of the spring between hand and object [rad/s]: a third of the
# stability limit with steps of 10 ms, and fast compared to a push of 0.3 s.
_PUSH_FREQUENCY = 25.0
# Time for which the hand stays at the end of its path [s]: four time constants.
_PUSH_HOLD = 4.0 / _PUSH_FREQUENCY
# Largest force of a pushing hand, over the object's weight. To carry the object takes
# 1, and to accelerate it less than 1 more. So objects that are held or blocked stay.
_LARGEST_PUSH = 3.0
# A toppling force grows by one weight in this time [s]. That is slow compared to the
# 0.1 s in which objects of a hand's size fall, so the object is tipped, not hit.
_TOPPLE_RAMP = 1.0
# Time after which the hand gives up on an object that slides instead of falling [s].
_TOPPLE_PATIENCE = 2.0


@dc.dataclass(frozen=True)
class Target:
    """The object that is disturbed."""

    name: str
    body: BodyIndex  # its frame is the object's
    inertia: SpatialInertia  # about the object's origin
    shape: Shape | None  # None: unknown; then the origin is underneath the object


@dc.dataclass(frozen=True)
class Course:
    """Progress of a disturbance."""

    count: int = 0  # how often it has been triggered
    begin: float = np.inf  # when it last began or will begin [s]; inf: not triggered
    # For a push: the object's pose at the beginning, and its last error from the path,
    # rotation [rad] before translation [m], shape (6,).
    X_WO_begin: RigidTransform | None = None
    error: Vector = dc.field(default_factory=lambda: np.zeros(6))


# A force [N] and a torque [N m] in world, and their point of application in the
# object's frame [m].
Wrench: TypeAlias = tuple[Vector, Vector, Vector]


def disturb(
    disturbance: AnyDisturbance,
    target: Target,
    t: float,
    X_WO: RigidTransform,
    course: Course,
    period: float,
) -> tuple[Course, Wrench | None]:
    """Return the present force of a disturbance that has begun.

    Args:
        disturbance: The disturbance.
        target: The object that is disturbed.
        t: Time since the beginning [s].
        X_WO: The object's pose now.
        course: The disturbance's progress at the last update.
        period: Time between updates [s].

    Returns:
        The progress now, and the wrench; None instead of a wrench once the disturbance
        is over.
    """
    wrench: Wrench | None = None
    match disturbance:
        case Force():
            if t < disturbance.duration:
                force, torque = disturbance.force, disturbance.torque
                p_OC = target.inertia.get_com()
                wrench = np.array(force), np.array(torque), p_OC
        case Topple():
            wrench = _topple(disturbance, target, t, X_WO)
        case Push():
            if t < disturbance.duration + _PUSH_HOLD:
                return _push(disturbance, target, t, X_WO, course, period)
    return (Course(course.count) if wrench is None else course), wrench


def _topple(
    topple: Topple, target: Target, t: float, X_WO: RigidTransform
) -> Wrench | None:
    assert isinstance(target.shape, (Cylinder, Box))
    R_WO = X_WO.rotation().matrix()
    push_W = np.array([*topple.direction, 0.0]) / np.linalg.norm(topple.direction)
    push_O = R_WO.T @ push_W
    push_O[2] = 0.0
    half_width = target.shape.half_extent(push_O / max(np.linalg.norm(push_O), 1e-9))
    half_height = 0.5 * target.shape.height
    # The object falls by itself once its centre is beyond the edge about which it tips.
    tilt = math.acos(min(abs(R_WO[2, 2]), 1.0))
    if tilt > math.atan2(half_width, half_height) or t > _TOPPLE_PATIENCE:
        return None
    force = target.inertia.get_mass() * _GRAVITY * t / _TOPPLE_RAMP
    p_OTop = np.array([0.0, 0.0, math.copysign(half_height, R_WO[2, 2])])
    return force * push_W, np.zeros(3), p_OTop


def _push(
    push: Push,
    target: Target,
    t: float,
    X_WO: RigidTransform,
    course: Course,
    period: float,
) -> tuple[Course, Wrench]:
    """Act as a critically damped spring between the object and its path."""
    X_WO_begin, p_OC = course.X_WO_begin or X_WO, target.inertia.get_com()
    s = t / push.duration
    path = minimum_jerk_blend(s) * np.array(push.displacement)
    # Up in the first quarter, down in the last.
    path[2] += _PUSH_LIFT * minimum_jerk_blend(4.0 * min(s, 1.0 - s))
    R_WO = X_WO.rotation()
    turn = (X_WO_begin.rotation() @ R_WO.inverse()).ToAngleAxis()
    p_error = X_WO_begin @ p_OC + path - X_WO @ p_OC
    error = np.concatenate([turn.angle() * turn.axis(), p_error])
    rate = (error - course.error) / period
    acceleration = _PUSH_FREQUENCY**2 * error + 2.0 * _PUSH_FREQUENCY * rate
    acceleration[5] += _GRAVITY
    size = float(np.linalg.norm(acceleration[3:]))
    acceleration *= min(1.0, _LARGEST_PUSH * _GRAVITY / max(size, _GRAVITY))
    I_C = target.inertia.Shift(p_OC).CalcRotationalInertia().CopyToFullMatrix3()
    torque = R_WO @ (I_C @ (R_WO.inverse() @ acceleration[:3]))
    force = target.inertia.get_mass() * acceleration[3:]
    course = dc.replace(course, X_WO_begin=X_WO_begin, error=error)
    return course, (force, torque, p_OC)


@dc.dataclass(frozen=True)
class _Memory(Shared):
    """State of the disturber."""

    courses: tuple[Course, ...]
    mode: AnyMode | None = None
    forces: tuple[ExternallyAppliedSpatialForce, ...] = ()


class Disturber(LeafSystem):
    """Applies a scenario's disturbances to its objects.

    .. pydrake_system::

        name: Disturber
        input_ports:
        - mode
        - object_poses
        output_ports:
        - object_forces

    `mode` (AnyMode) is the planner's. `object_poses` (dict[str, RigidTransform]) is
    X_WO by name [m]. `object_forces` (list[ExternallyAppliedSpatialForce]) goes to the
    plant and is updated every `period`. If a disturbance's mode begins again before the
    disturbance is over, the disturbance continues without a restart.

    Args:
        disturbances: Each disturbance with its object.
        period: Time between updates [s], preferably the plant's time step.

    Raises:
        ValueError: If an object cannot be toppled.
    """

    def __init__(
        self, disturbances: Sequence[tuple[AnyDisturbance, Target]], period: float
    ) -> None:
        super().__init__()
        self._period = period
        for disturbance, target in disturbances:
            falls = isinstance(target.shape, (Cylinder, Box))
            if isinstance(disturbance, Topple) and not falls:
                raise ValueError(
                    "disturbances: !Topple needs an object that is one cylinder or "
                    f"box, got {target.name!r}"
                )
        self._disturbances = list(disturbances)
        self._mode = self.DeclareAbstractInputPort(
            name="mode", model_value=AbstractValue.Make(Mode.IDLE)
        )
        self._poses = self.DeclareAbstractInputPort(
            name="object_poses", model_value=AbstractValue.Make({})
        )
        self._state = self.DeclareAbstractState(
            AbstractValue.Make(_Memory((Course(),) * len(disturbances)))
        )
        self.DeclareAbstractOutputPort(
            name="object_forces",
            alloc=lambda: AbstractValue.Make([ExternallyAppliedSpatialForce()]),
            calc=self._calc_object_forces,
            prerequisites_of_calc={self.abstract_state_ticket(self._state)},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _memory(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._state)).get_value()
        return memory

    def _calc_object_forces(self, context: Context, output: AbstractValue) -> None:
        output.set_value(list(self._memory(context).forces))

    def _update(self, context: Context, state: State) -> EventStatus:
        time, memory = context.get_time(), self._memory(context)
        mode: AnyMode = self._mode.Eval(context)
        courses, forces = [], []
        for (disturbance, target), last in zip(
            self._disturbances, memory.courses, strict=True
        ):
            course = last
            triggered = mode != memory.mode and mode_name(mode) == disturbance.at
            waits = course.begin == np.inf and course.count < disturbance.times
            if triggered and waits:
                course = Course(course.count + 1, time + disturbance.after)
            # Times of updates are multiples of the period, up to rounding.
            t = time + 1e-9 - course.begin
            if t >= 0.0:
                X_WO = self._poses.Eval(context)[target.name]
                course, wrench = disturb(
                    disturbance, target, t, X_WO, course, self._period
                )
                if wrench is not None:
                    forces.append(_applied(target, wrench))
            courses.append(course)
        state.get_mutable_abstract_state(int(self._state)).set_value(
            _Memory(tuple(courses), mode, tuple(forces))
        )
        return EventStatus.Succeeded()


def _applied(target: Target, wrench: Wrench) -> ExternallyAppliedSpatialForce:
    force, torque, p_OQ = wrench
    applied = ExternallyAppliedSpatialForce()
    applied.body_index = target.body
    applied.p_BoBq_B = p_OQ
    applied.F_Bq_W = SpatialForce(tau=torque, f=force)
    return applied
