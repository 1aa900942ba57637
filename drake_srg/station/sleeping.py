"""Sleep of objects that rest while nothing is near them.

A sleeping object is locked in its place (`RigidBody.Lock`), and its contacts with other
sleeping objects and with the fixed world are left out. Both are parameters of plant and
scene graph, which no system may change while the simulation advances. So they change
between two calls of `AdvanceTo`, at multiples of `sleeping.period`, whatever the
caller's steps are.

The Context alone holds the locked objects and the omitted contacts. So a function from
`MakeAdvance` can continue a simulation that another one has advanced.
"""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    CollisionFilterDeclaration,
    FilterId,
    GeometrySet,
    SceneGraph,
    SceneGraphInspector,
)
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, DiscreteValues

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.shared import Shared
from drake_srg.lifetime import LeafSystem
from drake_srg.objects.config import SleepingConfig
from drake_srg.objects.models import object_body
from drake_srg.objects.solids import body_corners
from drake_srg.scenario.schema import Scenario
from drake_srg.types import Vector

Advance = Callable[[float], object]

_Mask = npt.NDArray[np.bool_]

_ROUNDING = 1e-9  # s; times this close are equal


@dc.dataclass(frozen=True)
class _Filter(Shared):  # Drake's ids cannot be deep-copied
    """The collision filter between resting bodies, if there is one."""

    id: FilterId | None = None


class SleepMonitor(LeafSystem):
    """Decides which objects sleep.

    .. pydrake_system::

        name: SleepMonitor
        input_ports:
        - body_poses
        - body_spatial_velocities
        - applied_forces (optional)
        output_ports:
        - objects_asleep

    The first two inputs are outputs of the plant. `applied_forces` is what the plant
    gets as its input (list[ExternallyAppliedSpatialForce]). `objects_asleep`
    (frozenset[str]) holds the names of the objects that sleep.

    An object sleeps if it has been slower than `config.speed` and free of applied
    forces for `config.after`, and no body that is awake is near. A body is near if it
    is within `config.margin` plus the distance that it moves in `config.period`. Every
    body that is not fixed to the world counts as awake, except sleeping objects. So
    objects that touch each other fall asleep together, and wake together.

    Distances are between the boxes around the bodies' collision geometry. They are
    never longer than the true distances, so an object may wake early, but never late.

    Args:
        plant: The finalized plant.
        inspector: Inspector of the plant's geometry.
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
        # Objects come first, then all other bodies that move and can be touched.
        others = [
            index
            for index in map(BodyIndex, range(plant.num_bodies()))
            if index not in objects.values()
            and not plant.IsAnchored(plant.get_body(index))
            and plant.GetCollisionGeometriesForBody(plant.get_body(index))
        ]
        self._bodies = [int(index) for index in (*objects.values(), *others)]
        # An object without collision geometry is represented by its origin.
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
        self.filter = int(self.DeclareAbstractParameter(AbstractValue.Make(_Filter())))
        # The time at which each object last moved or was pushed [s].
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
        """Return whether each object (row) is near each body (column)."""
        poses = self.GetInputPort("body_poses").Eval(context)
        R = np.array([poses[i].rotation().matrix() for i in self._bodies])
        p = np.array([poses[i].translation() for i in self._bodies])
        p += np.einsum("bij,bj->bi", R, self._centers)
        reach = self.config.margin + self._speeds(context) * self.config.period
        gaps = box_gaps(p, R, self._halves, len(self.object_names))
        near: _Mask = gaps <= reach
        return near


def box_gaps(p: Vector, R: Vector, halves: Vector, count: int) -> Vector:
    """Return lower bounds of the distances between the first `count` boxes and all.

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


def AddSleepMonitor(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    scenario: Scenario,
    config: SleepingConfig,
) -> None:
    """Add `sleep_monitor` to a station that exports the input `object_forces_cheat`.

    All rigid objects may sleep, except those with a disturbance.
    """
    disturbed = {d.object or scenario.task.pick for d in scenario.disturbances}
    bodies = {
        name: object_body(plant, plant.GetModelInstanceByName(name))
        for name, thing in scenario.objects.items()
        if thing.present and name not in disturbed
    }
    rigid = {name: i for name, i in bodies.items() if isinstance(i, BodyIndex)}
    inspector = scene_graph.model_inspector()
    monitor = builder.AddNamedSystem(
        "sleep_monitor", SleepMonitor(plant, inspector, rigid, config)
    )
    for output, name in (
        (plant.get_body_poses_output_port(), "body_poses"),
        (plant.get_body_spatial_velocities_output_port(), "body_spatial_velocities"),
    ):
        builder.Connect(output, monitor.GetInputPort(name))
    builder.ConnectInput("object_forces_cheat", monitor.GetInputPort("applied_forces"))
    builder.ExportOutput(monitor.get_output_port(), "objects_asleep_cheat")


def MakeAdvance(simulator: Simulator, system: Diagram, scenario: Scenario) -> Advance:
    """Return a function that advances to a time [s], like `simulator.AdvanceTo`.

    Args:
        simulator: Simulator of a diagram that contains `system`.
        system: A station, or a diagram with a subsystem `station`.
        scenario: The scenario of `system`.

    Raises:
        ScenarioError: If objects may sleep, but `MakeStation` did not make the station.
    """
    if scenario.sleeping is None:
        return simulator.AdvanceTo
    if system.HasSubsystemNamed("station"):
        system = system.GetSubsystemByName("station")
    if not system.HasSubsystemNamed("sleep_monitor"):
        raise ScenarioError(
            "sleeping: needs a subsystem `station` that MakeStation has made"
        )
    root = simulator.get_mutable_context()
    sleepers = _Sleepers(system, root)
    period = scenario.sleeping.period

    def advance(until: float) -> None:
        check_now()  # the caller may have changed an input since the last check
        while root.get_time() < until - _ROUNDING:
            check = period * (math.floor(root.get_time() / period + 1e-6) + 1)
            simulator.AdvanceTo(until if check > until - _ROUNDING else check)
            check_now()

    def check_now() -> None:
        time = root.get_time()
        if abs(time - period * round(time / period)) < _ROUNDING:
            sleepers.update()

    return advance


class _Sleepers:
    """Locks the objects of a station that sleep, and unlocks the others."""

    def __init__(self, station: Diagram, root: Context) -> None:
        plant: MultibodyPlant = station.GetSubsystemByName("plant")
        scene_graph: SceneGraph = station.GetSubsystemByName("scene_graph")
        monitor: SleepMonitor = station.GetSubsystemByName("sleep_monitor")
        self._plant_context = plant.GetMyMutableContextFromRoot(root)
        self._scene_graph = scene_graph
        self._scene_graph_context = scene_graph.GetMyMutableContextFromRoot(root)
        self._monitor_context = monitor.GetMyMutableContextFromRoot(root)
        self._filter = monitor.filter
        self._output = monitor.get_output_port()
        self._bodies = {name: _body(plant, name) for name in monitor.object_names}
        self._geometry = {
            name: list(plant.GetCollisionGeometriesForBody(body))
            for name, body in self._bodies.items()
        }
        self._fixed = [
            geometry
            for index in map(BodyIndex, range(plant.num_bodies()))
            if plant.IsAnchored(plant.get_body(index))
            for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index))
        ]

    def update(self) -> None:
        """Lock and unlock objects as the monitor decides."""
        asleep: frozenset[str] = self._output.Eval(self._monitor_context)
        locked = {
            name
            for name, body in self._bodies.items()
            if body.is_locked(self._plant_context)
        }
        if asleep == locked:
            return
        for name in sorted(asleep ^ locked):
            body = self._bodies[name]
            (body.Lock if name in asleep else body.Unlock)(self._plant_context)
        filters = self._scene_graph.collision_filter_manager(self._scene_graph_context)
        context = self._monitor_context
        before = context.get_abstract_parameter(self._filter).get_value().id
        if before is not None:
            filters.RemoveDeclaration(before)
        resting = GeometrySet([g for name in asleep for g in self._geometry[name]])
        applied = filters.ApplyTransient(
            CollisionFilterDeclaration()
            .ExcludeWithin(resting)
            .ExcludeBetween(resting, GeometrySet(self._fixed))
        )
        parameter = context.get_mutable_abstract_parameter(self._filter)
        parameter.set_value(_Filter(applied))


def _body(plant: MultibodyPlant, name: str) -> RigidBody:
    index = object_body(plant, plant.GetModelInstanceByName(name))
    assert isinstance(index, BodyIndex)  # soft objects do not sleep
    return plant.get_body(index)
