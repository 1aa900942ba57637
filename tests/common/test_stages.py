import gc
import weakref

import numpy as np
import pytest
from helpers import fix, port_table, read, update
from pydrake.common.value import AbstractValue

from drake_srg.common.stages import StageOutput, StageSystem


class Counter(StageSystem):
    """Adds its input to a sum, unless told to pause."""

    def __init__(self):
        super().__init__()
        self.declare_stage(
            inputs={"increment": 2, "note": "text"},
            optional={"pause": 1},
            outputs={
                "sum": StageOutput(2, lambda time, state: state),
                "length": StageOutput(1, self._length, reads=("note",)),
                "age": StageOutput(1, lambda time, state: [time], timed=True),
            },
            state=[1.0, 2.0],
            period=0.1,
        )

    def update(self, time, state, increment, note, pause):
        if pause is not None and pause[0]:
            return None
        return state + increment

    def _length(self, time, state, note):
        return [float(len(note()))]


@pytest.fixture
def counter():
    system = Counter()
    context = system.CreateDefaultContext()
    fix(system, context, increment=[1.0, 0.5], note=AbstractValue.Make("four"))
    return system, context


def test_a_stage_alone_is_a_system(counter):
    inputs, outputs = port_table(counter[0])
    assert inputs == {"increment": 2, "note": None, "pause": 1}
    assert outputs == {"sum": 2, "length": 1, "age": 1}


def test_an_update_returns_the_next_state(counter):
    update(*counter)
    assert np.array_equal(read(*counter, "sum"), [2.0, 2.5])


def test_an_update_that_returns_nothing_keeps_the_state(counter):
    system, context = counter
    fix(system, context, pause=1.0)
    update(system, context)
    assert np.array_equal(read(system, context, "sum"), [1.0, 2.0])


def test_an_abstract_input_comes_as_a_function(counter):
    assert read(*counter, "length") == 4.0


def test_outputs_depend_on_what_they_read_alone(counter):
    system, context = counter
    before = read(system, context, "age"), read(system, context, "length")
    context.SetTime(3.0)
    fix(system, context, note=AbstractValue.Make("sixsix"))
    assert before == (0.0, 4.0)
    assert (read(system, context, "age"), read(system, context, "length")) == (3.0, 6.0)
    assert not system.HasDirectFeedthrough(system.GetOutputPort("sum").get_index())


def test_a_required_input_without_a_value_is_an_error():
    system = Counter()
    with pytest.raises(RuntimeError, match=r"increment.* not connected"):
        update(system, system.CreateDefaultContext())


def test_a_stage_is_freed():
    system = Counter()
    reference = weakref.ref(system)
    del system
    gc.collect()
    assert reference() is None
