"""Advances a simulation in which resting objects sleep.

A sleeping object is locked in its place (`RigidBody.Lock`), and its contact with what
rests as well is left out. Both are parameters of plant and scene graph, which no system
may change while the simulation advances. So they change between two calls of
`AdvanceTo`, at multiples of `sleeping.period`, whatever the caller's steps are.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from pydrake.geometry import (
    CollisionFilterDeclaration,
    FilterId,
    GeometrySet,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.models import object_body
from drake_srg.objects.sleeping import SleepMonitor
from drake_srg.scenario.schema import Scenario

Advance = Callable[[float], object]

_ROUNDING = 1e-9  # s; times this close are equal


def MakeAdvance(simulator: Simulator, system: Diagram, scenario: Scenario) -> Advance:
    """Return a function that advances to a time [s], like `simulator.AdvanceTo`.

    Args:
        simulator: Of a diagram with `system` in it.
        system: A station, or a diagram with a subsystem `station`.
        scenario: The scenario that they were made from.

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
    """Locks the objects of a station that sleep, and unlocks the others.

    Args:
        station: The station.
        root: The context of the simulation.
    """

    def __init__(self, station: Diagram, root: Context) -> None:
        plant: MultibodyPlant = station.GetSubsystemByName("plant")
        scene_graph: SceneGraph = station.GetSubsystemByName("scene_graph")
        monitor: SleepMonitor = station.GetSubsystemByName("sleep_monitor")
        self._plant_context = plant.GetMyMutableContextFromRoot(root)
        self._scene_graph = scene_graph
        self._scene_graph_context = scene_graph.GetMyMutableContextFromRoot(root)
        self._monitor_context = monitor.GetMyContextFromRoot(root)
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
        self._asleep: frozenset[str] = frozenset()
        self._filter: FilterId | None = None

    def update(self) -> None:
        """Lock and unlock as the monitor says."""
        asleep: frozenset[str] = self._output.Eval(self._monitor_context)
        if asleep == self._asleep:
            return
        for name in sorted(asleep ^ self._asleep):
            body = self._bodies[name]
            (body.Lock if name in asleep else body.Unlock)(self._plant_context)
        self._asleep = asleep
        filters = self._scene_graph.collision_filter_manager(self._scene_graph_context)
        if self._filter is not None:
            filters.RemoveDeclaration(self._filter)
        resting = GeometrySet([g for name in asleep for g in self._geometry[name]])
        self._filter = filters.ApplyTransient(
            CollisionFilterDeclaration()
            .ExcludeWithin(resting)
            .ExcludeBetween(resting, GeometrySet(self._fixed))
        )


def _body(plant: MultibodyPlant, name: str) -> RigidBody:
    index = object_body(plant, plant.GetModelInstanceByName(name))
    assert isinstance(index, BodyIndex)  # soft objects do not sleep
    return plant.get_body(index)
