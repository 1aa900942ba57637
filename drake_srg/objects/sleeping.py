"""Which objects sleep: resting ones that nothing comes near."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.geometry import SceneGraphInspector
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, DiscreteValues

from drake_srg.lifetime import LeafSystem
from drake_srg.objects.config import SleepingConfig
from drake_srg.objects.corners import body_corners
from drake_srg.types import Vector

_Mask = npt.NDArray[np.bool_]


class SleepMonitor(LeafSystem):
    """Tells which objects sleep.

    .. pydrake_system::

        name: SleepMonitor
        input_ports:
        - body_poses
        - body_spatial_velocities
        - applied_forces (optional)
        output_ports:
        - objects_asleep

    The first two inputs are the plant's outputs, `applied_forces` is its input
    (list[ExternallyAppliedSpatialForce]). `objects_asleep` (frozenset[str]) holds the
    names of the objects that sleep.

    An object sleeps if it has been slower than `config.speed` and free of applied
    forces for `config.after`, and nothing that is awake is or comes near. That is a
    body within `config.margin`, plus the distance that it moves in `config.period`.
    Every body that is not fixed to the world counts as awake, save the objects that
    sleep. So objects that touch each other fall asleep together, and wake together.

    Distances are between the boxes around the bodies' collision geometry. They are
    never longer than the true ones, so an object may wake early, never late.

    Args:
        plant: The finalized plant.
        inspector: Of the plant's geometry.
        objects: The bodies of the objects that may sleep, by name.
        config: Times, speed and margin.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        inspector: SceneGraphInspector,
        objects: Mapping[str, BodyIndex],
        config: SleepingConfig,
    ) -> None:
        super().__init__()
        self.config = config
        self.object_names = list(objects)
        # Objects come first, then all others that move and can be touched.
        others = [
            index
            for index in map(BodyIndex, range(plant.num_bodies()))
            if index not in objects.values()
            and not plant.IsAnchored(plant.get_body(index))
            and plant.GetCollisionGeometriesForBody(plant.get_body(index))
        ]
        self._bodies = [int(index) for index in (*objects.values(), *others)]
        # An object that nothing can touch counts as its origin.
        corners = [
            body_corners(plant, inspector, plant.get_body(BodyIndex(i)))
            for i in self._bodies
        ]
        corners = [points if len(points) else np.zeros((1, 3)) for points in corners]
        low, high = (
            np.array([function(p, axis=0) for p in corners]).reshape(-1, 3)
            for function in (np.min, np.max)
        )
        self._centers, self._halves = 0.5 * (low + high), 0.5 * (high - low)
        self._radii = np.linalg.norm(np.abs(self._centers) + self._halves, axis=1)
        for name, value in (
            ("body_poses", [RigidTransform()]),
            ("body_spatial_velocities", [SpatialVelocity()]),
            ("applied_forces", [ExternallyAppliedSpatialForce()]),
        ):
            self.DeclareAbstractInputPort(name, AbstractValue.Make(value))
        # The time at which each object was last stirred [s].
        self.DeclareDiscreteState(np.zeros(len(objects)))
        self.DeclareAbstractOutputPort(
            name="objects_asleep",
            alloc=lambda: AbstractValue.Make(frozenset()),
            calc=self._calc_objects_asleep,
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=config.period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        stirred = context.get_discrete_state(0).value().copy()
        moving = self._speeds(context)[: len(stirred)] > self.config.speed
        stirred[moving | self._pushed(context)] = context.get_time()
        discrete_state.set_value(stirred)

    def _calc_objects_asleep(self, context: Context, output: AbstractValue) -> None:
        asleep = self._rested(context) & ~self._pushed(context)
        near = self._near(context) if asleep.any() else np.zeros((0, 0), bool)
        while asleep.any():
            awake = np.ones(len(self._bodies), dtype=bool)
            awake[: len(asleep)] = ~asleep
            woken = asleep & near[:, awake].any(axis=1)
            if not woken.any():
                break
            asleep &= ~woken
        names = np.array(self.object_names)[asleep]
        output.set_value(frozenset(names.tolist()))

    def _rested(self, context: Context) -> _Mask:
        """Return which objects have been at rest for long enough."""
        stirred = context.get_discrete_state(0).value()
        rested: _Mask = context.get_time() - stirred > self.config.after - 1e-9
        return rested

    def _pushed(self, context: Context) -> _Mask:
        """Return the objects to which a force is applied."""
        forces = self.GetInputPort("applied_forces")
        applied = forces.Eval(context) if forces.HasValue(context) else []
        if not applied:
            return np.zeros(len(self.object_names), bool)
        pushed = {int(force.body_index) for force in applied}
        return np.isin(self._bodies[: len(self.object_names)], list(pushed))

    def _speeds(self, context: Context) -> Vector:
        """Return an upper bound of the speed of each body's points [m/s]."""
        velocities = self.GetInputPort("body_spatial_velocities").Eval(context)
        V = np.array([velocities[i].get_coeffs() for i in self._bodies])
        turning, moving = np.linalg.norm(V.reshape(-1, 2, 3), axis=2).T
        return moving + turning * self._radii

    def _near(self, context: Context) -> _Mask:
        """Return which objects (rows) each body (columns) is near to."""
        poses = self.GetInputPort("body_poses").Eval(context)
        R = np.array([poses[i].rotation().matrix() for i in self._bodies])
        p = np.array([poses[i].translation() for i in self._bodies])
        p += np.einsum("bij,bj->bi", R, self._centers)
        reach = self.config.margin + self._speeds(context) * self.config.period
        gaps = box_gaps(p, R, self._halves, len(self.object_names))
        near: _Mask = gaps <= reach
        return near


def box_gaps(p: Vector, R: Vector, halves: Vector, count: int) -> Vector:
    """Return lower bounds of the distances of the first `count` boxes from all boxes.

    The bound is the largest gap along the axes of either box. A box counts as
    infinitely far from itself.

    Args:
        p: Centres of the boxes in world, shape (B, 3) [m].
        R: Their rotations, shape (B, 3, 3).
        halves: Half their sizes, shape (B, 3) [m].
        count: Number of rows of the result, N.

    Returns:
        Shape (N, B) [m]; negative where the boxes may overlap.
    """
    between = p[None, :] - p[:count, None]
    cosines = np.einsum("nki,bkj->nbij", R[:count], R)
    own = np.abs(np.einsum("nki,nbk->nbi", R[:count], between))
    own -= halves[:count, None] + np.einsum("nbij,bj->nbi", np.abs(cosines), halves)
    other = np.abs(np.einsum("bkj,nbk->nbj", R, between))
    other -= halves + np.einsum("nbij,ni->nbj", np.abs(cosines), halves[:count])
    gaps: Vector = np.maximum(own.max(axis=2), other.max(axis=2))
    np.fill_diagonal(gaps, np.inf)
    return gaps
