"""A state machine as a system: modes, a transition function and entry actions.

Nothing here depends on grippers. Fill a `StateMachine` with your own modes.
`PickAndPlacePlanner` is a large example, the traffic light in
tests/planning/test_state_machine.py a small one.
"""

from __future__ import annotations

import abc
import copy
import dataclasses as dc
import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, Generic, Self, TypeVar

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, DependencyTicket, EventStatus, State

from drake_srg.common.shared import make_read_only
from drake_srg.lifetime import LeafSystem

ModeT = TypeVar("ModeT", bound=Hashable)
MemoryT = TypeVar("MemoryT")
SensesT = TypeVar("SensesT")
ObservationT = TypeVar("ObservationT")


def next_mode(
    table: Mapping[ModeT, Sequence[tuple[Callable[..., bool], ModeT]]],
    mode: ModeT,
    *arguments: Any,
) -> ModeT:
    """Return the next mode according to a transition table.

    Args:
        table: For each mode, conditions with the mode that follows. The first condition
            that holds decides; if none does, the mode stays.
        mode: The mode now.
        arguments: Passed to each condition.

    Raises:
        ValueError: If the table has no row for the mode.
    """
    if mode not in table:
        known = ", ".join(map(str, table))
        raise ValueError(f"transitions: no row for mode {mode} (allowed: {known})")
    for condition, following in table[mode]:
        if condition(*arguments):
            return following
    return mode


@dc.dataclass(frozen=True)
class Moment(Generic[SensesT]):
    """Time and senses: everything that a mode knows about the world."""

    time: float  # s
    senses: SensesT


@dc.dataclass(frozen=True)
class Entry(Moment[SensesT], Generic[SensesT, ModeT, ObservationT]):
    """The moment at which a mode begins, and its cause."""

    # The mode before, and the observation that ended it; None for the initial mode.
    previous: ModeT | None = None
    observation: ObservationT | None = None


@dc.dataclass
class Memory:
    """Base class of memories that modes may change.

    The machine gives a mode a draft: a copy of the memory and of its parts that also
    derive from this class. Modes change attributes of the draft. All copies share
    everything else (arrays, tuples, frozen dataclasses), so replace it instead of
    changing it. Never change a memory in a context.
    """

    def __copy__(self) -> Self:
        draft = object.__new__(type(self))
        for name, value in vars(self).items():
            part = copy.copy(value) if isinstance(value, Memory) else value
            object.__setattr__(draft, name, part)
        return draft

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self  # no copy: Drake copies contexts at every step


class ModeActions(abc.ABC, Generic[ModeT, MemoryT, SensesT, ObservationT]):
    """The actions of a state machine in one mode; they hold no state of their own.

    `enter` and `update` return the next memory. They may change a `Memory` in place,
    but must replace any other memory, such as a number or a frozen dataclass.
    """

    def enter(
        self, memory: MemoryT, entry: Entry[SensesT, ModeT, ObservationT]
    ) -> MemoryT:
        """Return the mode's first memory, including commands."""
        return memory

    def observe_entry(self, memory: MemoryT) -> ObservationT | None:
        """Return an observation that may end the mode on entry; None: no such one.

        The machine passes it to the transition, with a time in the mode of 0.
        """
        return None

    def update(self, memory: MemoryT, now: Moment[SensesT]) -> MemoryT:
        """Return the next memory."""
        return memory

    @abc.abstractmethod
    def observe(self, memory: MemoryT, now: Moment[SensesT]) -> ObservationT:
        """Return the observation on which the transition depends."""


@dc.dataclass(frozen=True)
class MachineState(Generic[ModeT, MemoryT]):
    """The abstract state of a machine."""

    mode: ModeT
    memory: MemoryT
    since: float = math.nan  # when the mode began [s]; NaN before initialization
    earlier: dc.InitVar[object] = None  # the previous memory, if any

    def __post_init__(self, earlier: object) -> None:
        make_read_only(self.memory, earlier)  # copies may share it

    def __deepcopy__(self, memo: dict[int, Any]) -> MachineState[ModeT, MemoryT]:
        memory = copy.deepcopy(self.memory, memo)
        # Copies usually share the memory, and a copy is made at every step.
        return self if memory is self.memory else dc.replace(self, memory=memory)


class StateMachine(LeafSystem, Generic[ModeT, MemoryT, SensesT, ObservationT]):
    """Runs modes that follow one another by a transition function.

    .. pydrake_system::

        name: StateMachine
        output_ports:
        - mode

    Output: `mode`, the present mode (abstract; of the modes' type).

    The initial mode begins at initialization, whatever the time, and its `enter`
    returns the first memory. Initialization changes nothing in a context whose mode has
    already begun. Then, at time 0 and every `period`,

    1. `sense` reads the inputs,
    2. the mode's `update` returns the next memory,
    3. its `observe` returns an observation,
    4. `transition` returns the mode that follows, and
    5. if it is another mode, its `enter` returns the first memory.

    All state is in the context, as one abstract value. To add inputs and outputs,
    derive from the machine: declare the ports after calling `__init__`, override
    `sense`, and calculate outputs from `state`, with `{self.state_ticket}` as
    prerequisites.

    Args:
        modes: Actions of each mode.
        initial: The mode to begin with.
        memory: The memory on entering the initial mode.
        transition: Returns the mode that follows from (mode, observation, time in the
            mode [s]). Keep it a pure function, so that it can be tested alone;
            `next_mode` evaluates a table.
        period: Time between updates [s].

    Raises:
        ValueError: If `initial` is not among `modes`.
    """

    def __init__(
        self,
        modes: Mapping[ModeT, ModeActions[ModeT, MemoryT, SensesT, ObservationT]],
        *,
        initial: ModeT,
        memory: MemoryT,
        transition: Callable[[ModeT, ObservationT, float], ModeT],
        period: float,
    ) -> None:
        super().__init__()
        self._modes = dict(modes)
        self._transition = transition
        self._actions(initial)
        self._state = self.DeclareAbstractState(
            AbstractValue.Make(MachineState(initial, memory))
        )
        self.DeclareAbstractOutputPort(
            name="mode",
            # An object even if modes are strings, for which Drake has its own type.
            alloc=lambda: Value[object](initial),
            calc=self._calc_mode,
            prerequisites_of_calc={self.state_ticket},
        )
        self.DeclareInitializationUnrestrictedUpdateEvent(self._initialize)
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    @property
    def state_ticket(self) -> DependencyTicket:
        """The prerequisite of outputs that depend on `state`."""
        return self.abstract_state_ticket(self._state)

    def state(self, context: Context) -> MachineState[ModeT, MemoryT]:
        """Return the mode, the memory and when the mode began."""
        return context.get_abstract_state(int(self._state)).get_value()

    def sense(self, context: Context) -> SensesT:
        """Return the senses that modes read; override it to read the inputs."""
        return None  # type: ignore[return-value]  # no inputs

    def _calc_mode(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self.state(context).mode)

    def _actions(
        self, mode: ModeT
    ) -> ModeActions[ModeT, MemoryT, SensesT, ObservationT]:
        if mode not in self._modes:
            allowed = ", ".join(map(str, self._modes))
            raise ValueError(f"no actions for mode {mode} (allowed: {allowed})")
        return self._modes[mode]

    def _initialize(self, context: Context, state: State) -> EventStatus:
        machine = self.state(context)
        if math.isnan(machine.since):
            entry = Entry[SensesT, ModeT, ObservationT](
                context.get_time(), self.sense(context)
            )
            memory = copy.copy(machine.memory)
            self._SetState(state, self._entered(machine.mode, memory, entry))
        return EventStatus.Succeeded()

    def _update(self, context: Context, state: State) -> EventStatus:
        now = Moment(context.get_time(), self.sense(context))
        machine = self.state(context)
        actions = self._actions(machine.mode)
        memory = actions.update(copy.copy(machine.memory), now)
        observation = actions.observe(memory, now)
        mode = self._transition(machine.mode, observation, now.time - machine.since)
        if mode != machine.mode:
            entry = Entry(now.time, now.senses, machine.mode, observation)
            self._SetState(state, self._entered(mode, memory, entry))
        else:
            earlier = machine.memory
            self._SetState(state, dc.replace(machine, memory=memory, earlier=earlier))
        return EventStatus.Succeeded()

    def _entered(
        self, mode: ModeT, memory: MemoryT, entry: Entry[SensesT, ModeT, ObservationT]
    ) -> MachineState[ModeT, MemoryT]:
        """Return the state after entering a mode, and any that follow it at once."""
        for _ in self._modes:
            actions = self._actions(mode)
            memory = actions.enter(memory, entry)
            observation = actions.observe_entry(memory)
            if observation is None:
                break
            following = self._transition(mode, observation, 0.0)
            if following == mode:
                break
            entry = dc.replace(entry, previous=mode, observation=observation)
            mode = following
        else:
            raise RuntimeError(
                f"entry actions: modes follow in a circle (next: {mode})"
            )
        return MachineState(mode, memory, entry.time)

    def _SetState(self, state: State, machine: MachineState[ModeT, MemoryT]) -> None:
        state.get_mutable_abstract_state(int(self._state)).set_value(machine)
