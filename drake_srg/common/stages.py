"""Systems made of plain functions, so that several of them can be run as one.

A stage of a driver is a system whose outputs and update are functions of time, state
and inputs, all plain values. On its own it is a system like any other. `FusingBuilder`
(drake_srg/common/fusing.py) runs many of them in one event per period.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import InputPort, PortDataType

from drake_srg.lifetime import LeafSystem


@dc.dataclass(frozen=True)
class StageOutput:
    """An output port of a stage.

    Attributes:
        size: Of the vector.
        calc: Returns it from (time, state, values of the inputs `reads`).
        reads: The inputs that it depends on, besides the state.
        timed: Whether it depends on the time.
    """

    size: int
    calc: Callable[..., Any]
    reads: Sequence[str] = ()
    timed: bool = False


class Stage:
    """Mixin for a system whose outputs and update are functions of plain values.

    Call `declare_stage` in the constructor, and implement `update` if there is a
    period. All state is in the context: functions change nothing of `self`, and nothing
    in place.
    """

    # What `declare_stage` declared.
    period: float | None
    initial: Any
    inputs: Mapping[str, Any]
    optional: Mapping[str, Any]
    outputs: Mapping[str, StageOutput]

    def declare_stage(
        self: Any,
        *,
        inputs: Mapping[str, Any],
        outputs: Mapping[str, StageOutput],
        optional: Mapping[str, Any] | None = None,
        state: Any = (),
        period: float | None = None,
    ) -> None:
        """Declare ports, state and update.

        Args:
            inputs: Sizes of the input ports, or model values of abstract ones.
            outputs: The output ports.
            optional: Further input ports, whose value is None while they have none.
            state: At the start.
            period: Time between updates [s]; None: there are none.
        """
        self.inputs, self.optional = dict(inputs), dict(optional or {})
        self.outputs, self.initial, self.period = dict(outputs), state, period
        self._readers = {
            name: input_reader(declare_input(self, name, kind), required)
            for kinds, required in ((self.inputs, True), (self.optional, False))
            for name, kind in kinds.items()
        }
        tickets = set()
        if len(state):
            tickets = {self.discrete_state_ticket(self.DeclareDiscreteState(state))}
        for name, output in self.outputs.items():
            ports = [self.GetInputPort(read) for read in output.reads]
            self.DeclareVectorOutputPort(
                name=name,
                size=output.size,
                calc=weakly(self, functools.partial(_calc, name)),
                prerequisites_of_calc={
                    *tickets,
                    *(port.ticket() for port in ports),
                    *((self.time_ticket(),) if output.timed else ()),
                },
            )
        if period is not None:
            self.DeclarePeriodicDiscreteUpdateEvent(
                period_sec=period, offset_sec=0.0, update=self._update_discrete
            )
        if self.starts:
            self.DeclareInitializationDiscreteUpdateEvent(self._start_discrete)

    def update(self, time: float, state: Any, *inputs: Any) -> Any:
        """Return the next state, or None to leave it as it is.

        Args:
            time: [s].
            state: Now.
            inputs: In the order of `inputs` and `optional`: vectors, None for optional
                ones without a value, and for abstract ones functions that return the
                value, because that can take long.
        """
        raise NotImplementedError

    def start(self, time: float, state: Any, *inputs: Any) -> Any:
        """Return the state at initialization; see `update`. Override it if needed."""
        raise NotImplementedError

    @property
    def starts(self) -> bool:
        """Whether the stage has a `start`."""
        return type(self).start is not Stage.start

    @property
    def input_names(self) -> list[str]:
        """Names of the inputs, in the order of the arguments of `update`."""
        return [*self.inputs, *self.optional]

    def input_kind(self, name: str) -> Any:
        """Return the size of an input, or its model value."""
        return {**self.inputs, **self.optional}[name]

    def _update_discrete(self, context: Any, discrete_state: Any) -> None:
        self._advance(self.update, context, discrete_state)

    def _start_discrete(self, context: Any, discrete_state: Any) -> None:
        self._advance(self.start, context, discrete_state)

    def _advance(
        self: Any, step: Callable[..., Any], context: Any, discrete_state: Any
    ) -> None:
        values = [read(context) for read in self._readers.values()]
        state = step(context.get_time(), self._state(context), *values)
        if state is not None:
            discrete_state.set_value(state)

    def _state(self, context: Any) -> Any:
        if not len(self.initial):
            return self.initial
        return context.get_discrete_state(0).CopyToVector()


class StageSystem(Stage, LeafSystem):
    """Base of a stage for floats: a LeafSystem that declares itself by `declare_stage`.

    A stage for other scalars derives from `Stage` and from Drake's `LeafSystem_[T]`.
    """


def declare_input(system: Any, name: str, kind: Any) -> Any:
    """Declare an input port: a vector of size `kind`, or with that model value."""
    if isinstance(kind, int):
        return system.DeclareVectorInputPort(name=name, size=kind)
    return system.DeclareAbstractInputPort(
        name=name, model_value=AbstractValue.Make(kind)
    )


def input_reader(port: InputPort, required: bool) -> Callable[[Any], Any]:
    """Return a function of the context that reads an input as `Stage` needs it.

    Args:
        port: Of the stage, or one in its place.
        required: Whether it is an error that the port has no value.
    """
    if port.get_data_type() == PortDataType.kAbstractValued:
        return lambda context: functools.partial(port.Eval, context)
    if required:
        return port.Eval
    return lambda context: port.Eval(context) if port.HasValue(context) else None


def _calc(name: str, stage: Any, context: Any, output: Any) -> None:
    spec = stage.outputs[name]
    values = [stage._readers[read](context) for read in spec.reads]
    output.SetFromVector(spec.calc(context.get_time(), stage._state(context), *values))


def weakly(system: Any, function: Callable[..., None]) -> Callable[..., None]:
    """Return a callback that does not keep its system, the first argument, alive."""
    reference = weakref.ref(system)
    return lambda *arguments: function(reference(), *arguments)
