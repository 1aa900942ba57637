"""State machines: a traffic light, modes that end as they begin, and a gripper."""

import copy
import dataclasses as dc
import enum
import runpy
from pathlib import Path

import numpy as np
import pytest
from helpers import fix, read
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_srg.planning.state_machine import (
    Memory,
    ModeActions,
    StateMachine,
    next_mode,
)

PERIOD = 0.125  # a binary fraction, so that times of updates are exact


class Light(enum.Enum):
    RED = "red"
    GREEN = "green"
    AMBER = "amber"


# mode: [(condition on the observed button and the time in the mode [s]; next mode)]
TABLE = {
    Light.RED: [(lambda pressed, t: t >= 2.0, Light.GREEN)],
    Light.GREEN: [
        (lambda pressed, t: pressed, Light.AMBER),
        (lambda pressed, t: t >= 3.0, Light.AMBER),
    ],
    Light.AMBER: [(lambda pressed, t: t >= 0.5, Light.RED)],
}
ROUND = [(2.0, Light.RED), (3.0, Light.GREEN), (0.5, Light.AMBER)]


@dc.dataclass(frozen=True)
class Log:
    """The traffic light's memory: how often it was updated, and all its entries."""

    updates: int = 0
    entries: tuple = ()


class Lamp(ModeActions):
    def __init__(self, color):
        self.color = color

    def enter(self, memory, entry):
        return dc.replace(
            memory,
            entries=(*memory.entries, (entry.time, entry.previous, self.color)),
        )

    def update(self, memory, now):
        return dc.replace(memory, updates=memory.updates + 1)

    def observe(self, memory, now):
        return False  # nobody presses the button


def transition(mode, observation, t):
    return next_mode(TABLE, mode, observation, t)


def make_light(**changes):
    arguments = {
        "modes": {color: Lamp(color) for color in Light},
        "initial": Light.RED,
        "memory": Log(),
        "transition": transition,
        "period": PERIOD,
    }
    return StateMachine(**{**arguments, **changes})


def start(machine, time=0.0):
    simulator = Simulator(machine)
    simulator.get_mutable_context().SetTime(time)
    simulator.Initialize()
    return simulator


def advance(simulator, time):
    """Advance to a time, and do what is due then."""
    simulator.AdvanceTo(time)
    simulator.AdvancePendingEvents()


def scheduled(t):
    """The light's color at a time since it was switched on."""
    t %= sum(duration for duration, _ in ROUND)
    for duration, color in ROUND:
        if t < duration:
            return color
        t -= duration
    raise AssertionError


@pytest.mark.parametrize("begin", [0.0, 100.0, 12.25])
def test_modes_follow_one_another_whenever_the_simulation_begins(begin):
    light = make_light()
    simulator = start(light, begin)
    context = simulator.get_context()
    for i in range(100):
        advance(simulator, begin + i * PERIOD)
        assert read(light, context, "mode") is scheduled(i * PERIOD)
        # Nothing happens between updates.
        simulator.AdvanceTo(begin + (i + 0.9) * PERIOD)
        assert read(light, context, "mode") is scheduled(i * PERIOD)


def test_entry_actions_run_once_per_entry_and_updates_once_per_period():
    light = make_light()
    simulator = start(light, 10.0)
    advance(simulator, 16.0)
    state = light.state(simulator.get_context())
    assert state.memory.entries == (
        (10.0, None, Light.RED),
        (12.0, Light.RED, Light.GREEN),
        (15.0, Light.GREEN, Light.AMBER),
        (15.5, Light.AMBER, Light.RED),
    )
    assert (state.mode, state.since) == (Light.RED, 15.5)
    assert state.memory.updates == 1 + 6.0 / PERIOD


def test_before_it_is_initialized_a_machine_is_in_its_initial_mode():
    light = make_light(initial=Light.AMBER)
    context = light.CreateDefaultContext()
    assert read(light, context, "mode") is Light.AMBER
    assert light.state(context).memory == Log()


def test_initializing_a_context_again_lets_it_go_on():
    light = make_light()
    simulator = start(light)
    advance(simulator, 2.5)
    before = light.state(simulator.get_context())
    again = Simulator(light, simulator.get_context().Clone())
    again.Initialize()
    after = light.state(again.get_context())
    assert (after.mode, after.since) == (Light.GREEN, 2.0)
    assert after.memory == before.memory
    advance(again, 5.0)
    assert read(light, again.get_context(), "mode") is Light.AMBER


def test_clones_of_a_context_go_their_own_ways():
    light = make_light()
    simulator = start(light)
    advance(simulator, 1.0)
    clone = simulator.get_context().Clone()
    advance(simulator, 2.0)
    assert read(light, simulator.get_context(), "mode") is Light.GREEN
    assert read(light, clone, "mode") is Light.RED
    other = Simulator(light, clone)
    advance(other, 2.0)
    ends = [light.state(context) for context in (clone, simulator.get_context())]
    assert ends[0].memory.entries == ends[1].memory.entries
    assert ends[0].since == ends[1].since == 2.0


def test_clones_do_not_share_mutable_memory():
    light = make_light(memory={"entries": []}, modes=dict.fromkeys(Light, Still()))
    context = light.CreateDefaultContext()
    clone = context.Clone()
    light.state(clone).memory["entries"].append(1)
    assert light.state(context).memory == {"entries": []}


class Still(ModeActions):
    def observe(self, memory, now):
        return False


def test_entry_and_update_do_nothing_unless_they_are_overridden():
    memory = object()
    light = make_light(memory=memory, modes=dict.fromkeys(Light, Still()))
    simulator = start(light)
    advance(simulator, 2.5)
    kept = light.state(simulator.get_context()).memory
    assert type(kept) is object
    assert read(light, simulator.get_context(), "mode") is Light.GREEN


def test_the_first_condition_that_holds_decides():
    assert next_mode(TABLE, Light.GREEN, True, 0.0) is Light.AMBER
    assert next_mode(TABLE, Light.GREEN, True, 9.0) is Light.AMBER
    table = {"a": [(lambda x: x > 1, "b"), (lambda x: x > 0, "c")]}
    assert [next_mode(table, "a", x) for x in (0, 1, 2)] == ["a", "c", "b"]


def test_an_unknown_initial_mode_is_refused():
    with pytest.raises(ValueError, match=r"mode blue \(allowed: Light\.RED, .*AMBER\)"):
        make_light(initial="blue")


def test_a_transition_to_an_unknown_mode_raises():
    simulator = start(make_light(transition=lambda mode, o, t: "blue"))
    with pytest.raises(ValueError, match="no actions for mode blue"):
        simulator.AdvanceTo(1.0)


# Modes that end as they begin.


class Passing(Still):
    """Ends at once if `passes` is in the memory."""

    def __init__(self, passes):
        self.passes = passes

    def enter(self, memory, entry):
        return (*memory, self.passes)

    def observe_entry(self, memory):
        return True if self.passes else None


def staying(modes, memory):
    """Return a machine that stays in its first mode."""
    return make_light(
        modes=modes,
        initial=next(iter(modes)),
        memory=memory,
        transition=lambda mode, observed, t: mode,
    )


def pass_on(*passes):
    """Begin a machine whose modes 0, 1, 2, ... lead around in a circle."""
    machine = make_light(
        modes={i: Passing(p) for i, p in enumerate(passes)},
        initial=0,
        memory=(),
        transition=lambda mode, observed, t: (mode + observed) % len(passes),
    )
    return machine.state(start(machine, 7.0).get_context())


@pytest.mark.parametrize(
    ("passes", "ends_in"),
    [((False, True), 0), ((True, False), 1), ((True, True, False, True), 2)],
)
def test_an_entry_action_may_end_the_mode_at_once(passes, ends_in):
    state = pass_on(*passes)
    assert (state.mode, state.since) == (ends_in, 7.0)
    assert state.memory == passes[: ends_in + 1]


def test_entry_actions_that_lead_in_a_circle_raise():
    with pytest.raises(RuntimeError, match="in a circle"):
        pass_on(True, True, True)


def test_an_entry_that_leads_nowhere_begins_the_mode():
    machine = staying({0: Passing(True)}, ())
    assert machine.state(start(machine).get_context()).mode == 0


def test_a_machine_is_freed(leaked):
    simulator = start(make_light())
    simulator.AdvanceTo(1.0)
    assert leaked() == ["StateMachine"]
    del simulator
    assert leaked() == []


# Memories that modes change.


@dc.dataclass
class Part(Memory):
    count: int = 0


@dc.dataclass
class Whole(Memory):
    part: Part = dc.field(default_factory=Part)
    shared: list = dc.field(default_factory=list)


class Counting(ModeActions):
    """Changes a part of its memory at every update, without asking for a copy."""

    def update(self, memory, now):
        memory.part.count += 1
        return memory

    def observe(self, memory, now):
        return None


def test_a_mode_changes_the_memory_of_its_own_context_alone():
    machine = staying({Light.RED: Counting()}, Whole())
    simulator = Simulator(machine)
    simulator.AdvanceTo(3.0 * PERIOD)
    earlier = simulator.get_context().Clone()
    simulator.AdvanceTo(5.0 * PERIOD)
    assert machine.state(earlier).memory.part.count == 3
    assert machine.state(simulator.get_context()).memory.part.count == 5
    assert machine.state(machine.CreateDefaultContext()).memory.part.count == 0


def test_a_draft_copies_parts_and_shares_the_rest():
    memory = Whole(shared=[1])
    draft = copy.copy(memory)
    assert draft == memory
    assert draft.part is not memory.part
    assert draft.shared is memory.shared
    assert copy.deepcopy(memory) is memory


# A machine with ports of its own: a gripper that opens and closes.


class Open(ModeActions):
    def enter(self, memory, entry):
        return 0.0

    def observe(self, memory, now):
        return now.senses


class Shut(Open):
    def enter(self, memory, entry):
        return 1.0


class GripperCycle(StateMachine):
    """Closes until something is grasped, then opens for a second; remembers closure."""

    def __init__(self):
        table = {
            "open": [(lambda grasped, t: t >= 1.0, "shut")],
            "shut": [(lambda grasped, t: grasped, "open")],
        }
        super().__init__(
            {"open": Open(), "shut": Shut()},
            initial="open",
            memory=0.5,
            transition=lambda mode, o, t: next_mode(table, mode, o, t),
            period=PERIOD,
        )
        self._grasped = self.DeclareVectorInputPort("grasped", 1)
        self.calculations = 0
        self.DeclareVectorOutputPort(
            "closure", 1, self._calc_closure, {self.state_ticket}
        )

    def sense(self, context):
        return bool(self._grasped.Eval(context)[0])

    def _calc_closure(self, context, output):
        self.calculations += 1
        output[0] = self.state(context).memory


def test_a_derived_machine_reads_its_inputs_and_calculates_outputs():
    cycle = GripperCycle()
    simulator = Simulator(cycle)
    context = simulator.get_mutable_context()
    fix(cycle, context, grasped=0.0)
    assert read(cycle, context, "closure") == [0.5]
    simulator.Initialize()
    assert read(cycle, context, "closure") == [0.0]
    advance(simulator, 1.0)
    assert read(cycle, context, "closure") == [1.0]
    advance(simulator, 5.0)
    assert read(cycle, context, "mode") == "shut"
    fix(cycle, context, grasped=1.0)
    advance(simulator, 5.0 + PERIOD)
    assert read(cycle, context, "mode") == "open"
    assert read(cycle, context, "closure") == [0.0]
    advance(simulator, 6.0 + PERIOD)
    assert read(cycle, context, "mode") == "shut"


def test_outputs_of_the_state_are_calculated_only_when_it_changes():
    cycle = GripperCycle()
    context = cycle.CreateDefaultContext()
    for time, grasped in ((0.0, 0.0), (0.0, 1.0), (3.0, 1.0)):
        context.SetTime(time)
        fix(cycle, context, grasped=grasped)
        np.testing.assert_array_equal(read(cycle, context, "closure"), [0.5])
    assert cycle.calculations == 1


@pytest.mark.slow
def test_the_documented_machine_grasps_the_can():
    program = Path(__file__).parents[2] / "examples/extending/grasp_cycle.py"
    modes = runpy.run_path(program)["main"]()
    assert list(dict.fromkeys(modes)) == ["open", "close", "hold"]
    # It holds the can for two seconds, and opens again.
    assert modes.count("hold") == pytest.approx(20, abs=1)
    assert modes[-8] == "open"


def test_a_machine_in_a_diagram_is_freed(leaked):
    def run():
        builder = DiagramBuilder()
        cycle = builder.AddSystem(GripperCycle())
        source = builder.AddSystem(ConstantVectorSource([1.0]))
        builder.Connect(source.get_output_port(), cycle.get_input_port())
        simulator = Simulator(builder.Build())
        simulator.AdvanceTo(1.0)
        mode = cycle.GetOutputPort("mode").Eval(
            cycle.GetMyContextFromRoot(simulator.get_context().Clone())
        )
        assert mode == "open"

    run()
    assert leaked() == []
