"""Many stages as one system: fewer events and ports, the same numbers."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
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
        self._reads: dict[tuple[str, bool], _Read] = {}
        self._calls: dict[StagePort, _Call] = {}
        self._outputs: dict[str, _Program] = {}
        for name, port in outputs.items():
            call = self._output(port)
            self._outputs[name] = _Program([call])
            self.DeclareVectorOutputPort(
                name=name,
                size=stages[port.stage].outputs[port.port].size,
                calc=weakly(self, functools.partial(_calc, name)),
                prerequisites_of_calc=call.tickets,
            )
        steps: dict[float, list[_Call]] = {}
        for name, stage in stages.items():
            if stage.period is not None:
                step = self._step(name, stage.update)
                steps.setdefault(stage.period, []).append(step)
        self._updates = {period: _Program(calls) for period, calls in steps.items()}
        for period in self._updates:
            self.DeclarePeriodicDiscreteUpdateEvent(
                period_sec=period,
                offset_sec=0.0,
                update=weakly(self, functools.partial(_update, period)),
            )
        starts = [self._step(n, s.start) for n, s in stages.items() if s.starts]
        self._start = _Program(starts)
        if starts:
            self.DeclareInitializationDiscreteUpdateEvent(weakly(self, _start))

    def _step(self, name: str, function: Callable[..., Any]) -> _Call:
        """Return the call of a stage's update or start."""
        inputs = [self._input(name, port) for port in self._stages[name].input_names]
        return _Call(function, self._places[name], inputs, set())

    def _input(self, name: str, port: str) -> _Read | _Call:
        """Return where a stage's input comes from."""
        stage, wire = self._stages[name], self._wires.get(StagePort(name, port))
        required = port in stage.inputs
        if isinstance(wire, StagePort):
            return self._output(wire)
        if wire is None:
            if required:
                raise ValueError(f"{name}: input port {port!r} has no source")
            return _ABSENT
        if (wire, required) not in self._reads:
            own = self._ports[wire]
            read = _Read(input_reader(own, required), {own.ticket()})
            self._reads[wire, required] = read
        return self._reads[wire, required]

    def _output(self, port: StagePort) -> _Call:
        """Return the call that computes an output of a stage."""
        if port not in self._calls:
            stage = self._stages[port.stage]
            output = stage.outputs[port.port]
            inputs = [self._input(port.stage, read) for read in output.reads]
            tickets = {self.time_ticket()} if output.timed else set()
            if len(stage.initial):
                tickets.add(self.xd_ticket())
            tickets = tickets.union(*(needed.tickets for needed in inputs))
            place = self._places[port.stage]
            self._calls[port] = _Call(output.calc, place, inputs, tickets)
        return self._calls[port]


@dc.dataclass(frozen=True, eq=False)
class _Read:
    """A value from an input port: how to read it, and what it depends on."""

    read: Callable[[Context], Any]
    tickets: set[DependencyTicket]


_ABSENT = _Read(lambda context: None, set())


@dc.dataclass(frozen=True, eq=False)
class _Call:
    """A value from a function of a stage: its state and inputs, and their tickets."""

    function: Callable[..., Any]
    place: slice
    inputs: Sequence[_Read | _Call]
    tickets: set[DependencyTicket]


class _Program:
    """Calls in an order in which each finds its inputs, none of them twice.

    The order is settled here, once, because an event comes every few milliseconds.

    Args:
        last: The calls whose results count.
    """

    def __init__(self, last: Sequence[_Call]) -> None:
        needed = list(dict.fromkeys(v for call in last for v in _needed(call)))
        reads = [value for value in needed if isinstance(value, _Read)]
        calls = [value for value in needed if isinstance(value, _Call)]
        index = {value: i for i, value in enumerate((*reads, *calls))}
        self._reads = [value.read for value in reads]
        self._calls, self._last = (
            [(c.function, c.place, [index[v] for v in c.inputs]) for c in group]
            for group in (calls, last)
        )

    def results(self, context: Context) -> list[tuple[slice, Any]]:
        """Return where the state of each of the last calls is, and its result."""
        time, state = context.get_time(), context.get_discrete_state(0).value()
        values = [read(context) for read in self._reads]
        for function, place, inputs in self._calls:
            result = function(time, state[place], *[values[i] for i in inputs])
            values.append(np.asarray(result))
        return [
            (place, function(time, state[place], *[values[i] for i in inputs]))
            for function, place, inputs in self._last
        ]


def _needed(call: _Call) -> Iterator[_Read | _Call]:
    """Yield what a call needs, each value after those that it needs itself."""
    for value in call.inputs:
        if isinstance(value, _Call):
            yield from _needed(value)
        yield value


def _calc(
    name: str, system: FusedStages, context: Context, output: BasicVector
) -> None:
    ((_, value),) = system._outputs[name].results(context)
    output.SetFromVector(value)


def _update(
    period: float, system: FusedStages, context: Context, new: DiscreteValues
) -> None:
    _SetState(system._updates[period], context, new)


def _start(system: FusedStages, context: Context, new: DiscreteValues) -> None:
    _SetState(system._start, context, new)


def _SetState(program: _Program, context: Context, new: DiscreteValues) -> None:
    state = new.get_mutable_value()
    for place, result in program.results(context):
        if result is not None:
            state[place] = result
