"""Many stages as one system: fewer events and ports, the same numbers."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DependencyTicket,
    DiscreteValues,
    InputPort,
)

from drake_srg.common.stages import Stage, declare_input, input_reader, weakly
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector


class StagePort(NamedTuple):
    """A port of a stage, by names."""

    stage: str
    port: str


class FusedStages(LeafSystem):
    """Runs stages in one event per period, with the results that they have as systems.

    All stages that are due at a time see the states from before it, as separate systems
    do, so each passes its values on with the same delay. Within an event, an output is
    computed at most once, and only if something reads it.

    The ports are those that `wires` and `outputs` name.

    Args:
        stages: By name. Only their functions are used; they have no contexts.
        wires: For each connected input of a stage, the output of a stage or the name of
            an input port of this system. Inputs may share a port.
        outputs: For each output port of this system, the output of a stage.

    Raises:
        ValueError: If an input that is not optional has no wire.
    """

    def __init__(
        self,
        stages: Mapping[str, Stage],
        wires: Mapping[StagePort, StagePort | str],
        outputs: Mapping[str, StagePort],
    ) -> None:
        super().__init__()
        self._stages, self._wires = stages, wires
        self._places: dict[str, slice] = {}
        initial: list[float] = []
        for name, stage in stages.items():
            self._places[name] = slice(len(initial), len(initial) + len(stage.initial))
            initial += list(stage.initial)
        self.DeclareDiscreteState(initial)
        self._ports: dict[str, InputPort] = {}
        for target, wire in wires.items():
            if isinstance(wire, str) and wire not in self._ports:
                kind = stages[target.stage].input_kind(target.port)
                self._ports[wire] = declare_input(self, wire, kind)
        self._sources: dict[StagePort, _Source] = {}
        self._outputs = {name: self._output(port) for name, port in outputs.items()}
        for name, port in outputs.items():
            self.DeclareVectorOutputPort(
                name=name,
                size=stages[port.stage].outputs[port.port].size,
                calc=weakly(self, functools.partial(_calc, name)),
                prerequisites_of_calc=self._outputs[name].tickets,
            )
        self._steps: dict[float, list[_Step]] = {}
        for name, stage in stages.items():
            if stage.period is not None:
                step = self._step(name, stage.update)
                self._steps.setdefault(stage.period, []).append(step)
        for period in self._steps:
            self.DeclarePeriodicDiscreteUpdateEvent(
                period_sec=period,
                offset_sec=0.0,
                update=weakly(self, functools.partial(_update, period)),
            )
        self._starts = [self._step(n, s.start) for n, s in stages.items() if s.starts]
        if self._starts:
            self.DeclareInitializationDiscreteUpdateEvent(weakly(self, _start))

    def _step(self, name: str, function: Callable[..., Any]) -> _Step:
        sources = [self._source(name, port) for port in self._stages[name].input_names]
        return _Step(function, self._places[name], sources)

    def _source(self, name: str, port: str) -> _Source:
        """Return where a stage's input comes from."""
        stage, wire = self._stages[name], self._wires.get(StagePort(name, port))
        if isinstance(wire, StagePort):
            return self._output(wire)
        if wire is not None:
            own = self._ports[wire]
            read = input_reader(own, required=port in stage.inputs)
            return _Source(lambda now: read(now.context), {own.ticket()})
        if port in stage.inputs:
            raise ValueError(f"{name}: input port {port!r} has no source")
        return _Source(lambda now: None, set())

    def _output(self, port: StagePort) -> _Source:
        """Return the output of a stage as a source."""
        if port not in self._sources:
            stage = self._stages[port.stage]
            output, place = stage.outputs[port.port], self._places[port.stage]
            sources = [self._source(port.stage, read) for read in output.reads]
            tickets = {self.time_ticket()} if output.timed else set()
            if len(stage.initial):
                tickets.add(self.xd_ticket())
            self._sources[port] = _Source(
                lambda now: np.asarray(now.apply(output.calc, place, sources)),
                tickets.union(*(source.tickets for source in sources)),
            )
        return self._sources[port]


@dc.dataclass(frozen=True, eq=False)
class _Source:
    """How to find a value at a moment, and what it depends on."""

    evaluate: Callable[[_Now], Any]
    tickets: set[DependencyTicket]


class _Step(NamedTuple):
    """A stage's update or start, where its state is, and its inputs."""

    function: Callable[..., Any]
    place: slice
    sources: list[_Source]


class _Now:
    """A moment: its context, time and state, and the values found so far."""

    __slots__ = ("_values", "context", "state", "time")

    def __init__(self, context: Context) -> None:
        self.context = context
        self.time: float = context.get_time()
        self.state: Vector = context.get_discrete_state(0).value()
        self._values: dict[_Source, Any] = {}

    def apply(
        self, function: Callable[..., Any], place: slice, sources: list[_Source]
    ) -> Any:
        """Call a function of a stage."""
        values = self._values
        for source in sources:
            if source not in values:
                values[source] = source.evaluate(self)
        return function(self.time, self.state[place], *map(values.get, sources))


def _calc(
    name: str, system: FusedStages, context: Context, output: BasicVector
) -> None:
    output.SetFromVector(system._outputs[name].evaluate(_Now(context)))


def _update(
    period: float, system: FusedStages, context: Context, new: DiscreteValues
) -> None:
    _run(system._steps[period], context, new)


def _start(system: FusedStages, context: Context, new: DiscreteValues) -> None:
    _run(system._starts, context, new)


def _run(steps: list[_Step], context: Context, new: DiscreteValues) -> None:
    now, state = _Now(context), new.get_mutable_value()
    for step in steps:
        result = now.apply(*step)
        if result is not None:
            state[step.place] = result
