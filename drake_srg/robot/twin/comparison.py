"""Systems that compare a robot with its twin."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    EventStatus,
    State,
)

from drake_srg.common.tables import parse_json
from drake_srg.lifetime import LeafSystem
from drake_srg.robot.serve.commands import CommandError
from drake_srg.scenario.schema import TwinConfig
from drake_srg.types import BlobFlag, Vector


@dc.dataclass(frozen=True)
class Sighting:
    """An object in one camera image.

    Attributes:
        name: The object's name.
        time: Time of the image [s].
        X_WO: The object's pose in world [m].
        clear: Whether the image shows all of the object.
    """

    name: str
    time: float
    X_WO: RigidTransform
    clear: bool = True


def read_blobs(text: str) -> tuple[Sighting, ...]:
    """Return the poses that are certain, from a message of `serve`'s topic /blobs.

    Args:
        text: JSON in the format of `drake_srg.robot.serve.pictures`.

    Raises:
        CommandError: If the text has another format.
    """
    try:
        message = parse_json(text)
        time = float(message["stamp"])
        found = [_sighting(time, blob) for blob in message["blobs"]]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise CommandError("blobs", f"needs blobs as JSON, got {error!r}") from None
    if not np.isfinite(time):
        raise CommandError("blobs", f"needs a finite stamp, got {time}")
    return tuple(sighting for sighting in found if sighting is not None)


def _sighting(time: float, blob: Any) -> Sighting | None:
    flags = {BlobFlag(flag) for flag in blob["flags"]}
    wxyz = np.array([float(blob["orientation"][key]) for key in "wxyz"])
    p_WO = np.array(blob["position"], dtype=float)
    norm = float(np.linalg.norm(wxyz))
    if p_WO.shape != (3,) or not np.isfinite([*p_WO, norm]).all() or norm < 0.5:
        raise ValueError("an invalid pose")
    X_WO = RigidTransform(Quaternion(wxyz / norm), p_WO)
    if BlobFlag.UNCERTAIN in flags:
        return None
    return Sighting(str(blob["object_name"]), time, X_WO, clear=not flags)


# Compared quantities, in the order of the ports.
KINDS = ("joint", "torque", "finger", "object")
# A reported difference ends once it is below this share of its limit.
_OVER = 0.8


class TwinMonitor(LeafSystem):
    """Compares a robot's measurements with its twin.

    .. pydrake_system::

        name: TwinMonitor
        input_ports:
        - arm_state
        - arm_state_measured
        - arm_torque_measured
        - arm_external_felt
        - arm_external_expected
        - gripper_state
        - gripper_state_measured
        - object_error
        output_ports:
        - joint_error
        - torque_expected
        - torque_residual
        - finger_error
        - difference
        - parted

    The states [q; v] (2N, 2n) are those of the twin and of the robot [rad, rad/s], and
    `object_error` (m) has distances [m]. A missing measurement is NaN, and does not
    count as a difference. `joint_error` (N) and `finger_error` (n) are measured minus
    twin [rad]. With several arms, inputs begin with the names of their models in place
    of `arm` and `gripper`, and outputs concatenate the values of all arms.

    Torques (N) are in N m. The motors must provide the torques that the measured motion
    needs by inverse dynamics, minus the external torques:

        arm_torque_measured = needed - arm_external_felt,
        torque_expected = needed - arm_external_expected,
        torque_residual = arm_torque_measured - torque_expected.

    So `arm_external_felt` are the external torques that explain the measurement (see
    `ExternalTorqueObserver`). `arm_external_expected` are those of the contacts that
    the twin simulates, such as the weight of a carried object.

    `difference` (4) has the largest difference of each of `KINDS` in the last sample:
    joints [rad], torques [share of the effort limit], fingers [rad], objects [m].
    Torques count only while the arm is still, and are 0 otherwise. `parted` (4) becomes
    1 once a difference has exceeded its limit for `config.patience` (torques:
    `config.still_time`), and 0 again once it is below 0.8 of the limit.

    Args:
        config: Limits of the differences.
        efforts: Effort limits of the joints (N,) [N m], by the name of the arm's model.
        fingers: Number n of finger joints, by the name of the gripper's model.
        objects: Number m of objects.
        period: Time between samples [s].
    """

    def __init__(
        self,
        config: TwinConfig,
        efforts: Mapping[str, Vector],
        fingers: Mapping[str, int],
        objects: int,
        period: float,
    ) -> None:
        super().__init__()
        self._config, self._efforts = config, np.concatenate([*efforts.values()])
        self._limits = np.array([getattr(config, kind) for kind in KINDS])
        patience, still = config.patience, config.still_time
        self._patience = np.array([patience, still, patience, patience])
        self._arms, self._hands = tuple(efforts), tuple(fingers)
        joints = {name: len(limits) for name, limits in efforts.items()}
        states = ("state", "state_measured")
        torques = ("torque_measured", "external_felt", "external_expected")
        sizes = {
            f"{model}_{name}": 2 * n
            for model, n in {**joints, **fingers}.items()
            for name in states
        }
        sizes |= {f"{arm}_{name}": n for arm, n in joints.items() for name in torques}
        self._inputs = {
            name: self.DeclareVectorInputPort(name=name, size=size)
            for name, size in {**sizes, "object_error": objects}.items()
        }
        # Times since which the arm is still, and each difference exceeds its limit [s].
        self._still_since = int(self.DeclareDiscreteState([np.inf]))
        self._since = int(self.DeclareDiscreteState(np.full(len(KINDS), np.inf)))
        n, m = len(self._efforts), sum(fingers.values())
        for name, size, calc, models, needs in (
            ("joint_error", n, self._calc_joint_error, self._arms, states),
            ("torque_expected", n, self._calc_expected, self._arms, torques),
            ("torque_residual", n, self._calc_residual, self._arms, torques),
            ("finger_error", m, self._calc_finger_error, self._hands, states),
        ):
            tickets = {
                self._inputs[f"{model}_{need}"].ticket()
                for model in models
                for need in needs
            }
            self.DeclareVectorOutputPort(
                name=name, size=size, calc=calc, prerequisites_of_calc=tickets
            )
        self._shown = {}
        for name in ("difference", "parted"):
            index = self.DeclareDiscreteState(np.zeros(len(KINDS)))
            self.DeclareStateOutputPort(name, index)
            self._shown[name] = int(index)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _torques(self, context: Context, name: str) -> Vector:
        """Return an input's values for the joints of all arms, shape (N,) [N m]."""
        ports = [self._inputs[f"{arm}_{name}"] for arm in self._arms]
        return np.concatenate([port.Eval(context) for port in ports])

    def _halves(
        self, context: Context, models: Sequence[str], name: str
    ) -> tuple[Vector, Vector]:
        """Return q and v of several models, concatenated."""
        states = [self._inputs[f"{model}_{name}"].Eval(context) for model in models]
        halves = zip(*(np.split(state, 2) for state in states), strict=True)
        q, v = (np.concatenate(half) for half in halves)
        return q, v

    def _error(self, context: Context, models: Sequence[str]) -> Vector:
        measured, _ = self._halves(context, models, "state_measured")
        error: Vector = measured - self._halves(context, models, "state")[0]
        return error

    def _calc_joint_error(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._error(context, self._arms))

    def _residual(self, context: Context) -> Vector:
        felt, expected = (
            self._torques(context, f"external_{name}") for name in ("felt", "expected")
        )
        told = np.isfinite(self._torques(context, "torque_measured"))
        return np.where(told, expected - felt, np.nan)

    def _calc_expected(self, context: Context, output: BasicVector) -> None:
        measured = self._torques(context, "torque_measured")
        output.SetFromVector(measured - self._residual(context))

    def _calc_residual(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._residual(context))

    def _calc_finger_error(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._error(context, self._hands))

    def _differences(self, context: Context) -> Vector:
        (still_since,) = context.get_discrete_state(self._still_since).value()
        still = context.get_time() - still_since >= self._config.still_time
        shares = self._residual(context) / self._efforts
        return np.array(
            [
                _largest(self._error(context, self._arms)),
                _largest(shares) if still else 0.0,
                _largest(self._error(context, self._hands)),
                _largest(self._inputs["object_error"].Eval(context)),
            ]
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        config, time = self._config, context.get_time()
        _, speed = self._halves(context, self._arms, "state_measured")
        (still_since,) = context.get_discrete_state(self._still_since).value()
        still = (np.abs(speed) <= config.still_speed).all()
        difference = self._differences(context)
        since = context.get_discrete_state(self._since).value()
        since = np.where(difference > self._limits, np.minimum(since, time), np.inf)
        parted = context.get_discrete_state(self._shown["parted"]).value()
        parted = parted * (difference > _OVER * self._limits)
        lasts = time - since >= self._patience
        for index, value in (
            (self._still_since, [min(still_since, time) if still else np.inf]),
            (self._since, since),
            (self._shown["parted"], np.where(lasts, 1.0, parted)),
            (self._shown["difference"], difference),
        ):
            discrete_state.set_value(index, value)


def _largest(values: Vector) -> float:
    """Return the largest absolute value, where NaN counts as 0."""
    return float(np.max(np.abs(np.nan_to_num(values, nan=0.0)), initial=0.0))


# Pictures that are older than this when they arrive are ignored [s].
_MEMORY = 5.0


@dc.dataclass(frozen=True)
class _Memory:
    """Previous poses of the objects, and the last comparisons.

    Attributes:
        times: Times of `positions`, increasing [s].
        positions: Positions p_WO of the objects at each time, shape (m, 3) [m].
        compared: Time of the last compared picture, by object [s].
        errors: Distance in that picture, by object [m].
    """

    times: tuple[float, ...] = ()
    positions: tuple[Vector, ...] = ()
    compared: Mapping[str, float] = dc.field(default_factory=dict)
    errors: Mapping[str, float] = dc.field(default_factory=dict)


class ObjectComparison(LeafSystem):
    """Compares objects with sightings, at the times when the pictures were taken.

    .. pydrake_system::

        name: ObjectComparison
        input_ports:
        - object_poses
        - sightings
        - placed_at
        output_ports:
        - object_error

    `object_poses` is a dict[str, RigidTransform] with X_WO by name [m]. `sightings` is
    a tuple with the newest `Sighting` of each object. `placed_at` is a dict[str, float]
    with the time at which `Placing` last moved each object [s], by name. Objects
    without an entry, and pictures from before that time, are ignored. `object_error`
    (m) has the distance of each object from where it was last seen [m]; NaN before the
    first comparison.

    Args:
        names: Names of the m objects.
        period: Time between samples [s].
    """

    def __init__(self, names: Sequence[str], period: float) -> None:
        super().__init__()
        self._names = list(names)
        self._poses, self._seen, self._placed = (
            self.DeclareAbstractInputPort(name, AbstractValue.Make(model))
            for name, model in (
                ("object_poses", dict[str, RigidTransform]()),
                ("sightings", ()),
                ("placed_at", dict[str, float]()),
            )
        )
        self._memory = int(self.DeclareAbstractState(AbstractValue.Make(_Memory())))
        self.DeclareVectorOutputPort(
            name="object_error",
            size=len(self._names),
            calc=self._calc_error,
            prerequisites_of_calc={self.xa_ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _calc_error(self, context: Context, output: BasicVector) -> None:
        errors = self._remembered(context).errors
        output.SetFromVector([errors.get(name, np.nan) for name in self._names])

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(self._memory).get_value()
        return memory

    def _update(self, context: Context, state: State) -> EventStatus:
        memory, time = self._remembered(context), context.get_time()
        poses = self._poses.Eval(context)
        now = np.array([poses[name].translation() for name in self._names])
        first = sum(t < time - _MEMORY for t in memory.times[:2])
        times = (*memory.times[first:], time)
        positions = (*memory.positions[first:], now.reshape(-1, 3))
        compared, errors = dict(memory.compared), dict(memory.errors)
        placed: Mapping[str, float] = self._placed.Eval(context)
        sightings: Sequence[Sighting] = self._seen.Eval(context)
        for seen in sightings:
            name = seen.name
            if name not in placed or name not in self._names:
                continue
            since = max(times[0], placed[name], compared.get(name, -np.inf))
            if not since < seen.time <= time:
                continue
            ours = _at(seen.time, times, positions, self._names.index(name))
            away = np.linalg.norm(seen.X_WO.translation() - ours)
            compared[name], errors[name] = seen.time, float(away)
        new = _Memory(times, positions, compared, errors)
        state.get_mutable_abstract_state(self._memory).set_value(new)
        return EventStatus.Succeeded()


def _at(
    time: float, times: Sequence[float], positions: Sequence[Vector], i: int
) -> Vector:
    """Return where object `i` was at a time [s], shape (3,) [m]."""
    after = int(np.clip(np.searchsorted(times, time), 1, max(len(times) - 1, 1)))
    if after >= len(times):
        return positions[-1][i]
    before = after - 1
    share = (time - times[before]) / (times[after] - times[before])
    found: Vector = (1.0 - share) * positions[before][i] + share * positions[after][i]
    return found
