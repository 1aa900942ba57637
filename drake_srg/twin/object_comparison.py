"""How far objects are from where cameras see them."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, EventStatus, State

from drake_srg.lifetime import LeafSystem
from drake_srg.twin.sightings import Sighting
from drake_srg.types import Vector

# Pictures that are older when they arrive are not compared [s].
_MEMORY = 5.0


@dc.dataclass(frozen=True)
class _Memory:
    """Where the objects were, and the last comparisons.

    Attributes:
        times: Of the positions, increasing.
        positions: p_WO of the objects at each time, shape (m, 3) [m].
        compared: Time of the last picture that was compared, by object [s].
        errors: Distance there, by object [m].
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

    `object_poses` is a dict[str, RigidTransform], X_WO by name [m]; `sightings` a tuple
    of the newest `Sighting` of each object; `placed_at` a dict[str, float]: when an
    object was put somewhere else [s], by name. Objects without an entry, and pictures
    from before, do not count. `object_error` (m) has the distance of each object from
    where it was last seen [m], NaN before the first comparison.

    Args:
        names: Of the objects.
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
