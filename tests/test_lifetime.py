import gc
import weakref

import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, ValueProducer

from drake_srg.lifetime import LeafSystem, my_context, weak


class OneOfEverything(LeafSystem):
    def __init__(self):
        super().__init__()
        self.calls = 0
        self._input = self.DeclareVectorInputPort("u", 1)
        self.DeclareVectorOutputPort("vector", 1, self._calc)
        self.DeclareAbstractOutputPort(
            name="abstract", alloc=self._allocate, calc=self._calc
        )
        self.DeclareCacheEntry(
            "cache", ValueProducer(lambda: AbstractValue.Make(0), weak(self._calc))
        )
        self.DeclarePeriodicPublishEvent(0.1, 0.1, self._publish)
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.1, 0.1, self._update)
        self.DeclareForcedPublishEvent(self._publish)

    def _allocate(self):
        return AbstractValue.Make([])

    def _calc(self, context, output):
        self.calls += 1

    def _publish(self, context):
        self.calls += 1

    def _update(self, context, state):
        self.calls += 1


def test_callbacks_still_work():
    system = OneOfEverything()
    context = system.CreateDefaultContext()
    system.GetOutputPort("vector").Eval(context)
    system.GetOutputPort("abstract").Eval(context)
    assert system.calls == 2
    Simulator(system, context).AdvanceTo(0.25)
    assert system.calls == 6


def make_alone():
    return OneOfEverything()


def make_in_a_diagram():
    builder = DiagramBuilder()
    builder.AddSystem(OneOfEverything())
    return builder.Build()


def make_simulator():
    simulator = Simulator(make_in_a_diagram())
    simulator.AdvanceTo(0.2)
    return simulator.get_system()


@pytest.mark.slow
@pytest.mark.parametrize("make", [make_alone, make_in_a_diagram, make_simulator])
def test_a_system_is_freed(make):
    made = make()
    watches = [weakref.ref(made)]
    if made.__class__ is not OneOfEverything:
        watches += [weakref.ref(system) for system in made.GetSystems()]
    assert all(watch() is not None for watch in watches)
    del made
    gc.collect()
    assert [watch() for watch in watches] == [None] * len(watches)


@pytest.mark.slow
def test_a_root_context_is_freed_after_my_context_returned_it():
    diagram = make_in_a_diagram()
    context = diagram.CreateDefaultContext()
    assert my_context(diagram, context) is context
    freed = weakref.ref(context)
    del context
    gc.collect()
    assert freed() is None


def test_my_context_returns_the_context_of_a_subsystem():
    builder = DiagramBuilder()
    system = builder.AddSystem(OneOfEverything())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    system.ValidateContext(my_context(system, context))
